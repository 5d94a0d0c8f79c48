"""What a hypothesis has otherwise than the bench shows it, and what taking it for true makes known."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Prior
from mapmeld.map_yaml import one_line
from mapmeld.result import Hypothesis, MergeResult
from mapmeld.studio.desk import Desk
from mapmeld.studio.layout import Pose, as_pose
from mapmeld.studio.pinning import SOFT_SIGMA, in_world

# What lies as near as this is in the same place: metres of the centre of its known cells, radians.
_SAME_PLACE = (0.5, 0.15)
_MOST_NAMES = 6

Centres = Mapping[str, tuple[float, float]]
"""Of the known cells of each map, map coordinates, metres."""


@dataclass(frozen=True)
class Difference:
    """A map that a hypothesis has otherwise. pose: T_bench_map there; None where the hypothesis keeps it
    apart from maps that it is shown with. distance (metres) and angle (radians): how far it moves. beside:
    the map that it is put to, where it is shown apart from that."""

    name: str
    pose: Pose | None = None
    distance: float = 0.0
    angle: float = 0.0
    beside: str | None = None

    def __str__(self) -> str:
        if self.pose is None:
            return f"{self.name} apart"
        if self.beside is not None:
            return f"{self.name} with {self.beside}"
        off = f"{self.distance:.1f} m and {math.degrees(self.angle):.0f} degrees off"
        return f"{self.name} elsewhere, {off}"


def differences(k: int, desk: Desk, centres: Centres) -> tuple[Difference, ...]:
    """How the k-th hypothesis of the desk's result, from 0, differs from what the bench shows. Of each group
    the maps that most others keep their places to have stayed; pinned maps stay before all others."""
    hypothesis, result = _hypothesis(k, desk)
    shown = {m.name: m.component for m in result.maps}
    out = []
    for members in _groups(hypothesis).values():
        out += _lead(members, desk, shown, centres)[1]
    moved = {d.name for d in out}
    out += [Difference(n) for n in _apart(hypothesis, result) if n not in moved]
    return tuple(out)


def words(found: tuple[Difference, ...]) -> str:
    """Differences as people read them."""
    if not found:
        return "as it is shown"
    more = len(found) - _MOST_NAMES
    return "; ".join(str(d) for d in found[:_MOST_NAMES]) + (f"; and {more} more" if more > 0 else "")


def chosen(k: int, desk: Desk, centres: Centres) -> tuple[Desk, str]:
    """The desk on which the k-th hypothesis, from 0, is taken for true, and what that says.

    Maps that it has elsewhere get soft pins there, the one that they are placed to a hard one. Maps that it
    keeps apart are forbidden to match those that they are linked to. Raises MapmeldError where nothing
    differs, or cannot be said."""
    hypothesis, result = _hypothesis(k, desk)
    which = f"choose: hypothesis {k + 1}"
    found = differences(k, desk, centres)
    if not found:
        raise MapmeldError(f"{which} is what is shown already; pin the maps of it that you are sure of")
    for d in found:
        is_pinned = d.name in desk.known.pins or (d.pose is None and d.name in desk.known.priors)
        if is_pinned:
            raise MapmeldError(one_line(f"{which} has {d}, and it is pinned; let it go first"))
    pins, priors = dict(desk.known.pins), dict(desk.known.priors)
    said = []
    placed = [d for d in found if d.pose is not None]
    anchors = _anchors(which, placed, hypothesis, desk, result, centres)
    for anchor in anchors:
        pins.setdefault(anchor, desk.poses[anchor])
    priors |= {d.name: Prior(d.pose, SOFT_SIGMA) for d in placed if d.pose is not None}
    if placed:
        said.append(f"{_listed([d.name for d in placed])} pinned there softly")
    forbidden = _forbidden(which, hypothesis, result)
    for name in [d.name for d in found if d.pose is None]:
        others = [b if a == name else a for a, b in forbidden if name in (a, b)]
        if others:
            said.append(f"{name} forbidden to match {_listed(others)}")
    known = dataclasses.replace(
        desk.known, pins=pins, priors=priors, forbidden=(*desk.known.forbidden, *forbidden)
    )
    if known == desk.known:
        raise MapmeldError(f"{which}: what it takes was said already; solve again")
    poses = {**desk.poses, **{d.name: d.pose for d in placed if d.pose is not None}}
    new = dataclasses.replace(desk, poses=poses, known=known)
    if anchors and not desk.known.pins and not desk.known.priors:
        new = in_world(new, anchors[0])
    return new, "; ".join(said)


def _anchors(
    which: str,
    placed: list[Difference],
    hypothesis: Hypothesis,
    desk: Desk,
    result: MergeResult,
    centres: Centres,
) -> list[str]:
    """The maps that stay and that others are placed to. All must lie in one world: parts that are shown
    side by side have no place to each other."""
    shown = {m.name: m.component for m in result.maps}
    names = {d.name for d in placed}
    anchors = [
        _lead(members, desk, shown, centres)[0]
        for members in _groups(hypothesis).values()
        if not names.isdisjoint(members)
    ]
    fixed = {*desk.known.pins, *desk.known.priors}
    new = [n for n in anchors if n not in fixed]
    world = {shown[n] for n in fixed or new[:1]}
    if any(shown[n] not in world for n in new):
        raise MapmeldError(
            f"{which} has maps elsewhere in parts that have no place to each other; "
            "drag and pin them part by part"
        )
    return anchors


def _hypothesis(k: int, desk: Desk) -> tuple[Hypothesis, MergeResult]:
    if desk.result is None or not 0 <= k < len(desk.result.hypotheses):
        raise MapmeldError(f"choose: there is no hypothesis {k}; solve first")
    return desk.result.hypotheses[k], desk.result


def _groups(hypothesis: Hypothesis) -> dict[int, dict[str, Pose]]:
    groups: dict[int, dict[str, Pose]] = {}
    for m in hypothesis.maps:
        groups.setdefault(m.component, {})[m.name] = as_pose(m.T_component_map)
    return groups


def _lead(
    members: Mapping[str, Pose], desk: Desk, shown: Mapping[str, int], centres: Centres
) -> tuple[str, list[Difference]]:
    """The map of a group that the others are placed to, and where that has every one of them."""
    names = list(members)
    there = np.array([se2.matrix(members[n]) for n in names])
    now = np.array([se2.matrix(desk.poses[n]) for n in names])
    middle = np.array([(*centres[n], 1.0) for n in names])
    part = np.array([shown[n] for n in names])
    # [i, j]: where map i, lying as it does, has map j.
    poses = (now @ np.linalg.inv(there))[:, None] @ there[None]
    off = np.einsum("ijab,jb->ija", poses, middle) - np.einsum("jab,jb->ja", now, middle)[None]
    distance = np.hypot(off[..., 0], off[..., 1])
    turn = np.linalg.inv(now)[None] @ poses
    angle = np.abs(np.arctan2(turn[..., 1, 0], turn[..., 0, 0]))
    is_same = (part[:, None] == part) & (distance <= _SAME_PLACE[0]) & (angle <= _SAME_PLACE[1])
    is_pinned = np.array([n in desk.known.pins for n in names])
    i = int((is_same.sum(axis=1) + len(names) * is_pinned).argmax())
    return names[i], [
        Difference(
            n,
            as_pose(se2.vector(poses[i, j])),
            float(distance[i, j]),
            float(angle[i, j]),
            None if part[i] == part[j] else names[i],
        )
        for j, n in enumerate(names)
        if not is_same[i, j]
    ]


def _split(hypothesis: Hypothesis, result: MergeResult) -> list[list[list[str]]]:
    """Of each component of the result that the hypothesis takes apart, the maps that it keeps together, most
    maps first."""
    chosen = {m.name: m.component for m in hypothesis.maps}
    split = []
    for c in result.components:
        kept: dict[int | str, list[str]] = {}
        for n in c.order:
            # A map that it leaves out is alone.
            kept.setdefault(chosen.get(n, n), []).append(n)
        if len(kept) > 1:
            split.append(sorted(kept.values(), key=len, reverse=True))
    return split


def _apart(hypothesis: Hypothesis, result: MergeResult) -> list[str]:
    return [n for kept in _split(hypothesis, result) for part in kept[1:] for n in part]


def _forbidden(which: str, hypothesis: Hypothesis, result: MergeResult) -> list[tuple[str, str]]:
    """Pairs that link what the hypothesis keeps apart: those whose walls merge them or, where there are none,
    those whose walls propose anything."""
    out = []
    for kept in _split(hypothesis, result):
        part_of = {n: i for i, part in enumerate(kept) for n in part}
        across = [
            p
            for p in result.pairs
            if part_of.get(p.a, -1) != part_of.get(p.b, -1) and {p.a, p.b} <= part_of.keys()
        ]
        links = [p for p in across if p.status in ("merged", "ambiguous")] or [p for p in across if p.modes]
        if not links:
            raise MapmeldError(
                one_line(
                    f"{which} has {_listed(kept[1])} apart, and it is not walls that link it to the others; "
                    "take back what you said of it"
                )
            )
        out += [(p.a, p.b) for p in links]
    return out


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
