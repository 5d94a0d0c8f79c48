"""Who else publishes on the merged maps' topics."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from rclpy.node import Node


class ForeignPublishers:
    """Tells of each other node that publishes on one of this node's topics once, for as long as it does."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._own = f"{node.get_namespace().rstrip('/')}/{node.get_name()}"
        self._told: set[tuple[str, str]] = set()

    def new(self, topics: Collection[str]) -> Iterator[str]:
        """A sentence for each that was not there at the last call."""
        found = {(topic, name) for topic in topics for name in self._others(topic)}
        for topic, name in sorted(found - self._told):
            yield (
                f"{topic}: node {name!r} publishes there too, and who listens gets its maps "
                "and the merged ones mixed; set merged_map_topic, or rename the topic of the other"
            )
        self._told = found

    def _others(self, topic: str) -> set[str]:
        publishers = self._node.get_publishers_info_by_topic(topic)
        names = [f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in publishers]
        # Of a publisher that has just come the graph may not know the node yet.
        others = {n for n in names if n != self._own and "_UNKNOWN_" not in n}
        return others | ({self._own} if names.count(self._own) > 1 else set())
