"""Who joins whom: links that are new must be clear, for they are looked for again and again while maps grow.

A merge is made when it is probable enough, on one look at maps that are done. Robots that explore are looked
at after every update, and the first rooms of a building look alike: what seems probable for a while must not
be told.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from mapmeld.frames import Group
from mapmeld.holding import Ask, Hold, Unit, most_agreeing


def admitted(
    groups: Sequence[Group],
    units: Sequence[Unit],
    sure: Collection[str],
    exact: Collection[str],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
    least: float,
    ask: Ask,
) -> tuple[list[Group], dict[str, float]]:
    """Groups of what is linked clearly, and how probable the best link is of robots that have none.

    units: what is held together; nothing is asked about that. sure: robots that priors or pins place. exact:
        those that are pinned. least: how probable a link must be.
    """
    done: list[Group] = []
    unclear: dict[str, float] = {}
    for group in groups:
        left = _parts(group, units, exact, centres, hold)
        is_world = group.in_world
        while left:
            first = max(left, key=lambda part: (is_world and bool(part & set(sure)), len(part)))
            left.remove(first)
            base = {n: T for n, T in group.poses.items() if n in first}
            asked: dict[int, int] = {}
            grows = True
            while grows:
                grows = False
                for part in list(left):
                    # Against the same robots it stands as it stood.
                    if asked.get(id(part)) == len(base):
                        continue
                    asked[id(part)] = len(base)
                    moved = {n: T for n, T in group.poses.items() if n in part}
                    if not (is_world and part & set(sure)):
                        probability = ask(base, moved, [np.zeros(3)])[0][0][0]
                        if probability < least:
                            for n in (*base, *moved):
                                unclear[n] = max(probability, unclear.get(n, 0.0))
                            continue
                    base |= moved
                    left.remove(part)
                    grows = True
            done.append(Group(base, is_world))
            is_world = False
    linked = {n for g in done if len(g.poses) > 1 for n in g.poses}
    return done, {n: p for n, p in unclear.items() if n not in linked}


def _parts(
    group: Group,
    units: Sequence[Unit],
    exact: Collection[str],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
) -> list[set[str]]:
    """The robots of a group by the units that they are held in: of each, most of those that agree with the
    group."""
    agreed = (most_agreeing(unit, group, exact, centres, hold) for unit in units)
    parts = [set(part) for part in agreed if part]
    place = {n: k for k, n in enumerate(group.poses)}
    return sorted(parts, key=lambda p: min(place[n] for n in p))
