"""The result as messages: an estimate and what the node knows of the robots."""

from __future__ import annotations

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from mapmeld_msgs.msg import MergeComponent, MergeEstimate, RobotPlacement

from mapmeld import Estimate
from mapmeld.estimate import RobotEstimate
from mapmeld_ros.components import Named, topic_of
from mapmeld_ros.conversions import pose_message, pose_with_covariance
from mapmeld_ros.robots import Robot

WAITING = "waiting"
"""Status of a robot that no estimate has seen yet."""


def estimate_message(
    estimate: Estimate,
    robots: Sequence[Robot],
    names: Sequence[Named],
    topic: str,
    world_frame: str,
    stamp: Time,
) -> MergeEstimate:
    """The estimate, with every robot that is known: those that it has not seen wait.

    names: of the estimate's components. topic: of the merged map.
    """
    msg = MergeEstimate()
    msg.header.frame_id = world_frame
    msg.header.stamp = stamp
    seen = {r.name: r for r in estimate.robots}
    msg.robots = [_placement(robot, seen.get(robot.name), names) for robot in robots]
    msg.components = [
        MergeComponent(
            robots=list(component.names),
            is_world=component.is_world,
            frame=named.frame,
            map_topic=topic_of(topic, named.number),
        )
        for component, named in zip(estimate.components, names, strict=True)
    ]
    msg.registered_pairs = estimate.registered_pairs
    msg.seconds = estimate.seconds
    return msg


def waiting_reason(robot: Robot) -> str:
    """Why no estimate has seen a robot."""
    if robot.bad:
        return f"no good map yet: {robot.bad}"
    return "no map received yet" if robot.grid is None else "its map awaits the next estimate"


def _placement(robot: Robot, seen: RobotEstimate | None, names: Sequence[Named]) -> RobotPlacement:
    msg = RobotPlacement(robot=robot.name, map_frame=robot.frame, map_stamp=robot.stamp, component=-1)
    if seen is None:
        msg.status, msg.reason = WAITING, waiting_reason(robot)
        return msg
    msg.status, msg.reason = seen.status, seen.reason
    msg.probability = float(seen.probability)
    msg.placements = seen.placements
    if seen.component is not None and seen.T_world_map is not None:
        msg.component = seen.component
        msg.component_frame = names[seen.component].frame
        msg.has_pose = True
        msg.pose = pose_with_covariance(seen.T_world_map, seen.covariance)
    if seen.runner_up is not None:
        msg.has_runner_up = True
        msg.runner_up_pose = pose_message(seen.runner_up.T_world_map)
        msg.runner_up_frame = names[seen.runner_up.component].frame
        msg.runner_up_probability = float(seen.runner_up.probability)
    return msg
