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
from mapmeld_ros.checks import BadMessage
from mapmeld_ros.conversions import (
    apply_update,
    grid_from_message,
    grid_to_message,
    pose_with_covariance,
    transform_message,
)

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


NAN = math.nan


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"info.width": 5}, "data", "12 cells, width x height is 5 x 3"),
        ({"info.width": 0}, "info.width", "empty"),
        ({"info.height": 0}, "info.height", "empty"),
        ({"info.resolution": 0.0}, "info.resolution", "positive"),
        ({"info.resolution": -0.05}, "info.resolution", "positive"),
        ({"info.resolution": NAN}, "info.resolution", "nan"),
        ({"info.resolution": math.inf}, "info.resolution", "inf"),
        ({"info.origin.position.x": NAN}, "info.origin.position.x", "nan"),
        ({"info.origin.position.y": math.inf}, "info.origin.position.y", "inf"),
        ({"info.origin.orientation.w": NAN}, "info.origin.orientation", "finite"),
        (
            {"info.origin.orientation.w": 0.0, "info.origin.orientation.z": 0.0},
            "info.origin.orientation",
            "norm",
        ),
        ({"info.origin.orientation.w": 2.0}, "info.origin.orientation", "norm"),
        (
            {
                "info.origin.orientation.w": 0.8,
                "info.origin.orientation.x": 0.6,
                "info.origin.orientation.z": 0.0,
            },
            "info.origin.orientation",
            "tilts",
        ),
        ({"data": array("b", [0] * 11 + [101])}, "data", "0..101"),
        ({"data": array("b", [0] * 11 + [-2])}, "data", "-2..0"),
        ({"info.width": 20000, "info.height": 20000}, "info.width", "20000 x 20000"),
    ],
)
def test_a_bad_map_is_refused_by_its_field(change: dict[str, Any], field: str, words: str) -> None:
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


def update(x: int, y: int, values: list[list[int]]) -> OccupancyGridUpdate:
    part = np.array(values, dtype=np.int8)
    return OccupancyGridUpdate(
        x=x, y=y, width=part.shape[1], height=part.shape[0], data=array("b", part.tobytes())
    )


def test_an_update_replaces_its_part_only() -> None:
    grid = grid_from_message(message(), "a")
    changed = apply_update(grid, update(1, 2, [[100, -1, 7]]))
    expected = np.arange(12).reshape(3, 4)
    expected[2, 1:4] = [100, -1, 7]
    np.testing.assert_array_equal(changed.data, expected)
    np.testing.assert_array_equal(grid.data, np.arange(12).reshape(3, 4))
    assert (changed.origin, changed.resolution, changed.name) == (grid.origin, grid.resolution, "a")


@pytest.mark.parametrize(
    ("bad", "field"),
    [
        (update(-1, 0, [[1]]), "x"),
        (update(4, 0, [[1]]), "x"),
        (update(3, 0, [[1, 1]]), "x"),
        (update(0, 2, [[1], [1]]), "y"),
        (update(0, 0, [[101]]), "data"),
        (OccupancyGridUpdate(width=2, height=2, data=array("b", [1, 2, 3])), "data"),
    ],
)
def test_an_update_that_does_not_fit_is_refused(bad: OccupancyGridUpdate, field: str) -> None:
    with pytest.raises(BadMessage) as caught:
        apply_update(grid_from_message(message(), "a"), bad)
    assert caught.value.field == field


def test_an_empty_update_changes_nothing() -> None:
    grid = grid_from_message(message(), "a")
    assert apply_update(grid, OccupancyGridUpdate()) is grid


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
