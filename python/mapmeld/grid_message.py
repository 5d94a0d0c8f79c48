"""Turns nav_msgs/OccupancyGrid messages into grids, and applies map_msgs/OccupancyGridUpdate to them.

A message is anything with the fields that the definitions name, such as those of rosbags, rclpy and rospy. No
ROS is imported here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.errors import MapmeldError
from mapmeld.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from mapmeld.map_yaml import one_line

# What a quaternion's length may be off: publishers round, and 1e-2 is past any rounding.
_LENGTH_TOLERANCE = 1e-2
# Radians that a map's axes may lean out of the plane: at 0.01 a metre of floor is short by 0.05 mm.
_TILT_TOLERANCE = 1e-2


class BadMessage(MapmeldError):
    """A message that cannot be used. `field` is its path in the message, `problem` a phrase."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(one_line(f"{field}: {problem}"))
        self.field = field
        self.problem = problem


def grid_from_message(message: Any, name: str = "") -> OccupancyGrid:
    """The grid that a nav_msgs/OccupancyGrid holds. Its origin is `info.origin`, as x, y and yaw.

    name: what results call the map; a message has no name. The frame is not looked at: map coordinates are
    those of `header.frame_id`, whatever it is called.

    resolution is a float32 in the message; the grid gets the number that was meant, 0.05 and not
    0.05000000074505806, so that it equals that of a saved map. A quaternion of four zeros is one that the
    publisher left unset, as ROS 1 initialises it, and stands for no rotation.

    Raises BadMessage, naming the field: info.width and info.height that are not positive or do not make
    the length of data, info.resolution that is not positive, an origin that is not finite, a quaternion that
    is not normalised or leans out of the plane, and data outside of -1..100.
    """
    info = message.info
    width, height = _positive("info.width", info.width), _positive("info.height", info.height)
    cells = _cells("data", message.data, width, height)
    pose = info.origin
    x, y = (_finite(f"info.origin.position.{axis}", getattr(pose.position, axis)) for axis in "xy")
    return OccupancyGrid(cells, _resolution(info.resolution), (x, y, _yaw(pose.orientation)), name)


def is_empty(message: Any) -> bool:
    """Whether a nav_msgs/OccupancyGrid has no cells: some publish that before they have seen anything."""
    return 0 in (message.info.width, message.info.height) and len(message.data) == 0


def apply_updates(grid: OccupancyGrid, updates: Iterable[Any]) -> OccupancyGrid:
    """The grid after map_msgs/OccupancyGridUpdate messages, applied in their order; `grid` stays as it is.

    An update's x and y are the column and row of its first cell. Raises BadMessage, naming the field, for
    one that does not lie within the grid, or whose data has another length than width x height or values
    outside of -1..100.
    """
    data: NDArray[np.int8] | None = None
    for update in updates:
        if data is None:
            data = grid.data.copy()
        width, height = int(update.width), int(update.height)
        x, y = int(update.x), int(update.y)
        for size, first, room, sides in (
            (width, x, grid.width, ("x", "width")),
            (height, y, grid.height, ("y", "height")),
        ):
            if size < 0 or first < 0 or first + size > room:
                raise BadMessage(
                    f"{sides[0]}, {sides[1]}",
                    f"{first} and {size} reach out of the map, which has a {sides[1]} of {room} cells; the "
                    "update belongs to another map",
                )
        data[y : y + height, x : x + width] = _cells("data", update.data, width, height)
    return grid if data is None else OccupancyGrid(data, grid.resolution, grid.origin, grid.name)


def _positive(field: str, value: Any) -> int:
    if int(value) <= 0:
        raise BadMessage(field, f"must be a positive number of cells, got {int(value)}; the map is empty")
    return int(value)


def _finite(field: str, value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise BadMessage(field, f"must be a finite number of metres, got {number}")
    return number


def _resolution(value: Any) -> float:
    resolution = float(value)
    if not math.isfinite(resolution) or resolution <= 0:
        problem = f"must be a positive number of metres per cell, got {resolution:g}"
        raise BadMessage("info.resolution", problem)
    single = np.float32(resolution)
    return float(str(single)) if float(single) == resolution else resolution


def _cells(field: str, values: Any, width: int, height: int) -> NDArray[np.int8]:
    """The values as an array of shape (height, width), checked."""
    cells = np.asarray(values)
    if cells.size != width * height:
        raise BadMessage(field, f"must have {width} x {height} = {width * height} cells, got {cells.size}")
    if cells.size and cells.dtype.kind not in "iu":
        raise BadMessage(field, f"must hold integers, got {cells.dtype}")
    cells = cells.reshape(-1)
    bad = (cells < UNKNOWN) | (cells > OCCUPIED)
    if bad.any():
        i = int(bad.argmax())
        raise BadMessage(
            field,
            f"must be -1 (unknown) or 0 to 100, got {int(cells[i])} at index {i} (row {i // width}, "
            f"column {i % width}), one of {int(bad.sum())} bad values",
        )
    return cells.astype(np.int8, copy=False).reshape(height, width)


def _yaw(q: Any) -> float:
    """The angle of a rotation about z, radians in -pi..pi."""
    x, y, z, w = (float(getattr(q, part)) for part in "xyzw")
    field, text = "info.origin.orientation", f"({x:g}, {y:g}, {z:g}, {w:g})"
    if x == y == z == w == 0.0:
        return 0.0
    length = math.hypot(x, y, z, w)
    # Written so that NaN fails.
    if not abs(length - 1.0) <= _LENGTH_TOLERANCE:
        problem = f"{text} must be a quaternion (x, y, z, w) of length 1, its length is {length:.4g}"
        raise BadMessage(field, problem)
    if 2.0 * math.asin(min(math.hypot(x, y) / length, 1.0)) > _TILT_TOLERANCE:
        problem = f"{text} must be a rotation about z, but leans out of the plane; a map must lie flat"
        raise BadMessage(field, problem)
    return 2.0 * math.atan2(z if w >= 0 else -z, abs(w))
