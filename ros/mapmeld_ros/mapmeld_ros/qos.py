"""Quality of service: what the node publishes with, and how it subscribes so that every publisher is heard.

A subscription that asks for the last message (transient_local) is not matched with a publisher that keeps
none (volatile), and one that does not ask never gets a map that was published before it came. So the node
asks each topic's publishers what they offer.
"""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

Offer = tuple[ReliabilityPolicy, DurabilityPolicy]

_RELIABLE, _BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
_LATCHED, _VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE

LATCHED = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=_RELIABLE, durability=_LATCHED)
"""Merged maps, estimates and static transforms: whoever comes late gets the newest one."""

ALL_LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=100, reliability=_RELIABLE, durability=_LATCHED
)
"""For listening to a topic on which several publishers have latched messages."""


def requests(offers: Iterable[Offer]) -> tuple[Offer, ...]:
    """What to subscribe with so that every one of these publishers is matched, most demanding first.

    Nearly always one; two when publishers of one topic differ. A topic without publishers is none.
    """
    wanted = {
        (
            _RELIABLE if reliability == _RELIABLE else _BEST_EFFORT,
            _LATCHED if durability == _LATCHED else _VOLATILE,
        )
        for reliability, durability in offers
    }
    return tuple(sorted(wanted, key=lambda offer: (offer[1] != _LATCHED, offer[0] != _RELIABLE)))


def profile(offer: Offer, depth: int) -> QoSProfile:
    """A subscription's profile."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=offer[0], durability=offer[1])


def described(offer: Offer) -> str:
    """The offer in the words of ROS: "reliable, transient_local"."""
    return f"{offer[0].name.lower()}, {offer[1].name.lower()}"
