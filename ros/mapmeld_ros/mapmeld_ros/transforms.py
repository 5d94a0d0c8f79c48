"""The TF tree: which transform goes to which topic, and that no frame gets two parents."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mapmeld_ros.conversions import Vector
from mapmeld_ros.discovery import in_namespace
from mapmeld_ros.qos import ALL_LATCHED

Key = tuple[str, str, tuple[float, ...]]
"""Parent, child, and the numbers between them."""


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


class Others:
    """Static transforms that somebody else publishes in the global tree: their frames have a parent."""

    def __init__(self) -> None:
        # The newest is what stands; those before it may still wait in the subscription's queue.
        self._recent: deque[frozenset[Key]] = deque(maxlen=ALL_LATCHED.depth)
        self._own: frozenset[Key] = frozenset()
        self._parents: dict[str, str] = {}
        self._heard_again: dict[str, str] | None = None

    def publish(self, msg: TFMessage) -> None:
        """Notes what this node publishes, so that it is not taken for somebody else's when it is heard."""
        self._recent.append(frozenset(_key(t) for t in msg.transforms))
        # In one step: another thread may be hearing.
        self._own = frozenset().union(*self._recent)

    def hear(self, msg: TFMessage) -> bool:
        """Notes what is published; whether there is something new of somebody else."""
        found = {t.child_frame_id: t.header.frame_id for t in msg.transforms if _key(t) not in self._own}
        is_new = not found.items() <= self._parents.items()
        self._parents = self._parents | found
        if self._heard_again is not None:
            self._heard_again |= found
        return is_new

    def listen_again(self) -> None:
        """All that stands is about to be heard once more, see forget."""
        self._heard_again = {}

    def forget(self) -> bool:
        """Forgets what has not been heard since listen_again; whether there was such."""
        if self._heard_again is None:
            return False
        had, self._parents, self._heard_again = self._parents, self._heard_again, None
        return had != self._parents

    def parent_of(self, frame: str) -> str | None:
        return self._parents.get(frame)


def _key(t: TransformStamped) -> Key:
    v, r = t.transform.translation, t.transform.rotation
    return t.header.frame_id, t.child_frame_id, (v.x, v.y, v.z, r.x, r.y, r.z, r.w)


def link(robot: str, parent: str, map_frame: str, T_parent_map: Vector, has_own_tf: bool) -> Link:
    x, y, theta = (float(v) for v in T_parent_map)
    return Link(robot, parent, map_frame.lstrip("/"), (x, y, theta), has_own_tf)


def plan(links: Iterable[Link], topic: str, parents: Sequence[str], others: Others) -> Plan:
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
        elif not one.has_own_tf and (foreign := others.parent_of(one.map_frame)) is not None:
            problems[one.robot] = (
                f"somebody else publishes a static transform from {foreign!r} to its map frame "
                f"{one.map_frame!r}; stop that, or set publish_tf to off"
            )
        elif one.map_frame in taken:
            problems[one.robot] = (
                f"its map frame {one.map_frame!r} is also that of {taken[one.map_frame]!r}; "
                "prefix the frames, or let each robot have its own /<robot>/tf"
            )
        else:
            topics.setdefault(name, []).append(one)
    return Plan({name: tuple(some) for name, some in topics.items()}, problems)
