"""Messages to grids: the fields of rosbags' messages stand for those of rclpy and rospy."""

from __future__ import annotations

import array
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bags import UPDATE, header, message, store_of
from mapmeld.grid import OccupancyGrid
from mapmeld.grid_message import BadMessage, apply_updates, grid_from_message, is_empty
from mapmeld.map_io import read_map

STORES = {kind: store_of(kind) for kind in ("rosbag1", "mcap")}
GRID = OccupancyGrid([[0, 100, -1], [7, 0, 55]], 0.05, (1.5, -2.25, 0.7), "r")


def made(grid: OccupancyGrid = GRID, kind: str = "mcap") -> Any:
    return message(STORES[kind], grid)


def update(x: int, y: int, cells: Any, **changes: Any) -> Any:
    cells = np.asarray(cells, dtype=np.int8)
    fields = dict(x=x, y=y, width=cells.shape[1], height=cells.shape[0], data=cells.reshape(-1))
    return STORES["mcap"].types[UPDATE](header=header(STORES["mcap"]), **{**fields, **changes})


@pytest.mark.parametrize("kind", STORES)
@pytest.mark.parametrize("theta", [0.0, 0.7, -2.9, math.pi, -math.pi / 2, 1e-5])
def test_there_and_back(kind: str, theta: float) -> None:
    grid = OccupancyGrid(GRID.data, 0.05, (1.5, -2.25, theta), "r")
    back = grid_from_message(made(grid, kind), "r")
    assert (back.data == grid.data).all()
    assert back.data.shape == (2, 3)
    assert back.origin[:2] == grid.origin[:2]
    assert math.remainder(back.origin[2] - theta, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
    assert (back.resolution, back.name) == (0.05, "r")


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.025, 0.0333333, 1 / 3, 0.02])
def test_the_resolution_that_was_meant(resolution: float) -> None:
    """What a float32 makes of 0.05 is not what a saved map says."""
    sent = made()
    sent.info.resolution = float(np.float32(resolution))
    assert grid_from_message(sent).resolution == pytest.approx(resolution, rel=1e-7)
    if len(str(resolution)) < 8:
        assert grid_from_message(sent).resolution == resolution


def test_data_of_rclpy_and_lists() -> None:
    for kind in (lambda v: array.array("b", v), list, lambda v: np.array(v, dtype=np.int8)):
        sent = made()
        sent.data = kind([int(v) for v in GRID.data.reshape(-1)])
        assert (grid_from_message(sent).data == GRID.data).all()


def test_the_sign_of_a_quaternion_is_free() -> None:
    sent = made()
    q = sent.info.origin.orientation
    q.z, q.w = -q.z, -q.w
    assert grid_from_message(sent).origin[2] == pytest.approx(0.7, abs=1e-12)


def test_an_unset_quaternion_is_no_rotation() -> None:
    sent = made()
    sent.info.origin.orientation.z = sent.info.origin.orientation.w = 0.0
    assert grid_from_message(sent).origin == (1.5, -2.25, 0.0)


def test_rounding_of_a_quaternion_is_accepted() -> None:
    sent = made()
    q = sent.info.origin.orientation
    q.z, q.w, q.x = q.z * 1.005, q.w * 1.005, 1e-4
    assert grid_from_message(sent).origin[2] == pytest.approx(0.7, abs=1e-9)


def set_field(path: str, value: Any) -> Callable[[Any], None]:
    def change(target: Any) -> None:
        *parents, last = path.split(".")
        for parent in parents:
            target = getattr(target, parent)
        setattr(target, last, value)

    return change


