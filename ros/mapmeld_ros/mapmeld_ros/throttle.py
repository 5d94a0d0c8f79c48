"""Warnings that come again and again are said once in a while."""

from __future__ import annotations

from collections.abc import Hashable

SECONDS = 10.0
"""How long a warning that was said is not said again."""


class Throttle:
    """Lets a key pass once in SECONDS; every key (a robot and a field, say) has a time of its own."""

    def __init__(self) -> None:
        self._said: dict[Hashable, float] = {}

    def passes(self, key: Hashable, now: float) -> bool:
        """Whether the key may pass at `now`, seconds of a steady clock."""
        said = self._said.get(key)
        if said is not None and now - said < SECONDS:
            return False
        self._said[key] = now
        return True
