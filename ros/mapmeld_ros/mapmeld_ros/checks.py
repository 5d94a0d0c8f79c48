"""What a map message must be before it is used; each failure names the field."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose, Quaternion
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from numpy.typing import NDArray

MAX_CELLS = 64_000_000
"""Largest number of cells of a robot's map that is used: 8000 x 8000, a square of 400 m at 5 cm."""

# As tf2 takes quaternions.
_NORM_TOLERANCE = 0.01
# What float32 arithmetic leaves of a tilt of zero, and a tilt that would bend a map by less than a cell.
_TILT_TOLERANCE = 0.01


class BadMessage(Exception):
    """A message that cannot be used. `field` is its path in the message, `problem` a phrase."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field = field
        self.problem = problem


def checked_size(msg: OccupancyGridMsg, max_cells: int = MAX_CELLS) -> tuple[int, int]:
    """(height, width) of a map whose data is as long as it says."""
    width, height = msg.info.width, msg.info.height
    for field, value in (("info.width", width), ("info.height", height)):
        if value == 0:
            raise BadMessage(field, "0, the grid is empty")
    if width * height > max_cells:
        raise BadMessage(
            "info.width",
            f"{width} x {height} cells are more than the {max_cells} that max_map_cells allows",
        )
    if len(msg.data) != width * height:
        raise BadMessage("data", f"{len(msg.data)} cells, width x height is {width} x {height}")
    return height, width


def checked_cells(data: array[int] | NDArray[Any], height: int, width: int) -> NDArray[np.int8]:
    """The cells of a message, shape (height, width), without a copy."""
    cells = np.frombuffer(data, dtype=np.int8).reshape(height, width)
    low, high = int(cells.min()), int(cells.max())
    if low < -1 or high > 100:
        raise BadMessage("data", f"values {low}..{high}, allowed are -1..100")
    return cells


def checked_resolution(value: float) -> float:
    """The side of a cell in metres. The message has a float32; 0.05 comes out as 0.05."""
    if not math.isfinite(value) or value <= 0:
        raise BadMessage("info.resolution", f"{value}, must be a positive number of metres")
    return float(str(np.float32(value)))


def checked_origin(pose: Pose) -> tuple[float, float, float]:
    """(x, y, theta) of a grid's origin."""
    for axis in ("x", "y"):
        value = getattr(pose.position, axis)
        if not math.isfinite(value):
            raise BadMessage(f"info.origin.position.{axis}", f"{value}, must be finite")
    return float(pose.position.x), float(pose.position.y), checked_yaw(pose.orientation)


def checked_yaw(q: Quaternion) -> float:
    """The rotation about z, radians, of a quaternion that has no other."""
    field = "info.origin.orientation"
    norm = math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2)
    if not math.isfinite(norm):
        raise BadMessage(field, f"({q.x}, {q.y}, {q.z}, {q.w}), must be finite")
    if abs(norm - 1.0) > _NORM_TOLERANCE:
        raise BadMessage(field, f"({q.x}, {q.y}, {q.z}, {q.w}) has the norm {norm:.4g}, must have 1")
    if math.hypot(q.x, q.y) > _TILT_TOLERANCE:
        raise BadMessage(field, f"({q.x}, {q.y}, {q.z}, {q.w}) tilts the map, only a yaw can be used")
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
