"""Known poses and pins over the robots' lives, without a graph."""

from __future__ import annotations

from typing import Any

import pytest
from builtin_interfaces.msg import Time

import rooms
from mapmeld import OccupancyGrid
from mapmeld_ros.conversions import grid_to_message
from mapmeld_ros.known_poses import BadKnownPose
from mapmeld_ros.parameters import Parameters
from mapmeld_ros.session import MergeSession


def init_pose(**values: float) -> dict[str, Any]:
    return {f"/hall/map_merge/init_pose_{key}": value for key, value in values.items()}


def started(values: dict[str, Any], **parameters: Any) -> MergeSession:
    """A session that knows the hall."""
    session = MergeSession(Parameters(**parameters), values.get)
    session.robots.join("hall", "/hall/map", 0.0)
    take(session, rooms.hall())
    session.settle()
    return session


def take(session: MergeSession, grid: OccupancyGrid) -> None:
    assert session.take_map("hall", grid_to_message(grid, "hall/map", Time()), 0.0)


def grown(rows: int) -> OccupancyGrid:
    """The hall with its origin moved down by a few empty rows."""
    hall = rooms.hall()
    larger = OccupancyGrid(hall.data, hall.resolution, hall.origin, "hall").data
    padded = [[-1] * hall.width] * rows + larger.tolist()
    x, y, _ = hall.origin
    return OccupancyGrid(padded, hall.resolution, (x, y - rows * hall.resolution, 0.0), "hall")


def status(session: MergeSession) -> str:
    (robot,) = session.estimator.estimate().robots
    return robot.status


@pytest.mark.parametrize("is_legacy", [True, False])
def test_who_was_unpinned_stays_so_until_another_pose_is_given(is_legacy: bool) -> None:
    values = init_pose(x=1.0, y=2.0, yaw=0.0)
    session = started(values, legacy_init_poses=is_legacy)
    assert status(session) == "pinned"
    take(session, grown(3))
    assert status(session) == "pinned"
    session.unpin("hall")
    assert status(session) == "no evidence"
    # A moved origin, and what is told again after a pause.
    take(session, grown(5))
    session.place_known("hall")
    assert status(session) == "no evidence"
    values |= init_pose(x=4.0)
    session.place_known("hall")
    assert status(session) == "pinned"


def test_a_prior_that_came_while_a_user_pinned_counts_when_the_pin_goes() -> None:
    values: dict[str, Any] = {}
    session = started(values)
    session.pin("hall", (5.0, 5.0, 0.0))
    values |= init_pose(x=1.0, y=2.0, yaw=0.0, sigma_xy=0.3, sigma_yaw=0.1)
    session.place_known("hall")
    assert status(session) == "pinned"
    session.unpin("hall")
    assert status(session) == "prior"


def test_a_bad_pose_says_what_becomes_of_the_robot() -> None:
    values = init_pose(x=1.0, y=2.0)
    session = MergeSession(Parameters(), values.get)
    session.robots.join("hall", "/hall/map", 0.0)
    take(session, rooms.hall())
    with pytest.raises(BadKnownPose, match=r"init_pose_yaw: is missing.*; its map is placed by its walls$"):
        session.settle()
    values |= init_pose(yaw=0.5)
    session.place_known("hall")
    assert status(session) == "pinned"
    values |= init_pose(sigma_xy=-1.0)
    with pytest.raises(BadKnownPose, match=r"sigma_xy: -1\.0 is negative.*; its earlier pose stays$"):
        session.place_known("hall")
    assert status(session) == "pinned"
