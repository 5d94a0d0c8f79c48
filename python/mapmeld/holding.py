"""Hysteresis: what was said before stays until the evidence against it is clear.

Robots of one component that the next merge leaves as they are to each other are one part. Where it tears a
component apart, or puts a part elsewhere, the maps as they are now are asked how probable the held place is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.frames import Group, Held
from mapmeld.one_place import Pose, apart

Poses = Mapping[str, Pose]
Answer = tuple[list[tuple[float, int]], float]
Ask = Callable[[Poses, Poses, Sequence[Pose]], Answer]
"""Places T_base_moved of some maps to others, T_base_map and T_moved_map: for each its probability and the
first that is the same place, by index; and the probability of the best other place."""


@dataclass(frozen=True)
class Hold:
    """How firmly an estimate holds on to what the one before said.

    join: how probable a new link must be while maps grow. One that is merely probable enough for a merge
        (evidence.min_probability) comes up by chance when it is looked for after every update.
    keep: how probable a held place must be, against none of the places that fit being right, to stay. A
        merge needs more: that this is lower keeps growing maps from flickering.
    replace: the share, of its own probability and that of the held place, from which another place takes
        over.
    noise_m, noise_rad: poses that differ by more, at the middle of the map's known cells, are different
        places, metres and radians; less is refinement.
    refine_cells: refined poses are followed once they moved some known cell by more than so many cells, or by
        more than their own standard deviation.

    Raises MapmeldError for a value out of range.
    """

    join: float = 0.98
    keep: float = 0.5
    replace: float = 0.95
    noise_m: float = 0.2
    noise_rad: float = 0.04
    refine_cells: float = 0.5

    def __post_init__(self) -> None:
        for key, low, high in (
            ("join", 0.0, 1.0),
            ("keep", 0.0, 1.0),
            ("replace", 0.5, 1.0),
            ("noise_m", 0.0, np.inf),
            ("noise_rad", 0.0, np.inf),
            ("refine_cells", 0.0, np.inf),
        ):
            value = getattr(self, key)
            if not (isinstance(value, int | float) and low <= value <= high):
                raise MapmeldError(f"hold: {key} must be a number from {low:g} to {high:g}, got {value!r}")

    def is_same_place(self, a: Pose, b: Pose, centre: Sequence[float]) -> bool:
        """Whether two poses of a map are one place, up to noise."""
        metres, radians = apart(a, b, centre)
        return metres <= self.noise_m and radians <= self.noise_rad


@dataclass(frozen=True)
class Unit:
    """Robots that lie to each other as they did before: T_unit_map.

    against: for those that the merge would have put elsewhere, or has apart from all others, how probable it
        is that they lie there.
    """

    poses: Poses
    against: Mapping[str, float]


def units(
    held: Sequence[Held],
    groups: Sequence[Group],
    free: Collection[str],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
    ask: Ask,
) -> list[Unit]:
    """What stays together of what was: every robot of the groups is in one of the units.

    free: robots that are held to nothing, such as those that their prior alone places.
    """
    there = {n for g in groups for n in g.poses}
    found: list[Unit] = []
    for h in held:
        poses = {n: T for n, T in h.poses.items() if n in there and n not in free}
        if poses:
            found += _kept(poses, h.anchor, groups, centres, hold, ask)
    in_some = {n for u in found for n in u.poses}
    alone = sorted(there - in_some)
    return found + [Unit({n: np.zeros(3)}, {}) for n in alone]


def _kept(
    poses: Poses,
    anchor: str,
    groups: Sequence[Group],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
    ask: Ask,
) -> list[Unit]:
    """Parts of one held component, joined again where the held place stands."""
    parts = [p for g in groups for p in agreeing(poses, g, centres, hold)]
    parts.sort(key=lambda p: (-len(p), anchor not in p, min(p)))
    kept = [Unit({n: poses[n] for n in parts[0]}, {})]
    for part in parts[1:]:
        moved = {n: poses[n] for n in part}
        for k, base in enumerate(kept):
            stays = _stays(base.poses, moved, groups, hold, ask)
            if stays is None:
                continue
            if stays.is_refined:
                kept[k] = Unit({**base.poses, **stays.poses}, base.against)
            else:
                # A robot that the merge leaves alone is held by this, as those are that come to it.
                torn = [n for n in base.poses if len(base.poses) == 1 and _is_alone(n, groups)]
                against = dict.fromkeys([*torn, *moved], stays.probability)
                kept[k] = Unit({**base.poses, **moved}, {**base.against, **against})
            break
        else:
            kept.append(Unit(moved, {}))
    return kept


def _is_alone(name: str, groups: Sequence[Group]) -> bool:
    return all(len(g.poses) == 1 for g in groups if name in g.poses)


def agreeing(
    poses: Poses, group: Group, centres: Mapping[str, Sequence[float]], hold: Hold
) -> list[list[str]]:
    """Robots that are in both, in lists of those that lie to each other in one as in the other."""
    parts: list[list[str]] = []
    for name in (n for n in poses if n in group.poses):
        for part in parts:
            T_held = se2.compose(se2.inverse(poses[part[0]]), poses[name])
            T_now = se2.compose(se2.inverse(group.poses[part[0]]), group.poses[name])
            if hold.is_same_place(T_held, T_now, centres[name]):
                part.append(name)
                break
        else:
            parts.append([name])
    return parts


def most_agreeing(
    unit: Unit, group: Group, exact: Collection[str], centres: Mapping[str, Sequence[float]], hold: Hold
) -> list[str]:
    """Robots of a unit that lie to each other as in the group: those with an exact one, else the most."""
    parts = agreeing(unit.poses, group, centres, hold)
    return max(parts, key=lambda p: (any(n in exact for n in p), len(p)), default=[])


def repinned(
    held: Sequence[Held],
    groups: Sequence[Group],
    pins: Collection[str],
    centres: Mapping[str, Sequence[float]],
) -> set[str]:
    """Pinned robots that do not lie to the other pinned ones of their held component as they did.

    Most of the pinned ones stay, or those whose pin is what it was. A pin that is alone in its component may
    move it as a whole.
    """
    exactly = Hold(noise_m=1e-6, noise_rad=1e-6)
    moved: set[str] = set()
    for world in (g for g in groups if g.in_world):
        for h in held:
            poses = {n: T for n, T in h.poses.items() if n in pins and n in world.poses}
            parts = agreeing(poses, world, centres, exactly)
            still = [n for n in poses if exactly.is_same_place(poses[n], world.poses[n], centres[n])]
            most = max(parts, key=lambda p: (len(p), any(n in still for n in p)), default=[])
            moved |= poses.keys() - set(most)
    return moved


@dataclass(frozen=True)
class _Stay:
    """That some robots stay with others: how probable their place is, and where it is now.

    is_refined: the merge has them at that place too.
    """

    probability: float
    poses: Poses
    is_refined: bool


def _stays(base: Poses, moved: Poses, groups: Sequence[Group], hold: Hold, ask: Ask) -> _Stay | None:
    """Whether the held place of some robots to others stands; None when it does not stand any more."""
    places = [np.zeros(3)]
    lead = next(iter(moved))
    group = next(g for g in groups if lead in g.poses)
    of_base = next((n for n in base if n in group.poses), None)
    if of_base is not None:
        # Both are told in the held frame: there, the held place is no motion at all.
        T_held_group = se2.compose(base[of_base], se2.inverse(group.poses[of_base]))
        places.append(se2.compose(se2.compose(T_held_group, group.poses[lead]), se2.inverse(moved[lead])))
    told, rival = ask(base, moved, places)
    (held, _), *others = told
    # The new place may be the held one, refined.
    is_refined = bool(others) and others[0][1] == 0
    new = others[0][0] if others and not is_refined else 0.0
    best = max(new, rival)
    nowhere = max(0.0, 1.0 - held - new - rival)
    if held <= 0.0 or best >= hold.replace * (best + held) or held < hold.keep * (held + nowhere):
        return None
    T = places[1] if is_refined else places[0]
    return _Stay(held, {n: se2.compose(T, T_held_map) for n, T_held_map in moved.items()}, is_refined)
