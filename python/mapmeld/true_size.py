"""Maps that others say are larger or smaller than they state: a wrong resolution, or wheels that slip."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mapmeld.result import Pair

LEAST = 0.02
"""Change of size from which a map is told of. Recorded laser maps of one building differ by half a percent at
most, bent ones of hand-held scanners by one, seldom by more than this."""
_SURE = 3.0
"""Standard deviations that it must be as well."""


@dataclass(frozen=True)
class WrongSize:
    """A map that would fit others better at another size. scale: times that it would have to be as large."""

    name: str
    scale: float
    others: tuple[str, ...]

    def __str__(self) -> str:
        named = ", ".join(self.others[:3]) + (", ..." if len(self.others) > 3 else "")
        return (
            f"map {self.name} would fit {named} better at {self.scale:.2f} times its size: the resolution of "
            "one of them is another than stated, or its odometry is off; what is merged is as wrong as that"
        )


def wrong_sizes(pairs: Sequence[Pair]) -> list[WrongSize]:
    """Maps whose size most of the pairs that tell of it doubt, the most doubted first; of two the second."""
    told: dict[str, list[tuple[str, float, bool]]] = {}
    for p in pairs:
        if p.scale is None or p.scale_deviation is None:
            continue
        change = math.log(p.scale)
        doubts = abs(change) > LEAST and abs(change) > _SURE * p.scale_deviation
        told.setdefault(p.a, []).append((p.b, -change, doubts))
        told.setdefault(p.b, []).append((p.a, change, doubts))
    found: list[WrongSize] = []
    while True:
        named = {w.name for w in found}
        doubted = Counter(
            name for name, of in told.items() for o, _, doubts in of if doubts and not {name, o} & named
        )
        # The last of equals: what is given first is most often what the rest is held against.
        name = max(reversed(doubted), key=lambda n: doubted[n], default=None)
        if name is None:
            return found
        change = statistics.median(c for _, c, _ in told[name])
        if abs(change) < LEAST or 2 * doubted[name] < len(told[name]):
            # Bent rather than of another size.
            told = {n: [(o, c, d and name not in (n, o)) for o, c, d in of] for n, of in told.items()}
            continue
        others = tuple(o for o, _, doubts in told[name] if doubts)
        found.append(WrongSize(name, math.exp(change), others))
