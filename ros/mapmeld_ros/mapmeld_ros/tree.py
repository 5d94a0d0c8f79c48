"""The TF tree as the graph has it: what to publish where, and what others publish."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from tf2_msgs.msg import TFMessage

from mapmeld_ros.discovery import TF_TYPE, with_own_tf
from mapmeld_ros.publishing import Publishing
from mapmeld_ros.qos import ALL_LATCHED
from mapmeld_ros.session import MergeSession
from mapmeld_ros.transforms import Link, link, plan

if TYPE_CHECKING:
    from mapmeld_ros.node import MapMerge

Topics = Sequence[tuple[str, Sequence[str]]]
"""Names and types of topics."""


class Tree:
    """Publishes world -> map frame of every robot, and listens for those who do the same.

    warn: hears (robot, sentence) for a robot that gets no transform.
    """

    def __init__(
        self,
        node: MapMerge,
        session: MergeSession,
        publishing: Publishing,
        warn: Callable[[str, str], None],
    ) -> None:
        self._node, self._session, self._publishing, self._warn = node, session, publishing, warn
        self._own_tf: set[str] = set()
        self._subscription = node.create_subscription(TFMessage, "/tf_static", self._hear, ALL_LATCHED)
        self.problems: dict[str, str] = {}
        """Robots that get no transform, and why."""

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)

    def follow(self, topics: Topics) -> None:
        """Publishes anew when another robot has a tree of its own now, or nobody else publishes any more."""
        own = self._with_own_tf(topics)
        is_alone = not self._is_of_others("/tf_static", [TF_TYPE])
        if own != self._own_tf or (is_alone and self._publishing.others.forget()):
            self._own_tf = own
            self.publish()

    def publish(self) -> None:
        """Publishes what has changed."""
        known, mode = self._session.known, self._node.parameters.publish_tf
        if mode == "off":
            return
        frames = [named.frame for named in known.names]
        topic = "tf_static" if mode == "static" else "tf"
        planned = plan(self._links(), topic, frames, self._publishing.others)
        self._publishing.transforms(planned, self._node.stamp())
        self.problems = planned.problems
        for name, problem in planned.problems.items():
            self._warn(name, f"robot {name!r}: no transform: {problem}")

    def _links(self) -> list[Link]:
        """Those of robots that joined first in front: a frame that two claim stays with the first."""
        known = self._session.known
        placed = {r.name: r for r in known.estimate.robots}
        links = []
        for robot in self._session.robots.all():
            seen = placed.get(robot.name)
            if seen is not None and seen.component is not None and seen.T_world_map is not None:
                parent = known.names[seen.component].frame
                has_own = robot.name in self._own_tf
                links.append(link(robot.name, parent, robot.frame, seen.T_world_map, has_own))
        return links

    def _with_own_tf(self, topics: Topics) -> set[str]:
        mode = self._node.parameters.tf_namespaces
        robots = {r.name for r in self._session.robots.all()}
        if mode != "auto":
            return robots if mode == "always" else set()
        others = [(name, types) for name, types in topics if self._is_of_others(name, types)]
        # A robot that had a tree of its own keeps it while its publishers restart.
        return self._own_tf & robots | with_own_tf(others, robots)

    def _is_of_others(self, topic: str, types: Sequence[str]) -> bool:
        """Whether somebody but this node publishes a transform topic."""
        me = (self._node.get_namespace(), self._node.get_name())
        return TF_TYPE in types and any(
            (p.node_namespace, p.node_name) != me for p in self._node.get_publishers_info_by_topic(topic)
        )

    def _hear(self, msg: TFMessage) -> None:
        if self._publishing.others.hear(msg):
            self.publish()
