"""Pairs of maps that a merge has elsewhere than their own walls say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.one_place import Pose, apart
from mapmeld.result import MergeResult, Pair

ELSEWHERE = (1.0, math.radians(10.0))
"""Metres in the middle of the merged map, and radians, from which on that is told of."""


@dataclass(frozen=True)
class Contradiction:
    """Two maps that alone would be merged, with some probability, so far from where they are in one
    component: metres and radians."""

    a: str
    b: str
    probability: float
    metres: float
    radians: float

    def __str__(self) -> str:
        return (
            f"{self.a} and {self.b} lie {self.metres:.1f} m and {math.degrees(self.radians):.0f} degrees "
            "from where the walls of these two alone would have them "
            f"(probability {self.probability:.2f}): either something else that holds them is wrong, or their "
            "walls match at a place that looks alike"
        )


def displaced(
    pair: Pair, name: str, poses: Mapping[str, Pose], middle: Sequence[float]
) -> tuple[float, float]:
    """How far a map of a pair lies from where their walls alone would have it beside the other: metres at its
    middle, and radians. poses: of both in one frame."""
    other = pair.b if pair.a == name else pair.a
    T_a_b = pair.modes[0].T_a_b
    T_other_map = se2.inverse(T_a_b) if pair.a == name else T_a_b
    return apart(poses[name], se2.compose(poses[other], T_other_map), middle)


def contradictions(result: MergeResult) -> list[Contradiction]:
    """The contradictions of a result, the surest first."""
    placed = {m.name: m for m in result.maps}
    poses = {m.name: m.T_component_map for m in result.maps if m.T_component_map is not None}
    found = []
    for pair in (p for p in result.pairs if p.status == "merged"):
        a, b = placed[pair.a], placed[pair.b]
        merged = None if a.component != b.component else result.components[a.component].merged
        if merged is None or a.name not in poses or b.name not in poses:
            continue
        half = 0.5 * merged.resolution * np.array([merged.width, merged.height])
        middle = se2.apply(se2.inverse(poses[b.name]), se2.apply(np.array(merged.origin), half))
        metres, radians = displaced(pair, b.name, poses, middle.tolist())
        if metres > ELSEWHERE[0] or radians > ELSEWHERE[1]:
            found.append(Contradiction(a.name, b.name, pair.probability, metres, radians))
    return sorted(found, key=lambda c: -c.probability)
