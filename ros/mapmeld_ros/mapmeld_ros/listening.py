"""Subscriptions to one robot's maps, which follow what its publishers offer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription

from mapmeld_ros.qos import Offer, described, profile, requests

# The newest map is all that counts, but no update may be missed.
_MAP_DEPTH, _UPDATE_DEPTH = 1, 50


class TopicListener:
    """Subscribes to a topic so that each of its publishers is heard, whatever it offers.

    on_mismatch: hears a sentence when a publisher came that the subscription does not match; the next
    follow() puts that right.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        kind: type,
        depth: int,
        callback: Callable[[Any], None],
        on_mismatch: Callable[[str], None],
    ) -> None:
        self._node, self._topic, self._kind, self._depth = node, topic, kind, depth
        self._callback, self._on_mismatch = callback, on_mismatch
        self._subscriptions: dict[Offer, Subscription[Any]] = {}

    def follow(self) -> int:
        """Subscribes as the topic's publishers need it now; how many publishers there are."""
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        offers = [(p.qos_profile.reliability, p.qos_profile.durability) for p in publishers]
        wanted = requests(offers)
        # Without publishers the subscription stays: whoever comes back is heard at once.
        if wanted:
            for offer in set(self._subscriptions) - set(wanted):
                self._node.destroy_subscription(self._subscriptions.pop(offer))
            for offer in wanted:
                if offer not in self._subscriptions:
                    self._subscriptions[offer] = self._subscribe(offer)
        return len(publishers)

    def close(self) -> None:
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _subscribe(self, offer: Offer) -> Subscription[Any]:
        def mismatch(event: Any) -> None:
            self._on_mismatch(
                f"{self._topic}: a publisher offers less than this subscription asks ({described(offer)}); "
                "subscribing anew as it offers"
            )

        return self._node.create_subscription(
            self._kind,
            self._topic,
            self._callback,
            profile(offer, self._depth),
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=mismatch, use_default_callbacks=False
            ),
        )


class RobotListener:
    """Both topics of one robot."""

    def __init__(
        self,
        node: Node,
        map_topic: str,
        updates_topic: str,
        on_map: Callable[[OccupancyGridMsg], None],
        on_update: Callable[[OccupancyGridUpdate], None],
        on_mismatch: Callable[[str], None],
    ) -> None:
        self._maps = TopicListener(node, map_topic, OccupancyGridMsg, _MAP_DEPTH, on_map, on_mismatch)
        self._updates = TopicListener(
            node, updates_topic, OccupancyGridUpdate, _UPDATE_DEPTH, on_update, on_mismatch
        )

    def follow(self) -> int:
        """Follows the publishers; how many of the map there are."""
        self._updates.follow()
        return self._maps.follow()

    def close(self) -> None:
        self._maps.close()
        self._updates.close()
