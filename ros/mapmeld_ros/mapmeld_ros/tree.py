"""The TF tree as the graph has it: what to publish where, and what others publish."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from tf2_msgs.msg import TFMessage

from mapmeld_ros.discovery import TF_TYPE, with_own_tf
from mapmeld_ros.publishing import Publishing
from mapmeld_ros.qos import ALL_LATCHED
from mapmeld_ros.session import Known, MergeSession
from mapmeld_ros.transforms import Link, link, plan

if TYPE_CHECKING:
    from mapmeld_ros.node import MapMerge

# In which a new subscription hears what is latched, on a network too.
_HEAR_AGAIN_SECONDS = 1.0

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
        # What is published is what was known last, whichever thread publishes.
        self._lock = threading.Lock()
        self._sources: set[bytes] = set()
        # What was heard before a pause may be gone.
        publishing.others.listen_again()
        self._forgets: float | None = time.monotonic() + _HEAR_AGAIN_SECONDS
        self._subscription = self._listen()
        self.problems: dict[str, str] = {}
        """Robots that get no transform, and why."""

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)

    def follow(self, topics: Topics) -> None:
        """Publishes anew when another robot has a tree of its own now, or a foreign transform has gone."""
        own = self._with_own_tf(topics)
        now = time.monotonic()
        sources = {bytes(p.endpoint_gid) for p in self._others("/tf_static")}
        if self._sources - sources:
            # Messages do not say whose they are. A new subscription hears those that are latched by the
            # publishers that are left.
            self._publishing.others.listen_again()
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._listen()
            self._forgets = now + _HEAR_AGAIN_SECONDS
        self._sources = sources
        has_forgotten = False
        if self._forgets is not None and (now >= self._forgets or not sources):
            self._forgets = None
            has_forgotten = self._publishing.others.forget()
        if own != self._own_tf or has_forgotten:
            self._own_tf = own
            self.publish()

    def publish(self) -> None:
        """Publishes what has changed."""
        mode = self._node.parameters.publish_tf
        if mode == "off":
            return
        topic = "tf_static" if mode == "static" else "tf"
        with self._lock:
            known = self._session.known
            frames = [named.frame for named in known.names]
            planned = plan(self._links(known), topic, frames, self._publishing.others)
            self._publishing.transforms(planned, self._node.stamp())
            self.problems = planned.problems
        for name, problem in planned.problems.items():
            self._warn(name, f"robot {name!r}: no transform: {problem}")

    def _links(self, known: Known) -> list[Link]:
        """Those of robots that joined first in front: a frame that two claim stays with the first."""
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
        others = [(name, types) for name, types in topics if TF_TYPE in types and self._others(name)]
        # A robot that had a tree of its own keeps it while its publishers restart.
        return self._own_tf & robots | with_own_tf(others, robots)

    def _others(self, topic: str) -> list[TopicEndpointInfo]:
        """Those publishers of a topic that are not this node's."""
        me = (self._node.get_namespace(), self._node.get_name())
        publishers = self._node.get_publishers_info_by_topic(topic)
        return [p for p in publishers if (p.node_namespace, p.node_name) != me]

    def _listen(self) -> Subscription[TFMessage]:
        return self._node.create_subscription(TFMessage, "/tf_static", self._hear, ALL_LATCHED)

    def _hear(self, msg: TFMessage) -> None:
        if self._publishing.others.hear(msg):
            self.publish()
