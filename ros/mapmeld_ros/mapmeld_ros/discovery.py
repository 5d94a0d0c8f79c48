"""Which topics are robots' maps."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

MAP_TYPE = "nav_msgs/msg/OccupancyGrid"
TF_TYPE = "tf2_msgs/msg/TFMessage"

ROOT = "/"
"""The name of a robot whose map topic has no namespace."""


def find_robots(
    topics: Iterable[tuple[str, Sequence[str]]],
    robot_map_topic: str,
    robot_namespace: str,
    own_topics: Collection[str],
) -> dict[str, str]:
    """Robot name to map topic, of the topics (name, types) that there are, sorted by name.

    A robot's topic has the type of maps, ends in robot_map_topic and contains robot_namespace; own_topics are
    what this node publishes. A robot is called like the namespace of its topic.
    """
    ending = "/" + robot_map_topic.strip("/")
    found = {
        robot_name(topic.removesuffix(ending)): topic
        for topic, types in topics
        if MAP_TYPE in types
        and topic.endswith(ending)
        and robot_namespace in topic
        and topic not in own_topics
    }
    return dict(sorted(found.items()))


def robot_name(namespace: str) -> str:
    """The name of the robot in a namespace: without the leading slash."""
    return namespace.strip("/") or ROOT


def in_namespace(robot: str, name: str) -> str:
    """The absolute name of a topic or parameter in a robot's namespace."""
    return f"/{name.strip('/')}" if robot == ROOT else f"/{robot}/{name.strip('/')}"


def with_own_tf(topics: Iterable[tuple[str, Sequence[str]]], robots: Iterable[str]) -> set[str]:
    """The robots whose namespace has a tf topic of its own."""
    transforms = {topic for topic, types in topics if TF_TYPE in types}
    return {
        robot
        for robot in robots
        if robot != ROOT and transforms & {in_namespace(robot, "tf"), in_namespace(robot, "tf_static")}
    }