BAD = {
    "no width": (set_field("info.width", 0), ["info.width", "positive", "0"]),
    "no height": (set_field("info.height", 0), ["info.height", "positive"]),
    "short": (set_field("data", np.zeros(5, np.int8)), ["data", "3 x 2 = 6", "got 5"]),
    "long": (set_field("data", np.zeros(7, np.int8)), ["data", "got 7"]),
    "transposed": (set_field("info.width", 4), ["data", "4 x 2 = 8", "got 6"]),
    "below": (
        set_field("data", np.array([0, 0, -1, 0, -2, -3], np.int8)),
        ["data", "-2 at index 4", "row 1, column 1", "2 bad values"],
    ),
    "above": (set_field("data", np.array([0, 101, 0, 0, 0, 0], np.int8)), ["data", "101 at index 1"]),
    "unsigned": (set_field("data", np.array([255] * 6, np.uint8)), ["data", "255 at index 0"]),
    "fractions": (set_field("data", np.zeros(6)), ["data", "integers", "float64"]),
    "no resolution": (set_field("info.resolution", 0.0), ["info.resolution", "positive", "0"]),
    "nan resolution": (set_field("info.resolution", math.nan), ["info.resolution", "nan"]),
    "nan x": (set_field("info.origin.position.x", math.nan), ["info.origin.position.x", "finite"]),
    "inf y": (set_field("info.origin.position.y", math.inf), ["info.origin.position.y", "finite"]),
    "tilted": (
        set_field("info.origin.orientation", SimpleNamespace(x=0.6, y=0.0, z=0.0, w=0.8)),
        ["info.origin.orientation", "about z", "flat"],
    ),
    "not normalised": (
        set_field("info.origin.orientation", SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.9)),
        ["info.origin.orientation", "length is 0.9"],
    ),
    "nan quaternion": (
        set_field("info.origin.orientation", SimpleNamespace(x=0.0, y=0.0, z=math.nan, w=1.0)),
        ["info.origin.orientation", "nan"],
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_messages_name_the_field(case: str) -> None:
    change, words = BAD[case]
    sent = made()
    change(sent)
    with pytest.raises(BadMessage) as caught:
        grid_from_message(sent)
    assert "\n" not in str(caught.value)
    assert caught.value.field == words[0]
    assert str(caught.value) == f"{caught.value.field}: {caught.value.problem}"
    for word in words:
        assert word in str(caught.value)


def test_what_is_empty() -> None:
    sent = made()
    assert not is_empty(sent)
    sent.info.width = 0
    assert not is_empty(sent)
    sent.data = np.zeros(0, np.int8)
    assert is_empty(sent)


def test_updates_in_their_order() -> None:
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.05, (1.0, 2.0, 0.3), "r")
    new = apply_updates(grid, iter([update(1, 2, [[100, 100], [50, -1]]), update(2, 2, [[7]])]))
    expected = np.zeros((4, 5), np.int8)
    expected[2, 1:3], expected[3, 1:3] = (100, 7), (50, -1)
    assert (new.data == expected).all()
    assert (new.resolution, new.origin, new.name) == (grid.resolution, grid.origin, grid.name)
    assert not grid.data.any()
    assert apply_updates(grid, []) is grid
    assert (apply_updates(grid, [update(0, 0, expected)]).data == expected).all()
    assert not apply_updates(grid, [update(5, 4, np.zeros((0, 0)))]).data.any()


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (update(4, 0, [[1, 1]]), ["x, width", "4 and 2", "5 cells"]),
        (update(-1, 0, [[1, 1]]), ["x, width", "-1"]),
        (update(0, 3, [[1], [1]]), ["y, height", "3 and 2", "4 cells"]),
        (update(0, -2, [[1], [1]]), ["y, height", "-2"]),
        (update(0, 0, [[1, 1]], data=np.zeros(3, np.int8)), ["data", "2 x 1 = 2", "got 3"]),
        (update(0, 0, [[1, -5]]), ["data", "-5 at index 1"]),
    ],
)
def test_bad_updates_name_the_field(sent: Any, words: list[str]) -> None:
    grid = OccupancyGrid(np.zeros((4, 5), np.int8), 0.05)
    with pytest.raises(BadMessage) as caught:
        apply_updates(grid, [update(0, 0, [[9]]), sent])
    assert caught.value.field == words[0]
    for word in words:
        assert word in str(caught.value)
    assert not grid.data.any()


def test_a_recorded_map_through_the_wire(shared_data: Any) -> None:
    """Serialised and back with both ROS's codecs."""
    grid = read_map(sorted((shared_data / "mazeA_k3_drift").glob("*.yaml"))[0])
    for store, to, back in (
        (get_typestore(Stores.ROS1_NOETIC), "serialize_ros1", "deserialize_ros1"),
        (get_typestore(Stores.ROS2_JAZZY), "serialize_cdr", "deserialize_cdr"),
    ):
        kind = "nav_msgs/msg/OccupancyGrid"
        raw = getattr(store, to)(message(store, grid), kind)
        found = grid_from_message(getattr(store, back)(bytes(raw), kind), grid.name)
        assert (found.data == grid.data).all()
        assert found.resolution == grid.resolution
        assert found.origin == pytest.approx(grid.origin, abs=1e-12)
