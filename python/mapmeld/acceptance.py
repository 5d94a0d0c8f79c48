"""The acceptance rule: is every map that shares enough with the rest placed within tolerance?

A map is accepted when it lies within ACCEPTED (three cells or the truth's stated residual, 1.5 degrees, at
the centre of its known cells) of the anchor of its component, or of an accepted map with which it shares at
least SHARES_ENOUGH of occupied cells; the anchor is accepted when some other map is.

Why neighbours count: bent maps fit no rigid transform. The truth of a pair is then the transform that fits
the cells both maps show; of far maps it says little at the other map's centre, and the frames of their
first poses say less. So a chain of neighbours, each within tolerance on ground that both maps show, is the
measure that does not depend on where the bend lies. Its weak side is that errors along a chain are not
added up, and that one good neighbour outvotes others. Two things keep it honest: each map says which one it
was accepted against, and the pairs that share enough are counted too, each by itself, joined or not.

Residuals that we assume (frames of bent maps) do not widen this tolerance; only those that the truth states
do.

Maps in different components are not placed to each other. So in each group of maps that the truth links by
sharing, one component counts, the one with the most accepted maps. Groups that share nothing with each other
cannot be expected in one component, and are judged by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mapmeld.measurement import Measurement, Rig
from mapmeld.tolerance import ACCEPTED, SHARES_ENOUGH


@dataclass(frozen=True)
class Acceptance:
    """What the acceptance rule says of a result.

    asked: number of maps that share at least `share` of their occupied cells with some other map; accepted:
        for how many of these the rule holds; failing: the names of the others.
    holds: accepted == asked; None when no map is asked, for then nothing was shown.
    pairs_asked, pairs_accepted: the same for every single pair that shares that much: the stricter view.
    """

    share: float
    asked: int
    accepted: int
    failing: tuple[str, ...]
    holds: bool | None
    pairs_asked: int
    pairs_accepted: int


def judge_acceptance(
    rig: Rig, names: Sequence[str], components: Mapping[int, Sequence[str]], anchors: Mapping[int, str]
) -> tuple[Acceptance, dict[str, bool | None], dict[str, str]]:
    """The verdict; per map whether it is accepted (None: not asked); per accepted map, against which one.

    names: the maps of the result, in truth's order. components: the placed ones of these, by component.
    anchors: one member of each component.
    """
    via: dict[str, str] = {}
    for component, members in components.items():
        via.update(_accepted_from(rig, anchors[component], members))
    counted = _in_counted_component(rig, names, via)
    asked = [name for name in names if _shares_enough(rig.shares(name, names))]
    accepted: dict[str, bool | None] = {name: name in counted if name in asked else None for name in names}
    failing = tuple(name for name in asked if not accepted[name])
    pairs = [(a, b) for a, b in _pairs_in_truth_order(rig, names) if _shares_enough(rig.truth.shared(a, b))]
    verdict = Acceptance(
        share=SHARES_ENOUGH,
        asked=len(asked),
        accepted=len(asked) - len(failing),
        failing=failing,
        holds=not failing if asked else None,
        pairs_asked=len(pairs),
        pairs_accepted=sum(_is_accepted(rig.measure(a, b)) for a, b in pairs),
    )
    return verdict, accepted, {name: other for name, other in via.items() if name in counted}


def _accepted_from(rig: Rig, anchor: str, members: Sequence[str]) -> dict[str, str]:
    """The map that each accepted member was accepted against; breadth first from the anchor."""
    via: dict[str, str] = {}
    placed = [anchor]
    waiting = [name for name in members if name != anchor]
    while True:
        found: dict[str, str] = {}
        for name in waiting:
            neighbours = [r for r in placed if r == anchor or _shares_enough(rig.truth.shared(r, name))]
            good = next((r for r in neighbours if _is_accepted(rig.measure(r, name))), None)
            if good is not None:
                found[name] = good
        if not found:
            break
        via.update(found)
        placed.extend(found)
        waiting = [name for name in waiting if name not in found]
    if via:
        via[anchor] = next(iter(via))
    return via


def _in_counted_component(rig: Rig, names: Sequence[str], via: Mapping[str, str]) -> set[str]:
    """The accepted maps that lie in their sharing group's component with the most accepted maps."""
    counted: set[str] = set()
    for group in _sharing_groups(rig, names):
        by_component: dict[int | None, list[str]] = {}
        for name in group:
            if name in via:
                by_component.setdefault(rig.component(name), []).append(name)
        if by_component:
            most: list[str] = max(by_component.values(), key=len)
            counted.update(most)
    return counted


def _sharing_groups(rig: Rig, names: Sequence[str]) -> list[list[str]]:
    """The maps, grouped so that those which share enough, directly or through others, are together."""
    groups: list[list[str]] = []
    left = list(names)
    while left:
        group = [left.pop(0)]
        for member in group:  # grows while we walk it
            linked = [name for name in left if _shares_enough(rig.truth.shared(member, name))]
            group.extend(linked)
            left = [name for name in left if name not in linked]
        groups.append(sorted(group, key=list(names).index))
    return groups


def _pairs_in_truth_order(rig: Rig, names: Sequence[str]) -> list[tuple[str, str]]:
    return [(a, b) for a, b in rig.truth.pairs if a in names and b in names]


def _shares_enough(share: float | None) -> bool:
    return share is not None and share >= SHARES_ENOUGH


def _is_accepted(measured: Measurement | None) -> bool:
    return measured is not None and ACCEPTED.admits(
        measured.translation_m, measured.rotation_deg, measured.resolution, measured.reference.stated_rms_m
    )
