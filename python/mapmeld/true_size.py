"""Maps that others say are larger or smaller than they state: a wrong resolution, or wheels that slip."""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from mapmeld.result import Pair

LEAST = 0.02
"""Change of size from which a map is told of, chosen by hand. Nine of ten recorded pairs of laser maps differ
by less than half a percent, those of hand-held scanners, which are bent, by less than three
(benchmarks/true_size.py)."""
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
    """Maps that most of the pairs that tell of their size would have larger, or smaller, most doubted first.

    Of two maps the second: what is given first is most often what the rest is held against.
    """
    told: dict[str, list[_Word]] = {}
    for p in pairs:
        if p.scale is None or p.scale_deviation is None:
            continue
        change, deviation = math.log(p.scale), p.scale_deviation / p.scale
        doubts = abs(change) > LEAST and abs(change) > _SURE * deviation
        told.setdefault(p.a, []).append(_Word(p.b, -change, doubts))
        told.setdefault(p.b, []).append(_Word(p.a, change, doubts))
    found: dict[str, WrongSize] = {}
    while True:
        doubted = {name: _agreeing(of, found) for name, of in told.items() if name not in found}
        most = {name: words for name, words in doubted.items() if 2 * len(words) > len(told[name])}
        if not most:
            return list(found.values())
        # The last of equals.
        name = max(reversed(most), key=lambda n: (len(most[n]), len(most[n]) / len(told[n])))
        change = statistics.median(w.change for w in most[name])
        found[name] = WrongSize(name, math.exp(change), tuple(w.other for w in most[name]))


@dataclass(frozen=True)
class _Word:
    """What a pair says of the size of one of its maps. change: of the logarithm of its size, seen from the
    other; doubts: whether that is too much to be chance."""

    other: str
    change: float
    doubts: bool


def _agreeing(words: Sequence[_Word], explained: Collection[str]) -> list[_Word]:
    """Those that doubt a size and agree whether it is too small or too large; others that are of a wrong size
    themselves say nothing."""
    doubting = [w for w in words if w.doubts and w.other not in explained]
    larger, smaller = ([w for w in doubting if w.change * sign > 0] for sign in (1, -1))
    return max(larger, smaller, key=len)
