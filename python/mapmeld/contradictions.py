"""Pairs of maps that a merge has elsewhere than their own walls say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.one_place import apart
from mapmeld.result import MergeResult

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


def contradictions(result: MergeResult) -> list[Contradiction]:
    """The contradictions of a result, the surest first."""
    placed = {m.name: m for m in result.maps}
    found = []
    for pair in (p for p in result.pairs if p.status == "merged"):
        a, b = placed[pair.a], placed[pair.b]
        merged = None if a.component != b.component else result.components[a.component].merged
        if merged is None or a.T_component_map is None or b.T_component_map is None:
            continue
        T_a_b = se2.compose(se2.inverse(a.T_component_map), b.T_component_map)
        corner = np.array(merged.origin[:2])
        middle = corner + 0.5 * merged.resolution * np.array([merged.width, merged.height])
        metres, radians = apart(
            pair.modes[0].T_a_b, T_a_b, se2.apply(se2.inverse(b.T_component_map), middle).tolist()
        )
        if metres > ELSEWHERE[0] or radians > ELSEWHERE[1]:
            found.append(Contradiction(pair.a, pair.b, pair.probability, metres, radians))
    return sorted(found, key=lambda c: -c.probability)
