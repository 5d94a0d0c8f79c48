"""How the components of an estimate are called outside: which topic and which frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mapmeld import Estimate
from mapmeld_ros.discovery import ROOT


@dataclass(frozen=True)
class Named:
    """A component. number: 1 is published on the merged map's topic, n on that topic with _n. frame: its
    frame."""

    number: int
    frame: str


def frame_of(world_frame: str, anchor: str, is_world: bool) -> str:
    """The frame of a component: the world, or one that is called after the robot whose map defines it."""
    if is_world:
        return world_frame
    return f"{world_frame}_{'root' if anchor == ROOT else anchor.replace('/', '_')}"


def topic_of(merged_map_topic: str, number: int) -> str:
    """The topic of a component's merged map."""
    return merged_map_topic if number == 1 else f"{merged_map_topic}_{number}"


class ComponentNames:
    """Names components: the largest is number 1, the others keep their numbers from estimate to estimate."""

    def __init__(self, world_frame: str) -> None:
        self._world_frame = world_frame
        self._known: dict[int, frozenset[str]] = {}
        self._frames: dict[str, str] = {}

    def name(self, estimate: Estimate) -> tuple[Named, ...]:
        """A name for every component, in their order."""
        numbers = self._numbers([frozenset(c.names) for c in estimate.components])
        return tuple(
            Named(n, self._world_frame if c.is_world else self._frame(c.anchor))
            for n, c in zip(numbers, estimate.components, strict=True)
        )

    def _frame(self, anchor: str) -> str:
        """One that no other robot has: a/b and a_b would have the same."""
        if anchor not in self._frames:
            frame = wanted = frame_of(self._world_frame, anchor, False)
            taken, k = set(self._frames.values()), 2
            while frame in taken:
                frame, k = f"{wanted}_{k}", k + 1
            self._frames[anchor] = frame
        return self._frames[anchor]

    def _numbers(self, components: Sequence[frozenset[str]]) -> list[int]:
        numbers: list[int] = []
        for k, names in enumerate(components):
            if k == 0:
                numbers.append(1)
                continue
            # The number of the earlier component that shares most robots with this one, where it is free.
            earlier = [
                (len(names & known), -n) for n, known in self._known.items() if n > 1 and n not in numbers
            ]
            shared, minus = max(earlier, default=(0, 0))
            numbers.append(-minus if shared else 0)
        for k, number in enumerate(numbers):
            if number == 0:
                numbers[k] = next(n for n in range(2, len(numbers) + 2) if n not in numbers)
        self._known = dict(zip(numbers, components, strict=True))
        return numbers
