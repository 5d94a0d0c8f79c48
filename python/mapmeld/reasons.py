"""Why a map stands where it stands, in one sentence with its numbers."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.one_place import is_one_place
from mapmeld.result import Hypothesis, Pair

LITTLE_WALL_M = 3.0
"""Metres of wall in common below which that is said to be lacking."""
FEW_IN_SECOND_DIRECTION = 0.1
"""Share of the hits in the weaker direction below which the walls are said to run one way only."""
MANY_CONFLICTS = 0.05
"""Share of contradicting walls above which they are said to contradict."""


def reason(
    name: str,
    status: str,
    placed: Mapping[str, NDArray[np.float64]],
    pairs: Sequence[Pair],
    hypotheses: Sequence[Hypothesis],
    centres: Mapping[str, Sequence[float]],
) -> str:
    """The sentence for the map of that name.

    placed: T_component_map of the maps in its component. pairs, hypotheses: those of the result; pairs of
        other maps may be left out. centres: of the known cells of each map, map coordinates, metres.
    """
    if status == "blank":
        return "it holds no known cell, so it is placed nowhere"
    if status == "prior":
        if len(placed) == 1:
            return "no other map lies in the world of its prior, which says nothing until one does"
        return "placed by its prior alone"
    every = [p for p in pairs if name in (p.a, p.b) and p.modes]
    own = [p for p in every if p.status != "forbidden"]
    if status == "merged":
        return _merged(name, [p for p in own if _is_told(p, placed, centres)])
    if status == "ambiguous":
        likely = _places(name, hypotheses, centres[name])
        if not likely:
            return (
                "it belongs to other maps, but no place among them is probable: matches contradict each other"
            )
        first, *others = [f"{p:.2f}" for p in likely[:3]]
        second = f", the next {' and '.join(others)}" if others else ""
        slides = "; the walls in common run nearly all in one direction" if _slides(own, centres) else ""
        likeliest = f"the likeliest one has {first}{second}{slides}"
        return f"it belongs to other maps, but its place is not sure: {likeliest}"
    if every and not own:
        return "the only maps whose walls fit its own are forbidden to match it"
    if not own:
        return "no wall of another map fits any of its walls" if pairs else "it is the only map"
    sure = sorted((p for p in own if p.status == "merged"), key=lambda p: -p.probability)
    if sure:
        told = ", ".join(f"{_other(p, name)} ({p.probability:.2f})" for p in sure[:3])
        wrong = [_other(p, name) for p in every if p.status == "forbidden"]
        if wrong:
            return f"{told} would hold it where its match with {', '.join(wrong)} is forbidden"
        return (
            f"alone it would merge with {told}, but among all maps no place is sure: places look alike, a "
            "match is wrong, the map is bent, or its resolution is another than stated"
        )
    best = max(own, key=lambda p: p.probability)
    lacking = _lacking(best, centres)
    return f"no shared walls that suffice; closest is {_other(best, name)}: {_evidence(best)}{lacking}"


def _merged(name: str, own: Sequence[Pair]) -> str:
    """From the pairs that put the map where it lies. Their evidence is that of two maps alone: what several
    say together can be more."""
    if not own:
        return "held by other maps together"
    best = max(own, key=lambda p: p.probability)
    more = sum(p.status == "merged" for p in own if p is not best)
    # The numbers are of the strongest pair alone: the others are not that sure.
    too = f"; {more} more pair{'s put' if more > 1 else ' puts'} it there too" if more else ""
    return f"held by {_other(best, name)}: {_evidence(best)}{too}"


def _slides(own: Sequence[Pair], centres: Mapping[str, Sequence[float]]) -> bool:
    """Whether the surest pair that places a map may lie anywhere along its walls."""
    placing = [p for p in own if p.status in ("merged", "ambiguous")]
    best = max(placing, key=lambda p: p.probability, default=None)
    return best is not None and _lack(best, centres) is Lack.DIRECTION


def _is_told(
    pair: Pair, placed: Mapping[str, NDArray[np.float64]], centres: Mapping[str, Sequence[float]]
) -> bool:
    """Whether two maps lie as their best mode has them."""
    if pair.a not in placed or pair.b not in placed:
        return False
    T_a_b = se2.compose(se2.inverse(placed[pair.a]), placed[pair.b])
    return is_one_place(T_a_b, pair.modes[0].T_a_b, centres[pair.b])


def _evidence(pair: Pair) -> str:
    mode = pair.modes[0]
    shared = f"{mode.shared_length:.1f} m of wall in common"
    return f"probability {pair.probability:.2f} for these two alone, {shared}"


def _rivals(pair: Pair, centres: Mapping[str, Sequence[float]]) -> tuple[float, float]:
    """What the mirror image reaches, and what the best other place does, nats."""
    mode = pair.modes[0]
    centre = centres[pair.b]
    rivals = [m.log_likelihood for m in pair.modes if not is_one_place(m.T_a_b, mode.T_a_b, centre)]
    return pair.decoy_log_likelihood or 0.0, max(rivals, default=0.0)


def _lack(pair: Pair, centres: Mapping[str, Sequence[float]]) -> Lack:
    mode = pair.modes[0]
    numbers = (mode.shared_length, mode.hits, mode.conflicts, mode.second_direction)
    return lack_of(*numbers, mode.log_likelihood, max(_rivals(pair, centres)))


def _lacking(pair: Pair, centres: Mapping[str, Sequence[float]]) -> str:
    """What speaks against the best mode of two maps."""
    mode = pair.modes[0]
    match _lack(pair, centres):
        case Lack.WALL:
            return ", too little"
        case Lack.CONFLICTS:
            share = 100 * mode.conflicts / (mode.hits + mode.conflicts)
            return f", {share:.0f} % of it amid free space of the other"
        case Lack.DIRECTION:
            return ", nearly all in one direction"
        case Lack.RIVAL:
            mirrored, elsewhere = _rivals(pair, centres)
            share = math.floor(100 * max(mirrored, elsewhere) / mode.log_likelihood)
            what = "its mirror image" if mirrored >= elsewhere else "another place"
            return f", and {what} fits {'better' if share > 100 else f'{share} % as well'}"
    return ""


class Lack(enum.Enum):
    """What speaks most against a mode of two maps."""

    WALL = enum.auto()
    CONFLICTS = enum.auto()
    DIRECTION = enum.auto()
    RIVAL = enum.auto()
    NOTHING = enum.auto()


def lack_of(
    shared_length: float,
    hits: float,
    conflicts: float,
    second_direction: float,
    log_likelihood: float,
    rival: float,
) -> Lack:
    """What a mode lacks. rival: the log-likelihood of the mirror image or the best other place, nats; the
    rest is as in Mode."""
    if shared_length < LITTLE_WALL_M:
        return Lack.WALL
    if conflicts > MANY_CONFLICTS * (hits + conflicts):
        return Lack.CONFLICTS
    if second_direction < FEW_IN_SECOND_DIRECTION * hits:
        return Lack.DIRECTION
    if log_likelihood > 0 and rival > 0.5 * log_likelihood:
        return Lack.RIVAL
    return Lack.NOTHING


def _other(pair: Pair, name: str) -> str:
    return pair.b if pair.a == name else pair.a


def _places(name: str, hypotheses: Sequence[Hypothesis], centre: Sequence[float]) -> list[float]:
    """Probabilities of the places of a map beside others, the likeliest first."""
    found: list[tuple[NDArray[np.float64], float]] = []
    for h in hypotheses:
        for m in h.maps:
            if m.name != name or not any(o.component == m.component and o.name != name for o in h.maps):
                continue
            T = m.T_component_map
            at = next((k for k, (known, _) in enumerate(found) if is_one_place(T, known, centre)), None)
            if at is None:
                found.append((T, h.probability))
            else:
                found[at] = (found[at][0], found[at][1] + h.probability)
    return sorted((p for _, p in found), reverse=True)
