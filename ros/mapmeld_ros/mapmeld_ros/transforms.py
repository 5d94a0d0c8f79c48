"""The TF tree: which transform goes to which topic, and that no frame gets two parents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mapmeld_ros.conversions import Vector
from mapmeld_ros.discovery import in_namespace


@dataclass(frozen=True)
class Link:
    """A robot's map frame at T_parent_map in the frame of its component.

    has_own_tf: whether the robot's transforms live in its namespace and not in the global tree.
    """

    robot: str
    parent: str
    map_frame: str
    T_parent_map: tuple[float, float, float]
    has_own_tf: bool


@dataclass(frozen=True)
class Plan:
    """What to publish, topic to links, and what cannot be, robot to reason."""

    topics: dict[str, tuple[Link, ...]]
    problems: dict[str, str]


def link(robot: str, parent: str, map_frame: str, T_parent_map: Vector, has_own_tf: bool) -> Link:
    x, y, theta = (float(v) for v in T_parent_map)
    return Link(robot, parent, map_frame.lstrip("/"), (x, y, theta), has_own_tf)


def plan(links: Iterable[Link], topic: str, parents: Sequence[str]) -> Plan:
    """Sorts links onto the topic called `topic` ("tf" or "tf_static"), global or in the robots' namespaces.

    parents: the frames of all components, which can be no robot's map frame. A frame that two robots of one
    topic claim goes to the first.
    """
    topics: dict[str, list[Link]] = {}
    problems: dict[str, str] = {}
    for one in links:
        name = in_namespace(one.robot, topic) if one.has_own_tf else f"/{topic}"
        taken = {other.map_frame: other.robot for other in topics.get(name, [])}
        if not one.map_frame:
            problems[one.robot] = "its map has no frame_id, so there is no transform to it"
        elif one.map_frame in parents:
            problems[one.robot] = (
                f"its map frame is called {one.map_frame!r} like the merged map's; "
                "give the parameter world_frame another value"
            )
        elif one.map_frame in taken:
            problems[one.robot] = (
                f"its map frame {one.map_frame!r} is also that of {taken[one.map_frame]!r}; "
                "prefix the frames, or let each robot have its own /<robot>/tf"
            )
        else:
            topics.setdefault(name, []).append(one)
    return Plan({name: tuple(some) for name, some in topics.items()}, problems)
