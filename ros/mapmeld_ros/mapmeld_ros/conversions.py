"""Messages to Mapmeld's values and back: pure functions."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseWithCovariance, TransformStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from numpy.typing import NDArray

from mapmeld import OccupancyGrid
from mapmeld_ros.checks import (
    MAX_CELLS,
    BadMessage,
    checked_cells,
    checked_origin,
    checked_resolution,
    checked_size,
)

Vector = Sequence[float] | NDArray[np.float64]
"""(x, y, theta), metres and radians."""

# Where x, y and yaw stand in a 6 x 6 covariance of (x, y, z, roll, pitch, yaw).
_PLANAR = (0, 1, 5)


def grid_from_message(msg: OccupancyGridMsg, name: str, max_cells: int = MAX_CELLS) -> OccupancyGrid:
    """The grid in a message. Raises BadMessage, naming the field, for one that cannot be used."""
    height, width = checked_size(msg, max_cells)
    resolution = checked_resolution(msg.info.resolution)
    origin = checked_origin(msg.info.origin)
    return OccupancyGrid(checked_cells(msg.data, height, width), resolution, origin, name)


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


def apply_update(grid: OccupancyGrid, msg: OccupancyGridUpdate) -> OccupancyGrid:
    """The grid with the part that the update holds. Raises BadMessage for one that does not fit the grid."""
    for field, first, size, whole in (
        ("x", msg.x, msg.width, grid.width),
        ("y", msg.y, msg.height, grid.height),
    ):
        if first < 0 or first + size > whole:
            raise BadMessage(
                field,
                f"cells {first} to {first + size} do not lie in the map's 0 to {whole}; awaiting a whole map",
            )
    if len(msg.data) != msg.width * msg.height:
        raise BadMessage("data", f"{len(msg.data)} cells, width x height is {msg.width} x {msg.height}")
    if not msg.data:
        return grid
    cells = np.array(grid.data)
    part = checked_cells(msg.data, msg.height, msg.width)
    cells[msg.y : msg.y + msg.height, msg.x : msg.x + msg.width] = part
    return OccupancyGrid(cells, grid.resolution, grid.origin, grid.name)


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
