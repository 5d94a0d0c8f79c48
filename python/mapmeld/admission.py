"""Who joins whom: links that are new must be clear, for they are looked for again and again while maps grow.

A merge is made when it is probable enough, on one look at maps that are done. Robots that explore are looked
at after every update, and the first rooms of a building look alike: what seems probable for a while must not
be told.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mapmeld import se2
from mapmeld.frames import Group, Pose
from mapmeld.holding import Ask, Hold, Unit, agreeing


@dataclass(frozen=True)
class _Waiting:
    """A link that is probable but not clear yet: where one robot lies to another, and the known area, square
    metres, of the robots on both sides when it was first seen."""

    T_a_b: Pose
    areas: Mapping[str, float]


@dataclass
class Admission:
    """Splits groups where their links are not clear. It remembers those that wait."""

    hold: Hold
    least: float
    _waiting: dict[tuple[str, str], _Waiting] = field(default_factory=dict)

    def admitted(
        self,
        groups: Sequence[Group],
        units: Sequence[Unit],
        sure: Collection[str],
        centres: Mapping[str, Sequence[float]],
        areas: Mapping[str, float],
        ask: Ask,
        maps_are_done: bool = False,
    ) -> tuple[list[Group], dict[str, float]]:
        """Groups of what is linked clearly, and how probable the link is of robots for which it is not.

        units: what is held together; nothing is asked about that. sure: robots that priors or pins place.
        maps_are_done: links that are probable enough for a merge are clear.
        """
        done: list[Group] = []
        unclear: dict[str, float] = {}
        stood: dict[tuple[str, str], _Waiting] = {}
        for group in groups:
            left = _parts(group, units, centres, self.hold)
            is_world = group.in_world
            while left:
                first = max(left, key=lambda p: (is_world and bool(p & set(sure)), len(p)))
                left.remove(first)
                base = {n: group.poses[n] for n in group.poses if n in first}
                asked: dict[int, int] = {}
                grows = True
                while grows:
                    grows = False
                    for part in list(left):
                        # Against the same robots it stands as it stood.
                        if asked.get(id(part)) == len(base):
                            continue
                        asked[id(part)] = len(base)
                        moved = {n: group.poses[n] for n in group.poses if n in part}
                        if not (is_world and part & set(sure)):
                            probability = ask(base, moved, [np.zeros(3)])[0][0][0]
                            clear = self._is_clear(base, moved, probability, areas, stood)
                            if not (clear or (maps_are_done and probability >= self.least)):
                                for n in (*base, *moved):
                                    unclear[n] = max(probability, unclear.get(n, 0.0))
                                continue
                        base |= moved
                        left.remove(part)
                        grows = True
                done.append(Group(base, is_world))
                is_world = False
        self._waiting = stood
        together = {n for g in done if len(g.poses) > 1 for n in g.poses}
        return done, {n: p for n, p in unclear.items() if n not in together}

    def _is_clear(
        self,
        base: Mapping[str, Pose],
        moved: Mapping[str, Pose],
        probability: float,
        areas: Mapping[str, float],
        stood: dict[tuple[str, str], _Waiting],
    ) -> bool:
        if probability >= self.hold.join:
            return True
        if probability < self.least:
            return False
        a, b = next(iter(base)), next(iter(moved))
        T_a_b = se2.compose(se2.inverse(base[a]), moved[b])
        waiting = self._waiting.get((a, b))
        if waiting is None or not self.hold.is_same_place(waiting.T_a_b, T_a_b, (0.0, 0.0)):
            waiting = _Waiting(T_a_b, {n: areas[n] for n in (*base, *moved)})
        stood[a, b] = waiting
        there = [n for n in waiting.areas if n in areas]
        before = sum(waiting.areas[n] for n in there)
        return sum(areas[n] for n in there) >= self.hold.growth * before


def _parts(
    group: Group, units: Sequence[Unit], centres: Mapping[str, Sequence[float]], hold: Hold
) -> list[set[str]]:
    """The robots of a group by the units that they are held in: of each, most of those that agree with the
    group."""
    parts: list[set[str]] = []
    for unit in units:
        if agreed := agreeing(unit.poses, group, centres, hold):
            parts.append(set(sorted(agreed, key=len)[-1]))
    place = {n: k for k, n in enumerate(group.poses)}
    return sorted(parts, key=lambda p: min(place[n] for n in p))
