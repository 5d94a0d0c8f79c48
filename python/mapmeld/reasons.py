"""Why a map stands where it stands, in one sentence with its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mapmeld.result import Hypothesis, Pair

_LITTLE_WALL_M = 3.0
"""Metres of wall in common below which that is said to be lacking."""
_FEW_IN_SECOND_DIRECTION = 0.1
"""Share of the hits in the weaker direction below which the walls are said to run one way only."""
_MANY_CONFLICTS = 0.05
"""Share of contradicting walls above which they are said to contradict."""


def reason(
    name: str, status: str, others: Sequence[str], pairs: Sequence[Pair], hypotheses: Sequence[Hypothesis]
) -> str:
    """The sentence for the map of that name.

    others: maps in its component. pairs, hypotheses: those of the result.
    """
    if status == "blank":
        return "it holds no known cell, so it is placed nowhere"
    own = [p for p in pairs if name in (p.a, p.b) and p.modes]
    if status == "merged":
        return _merged(name, [p for p in own if _other(p, name) in others])
    if status == "ambiguous":
        places = [(h, next(m for m in h.maps if m.name == name)) for h in hypotheses if _holds(h, name)]
        shares = ", ".join(f"{h.probability:.2f}" for h, _ in places[:3])
        return (
            f"it belongs to other maps, but fits in more than one place: {len(places)} hypotheses ({shares})"
        )
    if not own:
        return "no wall of another map fits any of its walls" if pairs else "it is the only map"
    best = max(own, key=lambda p: p.probability)
    return f"no shared walls that suffice; closest is {_other(best, name)}: {_evidence(best)}{_lacking(best)}"


def _merged(name: str, own: Sequence[Pair]) -> str:
    """The evidence of pairs is that of two maps alone: what several maps say together can be more."""
    if not own:
        return "held by other maps together"
    best = max(own, key=lambda p: p.probability)
    more = sum(p.status == "merged" for p in own if p is not best)
    return f"held by {_other(best, name)}{f' and {more} more' if more else ''}: {_evidence(best)}"


def _evidence(pair: Pair) -> str:
    mode = pair.modes[0]
    return f"probability {pair.probability:.2f}, {mode.shared_length:.1f} m of wall in common"


def _lacking(pair: Pair) -> str:
    """What speaks against the best mode of two maps."""
    mode = pair.modes[0]
    chance = pair.decoy_log_likelihood or 0.0
    if mode.shared_length < _LITTLE_WALL_M:
        return ", too little"
    if mode.conflicts > _MANY_CONFLICTS * (mode.hits + mode.conflicts):
        share = 100 * mode.conflicts / (mode.hits + mode.conflicts)
        return f", {share:.0f} % of it amid free space of the other"
    if mode.second_direction < _FEW_IN_SECOND_DIRECTION * mode.hits:
        return ", nearly all in one direction"
    if len(pair.modes) > 1 and pair.modes[1].log_likelihood > 0.5 * mode.log_likelihood:
        chance = max(chance, pair.modes[1].log_likelihood)
    if mode.log_likelihood > 0 and chance > 0.5 * mode.log_likelihood:
        return f", and chance explains {math.floor(min(100 * chance / mode.log_likelihood, 100))} % of it"
    return ""


def _other(pair: Pair, name: str) -> str:
    return pair.b if pair.a == name else pair.a


def _holds(hypothesis: Hypothesis, name: str) -> bool:
    return any(m.name == name for m in hypothesis.maps)
