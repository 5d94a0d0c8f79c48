"""`python -m mapmeld_ros.look`: what a running map_merge says in a few lines, without `ros2`."""

from __future__ import annotations

import argparse
import math
import sys
import time

import rclpy
from mapmeld_msgs.msg import MergeEstimate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from mapmeld_ros.qos import LATCHED


def main(args: list[str] | None = None) -> int:
    """Prints one estimate and its maps' sizes; 1 when none comes in time."""
    parser = argparse.ArgumentParser(prog="python -m mapmeld_ros.look", description=__doc__)
    parser.add_argument("--node", default="/map_merge", help="full name of the node (default: /map_merge)")
    parser.add_argument("--timeout", type=float, default=10.0, help="seconds to wait (default: 10)")
    options = parser.parse_args(args)
    context = Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("mapmeld_look", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        return _look(node, executor, f"/{options.node.strip('/')}/estimate", options.timeout)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 130
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _look(node: Node, executor: SingleThreadedExecutor, topic: str, timeout: float) -> int:
    end = time.monotonic() + timeout
    estimates: list[MergeEstimate] = []
    maps: dict[str, OccupancyGridMsg] = {}
    node.create_subscription(MergeEstimate, topic, estimates.append, LATCHED)
    while not estimates and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    if not estimates:
        print(
            f"{topic}: no estimate in {timeout:g} s. Is map_merge running and active, with the same "
            "ROS_DOMAIN_ID? Under another name or namespace: --node /namespace/map_merge",
            file=sys.stderr,
        )
        return 1
    estimate = estimates[0]
    topics = [c.map_topic for c in estimate.components if c.map_topic]
    for name in topics:
        node.create_subscription(
            OccupancyGridMsg, name, lambda msg, name=name: maps.__setitem__(name, msg), LATCHED
        )
    while len(maps) < len(topics) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    for line in described(estimate, maps):
        print(line)
    return 0


def described(estimate: MergeEstimate, maps: dict[str, OccupancyGridMsg]) -> list[str]:
    """The estimate in lines. maps: the merged maps by topic, as far as they came."""
    lines = [] if estimate.robots else ["no robot yet: no topic is a robot's map, or nobody publishes on it"]
    for r in estimate.robots:
        lines.append(f"{r.robot}: {r.status}, probability {r.probability:.2f}")
        if r.has_pose:
            p, q = r.pose.pose.position, r.pose.pose.orientation
            yaw = 2 * math.atan2(q.z, q.w)
            yaw = math.atan2(math.sin(yaw), math.cos(yaw))
            lines.append(f"  x {p.x:.2f} m, y {p.y:.2f} m, yaw {yaw:.3f} rad in {r.component_frame}")
        lines.append(f"  {r.reason}")
    for c in estimate.components:
        msg = maps.get(c.map_topic)
        size = (
            "no map yet"
            if msg is None
            else f"{msg.info.width} x {msg.info.height} cells of {msg.info.resolution:.3g} m"
        )
        lines.append(f"{c.map_topic} in {c.frame}: {size}, of {', '.join(c.robots)}")
    return lines


if __name__ == "__main__":
    sys.exit(main())
