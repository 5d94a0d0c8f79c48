"""The node's parameters: names, defaults, ranges and descriptions, each written once."""

from __future__ import annotations

import dataclasses
import difflib
import re
from dataclasses import dataclass, field
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node

from mapmeld_ros.known_poses import AXES, SIGMAS

_POSE_PARTS = (*AXES, *SIGMAS)
_KNOWN_POSE = re.compile(rf"(/[^/]+)*/map_merge/init_pose_({'|'.join(_POSE_PARTS)})")
# Parameters that every node has.
_ROS_OWN = frozenset({"use_sim_time", "start_type_description_service"})

TF_MODES = ("static", "dynamic", "off")
TF_NAMESPACES = ("auto", "always", "never")


def _parameter(
    default: Any,
    description: str,
    *,
    between: tuple[float, float] | None = None,
    one_of: tuple[str, ...] | None = None,
    is_live: bool = False,
) -> Any:
    return field(
        default=default,
        metadata={"description": description, "between": between, "one_of": one_of, "is_live": is_live},
    )


@dataclass(frozen=True)
class Parameters:
    """The values of all parameters. The first ten are multirobot_map_merge's, names and defaults alike."""

    merging_rate: float = _parameter(
        4.0, "Most merged maps a second, Hz.", between=(0.01, 100.0), is_live=True
    )
    discovery_rate: float = _parameter(
        0.05, "How often new robots are looked for, Hz.", between=(0.001, 100.0), is_live=True
    )
    estimation_rate: float = _parameter(
        0.5, "Most estimates of the robots' places a second, Hz.", between=(0.001, 100.0), is_live=True
    )
    known_init_poses: bool = _parameter(
        True,
        "Whether /<robot>/map_merge/init_pose_* place the robots that have them; others are estimated.",
    )
    estimation_confidence: float = _parameter(
        1.0,
        "How sure a link must be. 1: as Mapmeld has it (0.98 while maps grow, 0.75 when they are done); "
        "at c the doubt that is left is taken to the power of c.",
        between=(0.0, 10.0),
    )
    robot_map_topic: str = _parameter("map", "Name of the robots' map topics below their namespaces.")
    robot_map_updates_topic: str = _parameter(
        "map_updates", "Name of the robots' map update topics below their namespaces."
    )
    robot_namespace: str = _parameter("", "Only topics whose name contains this belong to robots.")
    merged_map_topic: str = _parameter("map", "Topic of the merged map.")
    world_frame: str = _parameter("world", "Frame of the merged map, parent of the robots' map frames.")

    legacy_init_poses: bool = _parameter(
        False,
        "Whether init_pose_* are taken as multirobot_map_merge's code takes them, against its documentation: "
        "in cells, inverted, about the corner of the robot's grid.",
    )
    init_pose_sigma_xy: float = _parameter(
        0.0,
        "Standard deviation of known positions, metres. 0, here or in yaw: they are taken as given.",
        between=(0.0, 1000.0),
    )
    init_pose_sigma_yaw: float = _parameter(
        0.0,
        "Standard deviation of known yaws, radians. 0, here or in xy: they are taken as given.",
        between=(0.0, 3.15),
    )
    robot_timeout: float = _parameter(
        0.0,
        "Seconds without a map and without a publisher after which a robot leaves. 0: its last map stays.",
        between=(0.0, 1e9),
        is_live=True,
    )
    quiet_time: float = _parameter(
        20.0,
        "Seconds without a changed map after which the maps count as done: a new link then needs the "
        "probability of a merge, and not that of one while maps grow. 0: never.",
        between=(0.0, 1e9),
        is_live=True,
    )
    estimation_timeout: float = _parameter(
        10.0,
        "Age in seconds from which a running estimate is given up when newer maps have come.",
        between=(0.1, 3600.0),
        is_live=True,
    )
    max_map_cells: int = _parameter(
        64_000_000, "Maps of more cells than this are refused.", between=(1, 2_000_000_000)
    )
    publish_tf: str = _parameter(
        "static", "Where world -> map is published: static (/tf_static), dynamic (/tf), off.", one_of=TF_MODES
    )
    tf_namespaces: str = _parameter(
        "auto",
        "Whether a robot's transform goes to /<robot>/tf(_static): auto (if it has one), always, never.",
        one_of=TF_NAMESPACES,
    )
    config_file: str = _parameter("", "YAML file with options of the merge itself; empty: the defaults.")
    autostart: bool = _parameter(
        True, "Whether the node configures and activates itself; false leaves that to a lifecycle manager."
    )


LIVE = frozenset(f.name for f in dataclasses.fields(Parameters) if f.metadata["is_live"])
"""Names of those that may change while the node is configured."""


def descriptor(name: str) -> ParameterDescriptor:
    """What `ros2 param describe` shows; the ranges are enforced."""
    parameter = Parameters.__dataclass_fields__[name]
    result = ParameterDescriptor(name=name, description=parameter.metadata["description"])
    between, one_of = parameter.metadata["between"], parameter.metadata["one_of"]
    if between is not None and isinstance(parameter.default, float):
        result.floating_point_range = [
            FloatingPointRange(from_value=between[0], to_value=between[1], step=0.0)
        ]
    elif between is not None:
        result.integer_range = [IntegerRange(from_value=int(between[0]), to_value=int(between[1]), step=1)]
    if one_of is not None:
        result.additional_constraints = f"one of {', '.join(one_of)}"
    return result


def declare(node: Node) -> Parameters:
    """Declares all parameters and returns their values.

    Raises what rclpy raises for a value out of range, and ValueError for an integer where a double belongs.
    """
    for parameter in dataclasses.fields(Parameters):
        try:
            node.declare_parameter(parameter.name, parameter.default, descriptor(parameter.name))
        except InvalidParameterTypeException as error:
            found = re.search(r"to '(-?\d+)' of type 'INTEGER'", str(error))
            if found is None or not isinstance(parameter.default, float):
                raise
            raise ValueError(
                f"parameter {parameter.name}: takes a double; write {found[1]}.0 instead of {found[1]}"
            ) from None
    return read(node)


def read(node: Node) -> Parameters:
    """The values that the node has now."""
    names = [f.name for f in dataclasses.fields(Parameters)]
    return Parameters(**{name: node.get_parameter(name).value for name in names})


def unknown(name: str) -> str:
    """What to say of a parameter that the node never reads; empty for one that it knows."""
    known = [f.name for f in dataclasses.fields(Parameters)]
    if name in known or name.startswith("qos_overrides.") or name in _ROS_OWN or _KNOWN_POSE.fullmatch(name):
        return ""
    robot, separator, _ = name.rpartition("/map_merge/init_pose_")
    if separator:
        meant = [f"/{robot.strip('/')}{separator}{w}" if robot else f"{separator}{w}" for w in _POSE_PARTS]
    else:
        meant = known
    near = difflib.get_close_matches(name, meant, 1)
    return f"parameter {name}: is not known and has no effect" + (f"; is {near[0]} meant?" if near else "")


def problem(name: str, value: Any) -> str:
    """Why a value cannot be taken, beyond what the descriptor enforces; empty when it can."""
    known = Parameters.__dataclass_fields__.get(name)
    if known is None:
        return ""
    one_of = known.metadata["one_of"]
    if one_of is not None and value not in one_of:
        return f"{name}: {value!r} is not one of {', '.join(one_of)}"
    if name in ("robot_map_topic", "merged_map_topic", "world_frame") and not str(value).strip("/ "):
        return f"{name}: must not be empty"
    return ""
