"""What an estimate tells of each robot: its standing, the reason, and the next best place."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.contradictions import displaced
from mapmeld.estimate import RobotEstimate, RunnerUp
from mapmeld.frames import Held
from mapmeld.one_place import ONE_PLACE, is_one_place
from mapmeld.result import Hypothesis, MergeResult, PlacedMap


def seen_from_anchors(result: MergeResult, held: Sequence[Held]) -> list[PlacedMap]:
    """The merge's maps by name, the doubt of each component told as its held anchor sees it.

    A merge tells it of all but the map that it began with, which need not be the one whose frame is held. The
    two exchange what is told of them, so that the doubt of them all together stays. A world that priors give
    is nobody's frame and stays as it is.
    """
    placed = {m.name: m for m in result.maps}
    for c in result.components:
        first = c.order[0]
        own = next((h for h in held if first in h.poses), None)
        if c.in_world or own is None or own.anchor == first or own.anchor not in c.order:
            continue
        a, b = placed[first], placed[own.anchor]
        placed[first] = dataclasses.replace(a, probability=b.probability)
        placed[own.anchor] = dataclasses.replace(b, probability=a.probability)
    return sorted(placed.values(), key=lambda m: m.name)


def tell(
    placed: PlacedMap,
    held: Sequence[Held],
    against: Mapping[str, float],
    unclear: Mapping[str, float],
    pinned: Collection[str],
    result: MergeResult,
    centres: Mapping[str, Sequence[float]],
    covariance: NDArray[np.float64] | None,
    placements: int,
) -> RobotEstimate:
    """One robot, as the merge placed it, see seen_from_anchors, and as it is held.

    against: robots that are held where the merge would not have them, and how probable they are there.
    unclear: robots that are not placed yet where the merge has them, likewise.
    """
    name = placed.name
    k = next((k for k, h in enumerate(held) if name in h.poses), None)
    if k is None:
        return RobotEstimate(name, None, None, None, 0.0, placed.status, placed.reason, None, placements)
    component = held[k]
    status, probability, reason = placed.status, placed.probability, placed.reason
    if name in pinned:
        status, probability = "pinned", 1.0
        reason = "pinned" + _contradiction(name, component, result, centres)
    elif name in against and len(component.poses) > 1:
        status, probability = "merged", against[name]
        reason = f"held where it was, with probability {probability:.2f}; {_merge_says(placed)}"
    elif status == "prior":
        reason = "placed by its prior alone" + _contradiction(name, component, result, centres)
    elif status == "merged" and len(component.poses) == 1:
        status, probability = "ambiguous", unclear.get(name, probability)
        reason = f"its place among others is not clear yet, with probability {probability:.2f}; {reason}"
    elif len(component.poses) > 1 and status in ("ambiguous", "no evidence"):
        # Others that are held to each other have it among them.
        status = "merged"
    return RobotEstimate(
        name,
        k,
        _read_only(component.poses[name]),
        covariance,
        probability,
        status,
        reason,
        _runner_up(name, k, held, result.hypotheses, centres),
        placements,
    )


def _merge_says(placed: PlacedMap) -> str:
    if placed.status == "merged":
        return "the maps alone would put it elsewhere, which is not clear enough"
    return f"from the maps alone: {placed.reason}"


def _contradiction(
    name: str, component: Held, result: MergeResult, centres: Mapping[str, Sequence[float]]
) -> str:
    """What walls say that lie elsewhere, where they say it strongly."""
    worst = ""
    most = 0.0
    for pair in result.pairs:
        if name not in (pair.a, pair.b) or pair.status != "merged":
            continue
        other = pair.b if pair.a == name else pair.a
        if other not in component.poses:
            continue
        metres, radians = displaced(pair, name, component.poses, centres[name])
        is_elsewhere = metres > ONE_PLACE[0] or radians > ONE_PLACE[1]
        if is_elsewhere and pair.probability > most:
            most = pair.probability
            worst = (
                f"; the walls that it shares with {other} put it {metres:.1f} m and "
                f"{math.degrees(radians):.0f} degrees away, with probability {pair.probability:.2f}"
            )
    return worst


def _runner_up(
    name: str,
    own: int,
    held: Sequence[Held],
    hypotheses: Sequence[Hypothesis],
    centres: Mapping[str, Sequence[float]],
) -> RunnerUp | None:
    places: list[tuple[int, NDArray[np.float64], float]] = []
    for h in hypotheses:
        found = _place(name, h, held)
        if found is None:
            continue
        k, T = found
        for at, (known, U, p) in enumerate(places):
            if known == k and is_one_place(T, U, centres[name]):
                places[at] = (known, U, p + h.probability)
                break
        else:
            places.append((k, T, h.probability))
    here = held[own].poses[name]
    others = [(k, T, p) for k, T, p in places if k != own or not is_one_place(T, here, centres[name])]
    if not others:
        return None
    k, T, p = max(others, key=lambda other: other[2])
    return RunnerUp(_read_only(T), min(p, 1.0), k)


def _place(name: str, h: Hypothesis, held: Sequence[Held]) -> tuple[int, NDArray[np.float64]] | None:
    """Where a hypothesis places a robot among others, in the frame of a component of most of these."""
    own = next((m for m in h.maps if m.name == name), None)
    if own is None:
        return None
    others = [m for m in h.maps if m.component == own.component and m.name != name]
    shared = [[m for m in others if m.name in c.poses] for c in held]
    k = max(range(len(held)), key=lambda k: (len(shared[k]), name in held[k].poses))
    if not shared[k]:
        return None
    by = next((m for m in shared[k] if m.name == held[k].anchor), shared[k][0])
    T_by_map = se2.compose(se2.inverse(by.T_component_map), own.T_component_map)
    return k, se2.compose(held[k].poses[by.name], T_by_map)


def _read_only(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    copy = np.array(pose, dtype=np.float64)
    copy.setflags(write=False)
    return copy
