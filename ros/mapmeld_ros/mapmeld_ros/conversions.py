"""Messages to Mapmeld's values and back: pure functions."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseWithCovariance, TransformStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from numpy.typing import NDArray

from mapmeld import OccupancyGrid, grid_message
from mapmeld.grid_message import BadMessage

Vector = Sequence[float] | NDArray[np.float64]
"""(x, y, theta), metres and radians."""

MAX_CELLS = 64_000_000
"""Largest number of cells of a robot's map that is used: 8000 x 8000, a square of 400 m at 5 cm."""

# Where x, y and yaw stand in a 6 x 6 covariance of (x, y, z, roll, pitch, yaw).
_PLANAR = (0, 1, 5)


def grid_from_message(msg: OccupancyGridMsg, name: str, max_cells: int = MAX_CELLS) -> OccupancyGrid:
    """The grid in a message. Raises BadMessage, naming the field, for one that cannot be used."""
    width, height = msg.info.width, msg.info.height
    if width * height > max_cells:
        raise BadMessage(
            "info.width",
            f"{width} x {height} cells are more than the {max_cells} that max_map_cells allows",
        )
    return grid_message.grid_from_message(msg, name)


def grid_to_message(grid: OccupancyGrid, frame: str, stamp: Time) -> OccupancyGridMsg:
    """The grid as a message in `frame`."""
    msg = OccupancyGridMsg()
    msg.header.frame_id = frame
    msg.header.stamp = stamp
    msg.info.map_load_time = stamp
    msg.info.resolution = grid.resolution
    msg.info.width = grid.width
    msg.info.height = grid.height
    msg.info.origin = pose_message(grid.origin)
    # An array of type b is taken as it is; everything else is looked at cell by cell.
    msg.data = array("b", grid.data.tobytes())
    return msg


def pose_message(pose: Vector) -> Pose:
    """(x, y, theta) as a pose in the plane."""
    x, y, theta = (float(v) for v in pose)
    msg = Pose()
    msg.position.x, msg.position.y = x, y
    msg.orientation.z, msg.orientation.w = math.sin(theta / 2), math.cos(theta / 2)
    return msg


def pose_with_covariance(pose: Vector, covariance: NDArray[np.float64] | None) -> PoseWithCovariance:
    """(x, y, theta) and its 3 x 3 covariance; zeros where nothing varies or nothing is known."""
    full = np.zeros((6, 6))
    if covariance is not None:
        full[np.ix_(_PLANAR, _PLANAR)] = covariance
    return PoseWithCovariance(pose=pose_message(pose), covariance=full.reshape(36))


def transform_message(T_parent_child: Vector, parent: str, child: str, stamp: Time) -> TransformStamped:
    """The transform that takes coordinates of the frame `child` to the frame `parent`."""
    pose = pose_message(T_parent_child)
    msg = TransformStamped()
    msg.header.frame_id = parent
    msg.header.stamp = stamp
    msg.child_frame_id = child
    msg.transform.translation.x = pose.position.x
    msg.transform.translation.y = pose.position.y
    msg.transform.rotation = pose.orientation
    return msg
