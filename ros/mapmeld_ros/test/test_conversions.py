"""Messages to values and back."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg

import rooms
from mapmeld import OccupancyGrid
from mapmeld.grid_message import BadMessage
from mapmeld_ros.conversions import (
    grid_from_message,
    grid_to_message,
    pose_with_covariance,
    transform_message,
)
from mapmeld_ros.robots import Robots

STAMP = Time(sec=12, nanosec=34)


def message(origin: tuple[float, float, float] = (1.5, -2.0, 0.7)) -> OccupancyGridMsg:
    return grid_to_message(OccupancyGrid(np.arange(12).reshape(3, 4), 0.05, origin), "robot/map", STAMP)


@pytest.mark.parametrize("theta", [0.0, 0.3, math.pi / 2, -3.0, math.pi])
def test_a_grid_survives_the_way_there_and_back(theta: float) -> None:
    grid = rooms.view("a", (-0.5, 9.0), (1.0, 2.0, 0.4))
    grid = OccupancyGrid(grid.data, 0.05, (1.5, -2.0, theta), "a")
    back = grid_from_message(grid_to_message(grid, "a/map", STAMP), "a")
    np.testing.assert_array_equal(back.data, grid.data)
    assert back.resolution == 0.05
    np.testing.assert_allclose(back.origin, grid.origin, atol=1e-12)
    assert back.name == "a"


def test_rows_of_a_message_start_at_the_lowest_y() -> None:
    msg = message()
    assert (msg.info.width, msg.info.height) == (4, 3)
    assert list(msg.data[:5]) == [0, 1, 2, 3, 4]
    assert (msg.header.frame_id, msg.header.stamp) == ("robot/map", STAMP)


def test_a_rotated_origin_puts_cells_where_tf_would() -> None:
    """Cell (0, 0) of a grid whose origin is turned by 90 degrees lies to the upper left of the origin."""
    grid = grid_from_message(message((1.0, 2.0, math.pi / 2)), "a")
    np.testing.assert_allclose(grid.cell_centers(np.array([0]), np.array([0])), [[0.975, 2.025]])


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"info.width": 5}, "data", "5 x 3 = 15 cells, got 12"),
        ({"info.width": 0}, "info.width", "empty"),
        ({"info.resolution": math.nan}, "info.resolution", "nan"),
        ({"info.origin.position.y": math.inf}, "info.origin.position.y", "inf"),
        ({"info.origin.orientation.w": 2.0}, "info.origin.orientation", "length 1"),
        ({"data": array("b", [0] * 11 + [101])}, "data", "101 at index 11"),
        ({"info.width": 20000, "info.height": 20000}, "info.width", "20000 x 20000 cells are more than"),
    ],
)
def test_a_bad_map_is_refused_by_its_field(change: dict[str, Any], field: str, words: str) -> None:
    """As the merge's own converter does, see its tests; but for the size, which is the node's matter."""
    msg = message()
    for path, value in change.items():
        *parents, last = path.split(".")
        target = msg
        for name in parents:
            target = getattr(target, name)
        setattr(target, last, value)
    with pytest.raises(BadMessage) as caught:
        grid_from_message(msg, "a")
    assert caught.value.field == field
    assert words in caught.value.problem


def test_an_orientation_that_was_left_unset_is_none() -> None:
    msg = message()
    msg.info.origin.orientation.z = msg.info.origin.orientation.w = 0.0
    assert grid_from_message(msg, "a").origin == (1.5, -2.0, 0.0)


def update(x: int, y: int, values: list[list[int]], frame: str = "robot/map") -> OccupancyGridUpdate:
    part = np.array(values, dtype=np.int8)
    msg = OccupancyGridUpdate(
        x=x, y=y, width=part.shape[1], height=part.shape[0], data=array("b", part.tobytes())
    )
    msg.header.frame_id = frame
    return msg


def known() -> Robots:
    robots = Robots()
    robots.join("a", "/a/map", 0.0)
    robots.take_map("a", message(), 0.0)
    return robots


@pytest.mark.parametrize("frame", ["robot/map", "", "/robot/map"])
def test_an_update_replaces_its_part_only(frame: str) -> None:
    robots = known()
    before = robots.get("a").grid
    changed = robots.take_update("a", update(1, 2, [[100, -1, 7]], frame), 1.0)
    expected = np.arange(12).reshape(3, 4)
    expected[2, 1:4] = [100, -1, 7]
    np.testing.assert_array_equal(changed.data, expected)
    np.testing.assert_array_equal(before.data, np.arange(12).reshape(3, 4))
    assert robots.get("a").grid is changed
    assert robots.get("a").frame.lstrip("/") == "robot/map"


@pytest.mark.parametrize(
    ("bad", "field"),
    [
        (update(4, 0, [[1]]), "x, width"),
        (update(0, 0, [[101]]), "data"),
        (update(0, 0, [[1]], "elsewhere"), "header.frame_id"),
    ],
)
def test_an_update_that_does_not_fit_is_refused(bad: OccupancyGridUpdate, field: str) -> None:
    robots = known()
    before = robots.get("a").grid
    with pytest.raises(BadMessage) as caught:
        robots.take_update("a", bad, 1.0)
    assert caught.value.field == field
    assert robots.get("a").grid is before


def test_a_map_cannot_change_its_frame() -> None:
    msg = message()
    msg.header.frame_id = ""
    with pytest.raises(BadMessage) as caught:
        known().take_map("a", msg, 1.0)
    assert caught.value.field == "header.frame_id"


def test_a_transform_takes_child_coordinates_to_the_parent() -> None:
    msg = transform_message((1.0, 2.0, math.pi / 2), "world", "a/map", STAMP)
    assert (msg.header.frame_id, msg.child_frame_id, msg.header.stamp) == ("world", "a/map", STAMP)
    q = msg.transform.rotation
    assert (q.x, q.y) == (0.0, 0.0)
    assert math.isclose(2 * math.atan2(q.z, q.w), math.pi / 2)


def test_covariance_lands_at_x_y_and_yaw() -> None:
    covariance = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]])
    full = np.array(pose_with_covariance((0, 0, 0), covariance).covariance).reshape(6, 6)
    np.testing.assert_array_equal(full[np.ix_([0, 1, 5], [0, 1, 5])], covariance)
    assert np.count_nonzero(full) == 9
