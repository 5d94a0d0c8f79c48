"""Poses of robots that are known beforehand, from the parameters /<robot>/map_merge/init_pose_*."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mapmeld import OccupancyGrid, se2
from mapmeld_ros.discovery import in_namespace

AXES = ("x", "y", "z", "yaw")
SIGMAS = ("sigma_xy", "sigma_yaw")


class BadKnownPose(Exception):
    """Parameters that make no pose; the message names them."""


@dataclass(frozen=True)
class KnownPose:
    """(x, y, yaw) in metres and radians; sigma: standard deviations of it, None for exact.

    doubt: what its parameters say that may not be meant; empty when nothing.
    """

    pose: tuple[float, float, float]
    sigma: tuple[float, float, float] | None
    doubt: str = ""


def parameter_name(robot: str, what: str) -> str:
    """What multirobot_map_merge calls the parameter: /robot1/map_merge/init_pose_x."""
    return in_namespace(robot, f"map_merge/init_pose_{what}")


def known_pose(robot: str, get: Callable[[str], Any], sigma_xy: float, sigma_yaw: float) -> KnownPose | None:
    """The known pose of a robot, None when it has none.

    get: the value of a parameter, None for one that is not set. sigma_xy, sigma_yaw: for a robot that has
    none of its own. Raises BadKnownPose when x, y or yaw is missing while another is there, for what is no
    number, and for a negative standard deviation.
    """
    values = {what: get(parameter_name(robot, what)) for what in (*AXES, *SIGMAS)}
    if all(values[axis] is None for axis in AXES):
        return None
    for what, value in values.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if value is None and what in ("x", "y", "yaw"):
            raise BadKnownPose(
                f"{parameter_name(robot, what)}: is missing; give x, y and yaw, or none of them"
            )
        if value is not None and not is_number:
            raise BadKnownPose(f"{parameter_name(robot, what)}: {value!r} is not a finite number")
        if value is not None and what in SIGMAS and value < 0:
            raise BadKnownPose(f"{parameter_name(robot, what)}: {value!r} is negative; 0 stands for exact")
    xy = sigma_xy if values["sigma_xy"] is None else float(values["sigma_xy"])
    yaw = sigma_yaw if values["sigma_yaw"] is None else float(values["sigma_yaw"])
    pose = (float(values["x"]), float(values["y"]), float(values["yaw"]))
    if xy > 0 and yaw > 0:
        return KnownPose(pose, (xy, xy, yaw))
    given, missing = ("sigma_xy", "sigma_yaw") if xy > 0 else ("sigma_yaw", "sigma_xy")
    if not (xy > 0 or yaw > 0):
        return KnownPose(pose, None)
    return KnownPose(
        pose,
        None,
        f"{parameter_name(robot, missing)}: is 0 while {given} is not, so the pose is taken as exact; "
        "set both, or neither",
    )


def legacy_pose(pose: tuple[float, float, float], grid: OccupancyGrid) -> tuple[float, float, float]:
    """T_world_map as multirobot_map_merge's code places a map.

    x and y count cells, the transform is inverted, and it moves the grid's lower left corner instead of the
    map's frame.
    """
    x, y, yaw = pose
    T_world_corner = se2.inverse((x * grid.resolution, y * grid.resolution, yaw))
    T = se2.compose(T_world_corner, se2.inverse(grid.origin))
    return float(T[0]), float(T[1]), float(T[2])
