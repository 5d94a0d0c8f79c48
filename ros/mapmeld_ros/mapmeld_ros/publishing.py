"""Everything that the node publishes."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from mapmeld_msgs.msg import MergeEstimate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from mapmeld import OccupancyGrid
from mapmeld_ros.components import Named, topic_of
from mapmeld_ros.conversions import grid_to_message, transform_message
from mapmeld_ros.qos import LATCHED
from mapmeld_ros.transforms import Others, Plan

# What tf2's listeners are made for.
_TF_QOS = QoSProfile(depth=100)


class Publishing:
    """The merged maps, the transforms, the estimate and the diagnostics. Threads may share it."""

    def __init__(self, node: Node, merged_map_topic: str, is_tf_static: bool) -> None:
        self._node = node
        self._topic = merged_map_topic
        self._is_tf_static = is_tf_static
        self._lock = threading.Lock()
        self._maps: dict[int, Publisher[OccupancyGridMsg]] = {}
        self._transforms: dict[str, Publisher[TFMessage]] = {}
        self._plan = Plan({}, {})
        self.others = Others()
        """What others publish on /tf_static."""
        self._estimate = node.create_publisher(MergeEstimate, "~/estimate", LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        # Whoever looks for the merged map finds its topic before there is one.
        self._map_publisher(1)

    def own_map_topics(self) -> set[str]:
        """The merged maps' topics in full."""
        with self._lock:
            return {publisher.topic_name for publisher in self._maps.values()}

    def maps(self, changed: Sequence[tuple[Named, OccupancyGrid]], numbers: set[int], stamp: Time) -> None:
        """Publishes merged maps. numbers: of all there are now; a topic without a map goes, but for the
        first."""
        with self._lock:
            for number in set(self._maps) - numbers - {1}:
                self._node.destroy_publisher(self._maps.pop(number))
            for named, grid in changed:
                self._map_publisher(named.number).publish(grid_to_message(grid, named.frame, stamp))

    def transforms(self, plan: Plan, stamp: Time) -> None:
        """Publishes the transforms; static ones only when they have changed."""
        with self._lock:
            self._send(plan, stamp)

    def again(self, stamp: Time) -> None:
        """Publishes transforms that are not static once more, with a new stamp."""
        with self._lock:
            if not self._is_tf_static:
                self._send(self._plan, stamp)

    def estimate(self, msg: MergeEstimate) -> None:
        self._estimate.publish(msg)

    def diagnostics(self, msg: DiagnosticArray) -> None:
        self._diagnostics.publish(msg)

    def close(self) -> None:
        with self._lock:
            for publisher in (
                *self._maps.values(),
                *self._transforms.values(),
                self._estimate,
                self._diagnostics,
            ):
                self._node.destroy_publisher(publisher)
            self._maps.clear()
            self._transforms.clear()

    def _send(self, plan: Plan, stamp: Time) -> None:
        for topic in {*plan.topics, *self._transforms}:
            links = plan.topics.get(topic, ())
            if self._is_tf_static and links == self._plan.topics.get(topic, ()):
                continue
            if topic not in self._transforms:
                qos = LATCHED if self._is_tf_static else _TF_QOS
                self._transforms[topic] = self._node.create_publisher(TFMessage, topic, qos)
            msg = TFMessage(
                transforms=[
                    transform_message(one.T_parent_map, one.parent, one.map_frame, stamp) for one in links
                ]
            )
            if topic == "/tf_static":
                self.others.publish(msg)
            self._transforms[topic].publish(msg)
        self._plan = plan

    def _map_publisher(self, number: int) -> Publisher[OccupancyGridMsg]:
        if number not in self._maps:
            topic = topic_of(self._topic, number)
            self._maps[number] = self._node.create_publisher(OccupancyGridMsg, topic, LATCHED)
        return self._maps[number]
