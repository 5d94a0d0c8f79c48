"""What is held and what the merge says, put together: which robots lie in one frame, and where."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.frames import Group
from mapmeld.holding import Hold, Unit, most_agreeing
from mapmeld.one_place import Pose


@dataclass(frozen=True)
class _Link:
    """How a group takes a unit, told by those of its robots that most agree on it. is_whole: they all do."""

    group: int
    unit: int
    T_group_unit: Pose
    robots: int
    is_whole: bool


def joined(
    groups: Sequence[Group],
    units: Sequence[Unit],
    exact: Collection[str],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
) -> list[Group]:
    """Groups of whole units: units that a group links lie to each other as there, robots of one unit stay as
    they are, whatever the groups say. exact: robots that stay exactly where the world has them."""
    links = _links(groups, units, exact, centres, hold)
    pinned = {n: T for g in groups if g.in_world for n, T in g.poses.items() if n in exact}
    done: list[Group] = []
    seen: set[int] = set()
    roots = sorted(range(len(groups)), key=lambda g: (not groups[g].in_world, -len(groups[g].poses), g))
    for root in roots:
        if root in seen:
            continue
        T_root_group, T_root_unit = _tree(root, links)
        seen |= T_root_group.keys()
        poses: dict[str, Pose] = {}
        for u, T in T_root_unit.items():
            whole = next((link.group for link in links if link.unit == u and link.is_whole), None)
            if whole is None:
                poses |= {n: se2.compose(T, T_unit_map) for n, T_unit_map in units[u].poses.items()}
            else:
                # Where it is refined, a unit that stays as it is follows.
                inside = groups[whole].poses
                poses |= {n: se2.compose(T_root_group[whole], inside[n]) for n in units[u].poses}
        is_world = groups[root].in_world
        if is_world:
            poses |= {n: T for n, T in pinned.items() if n in poses}
        done.append(Group(poses, is_world))
    return done


def _links(
    groups: Sequence[Group],
    units: Sequence[Unit],
    exact: Collection[str],
    centres: Mapping[str, Sequence[float]],
    hold: Hold,
) -> list[_Link]:
    """All links, those of most robots first."""
    links = []
    for g, group in enumerate(groups):
        for u, unit in enumerate(units):
            if most := most_agreeing(unit, group, exact, centres, hold):
                T = se2.compose(group.poses[most[0]], se2.inverse(unit.poses[most[0]]))
                links.append(_Link(g, u, T, len(most), len(most) == len(unit.poses)))
    return sorted(links, key=lambda link: -link.robots)


def _tree(root: int, links: Sequence[_Link]) -> tuple[dict[int, Pose], dict[int, Pose]]:
    """Groups and units that are linked to a group, in its frame, by the strongest links."""
    T_root_group: dict[int, Pose] = {root: np.zeros(3)}
    T_root_unit: dict[int, Pose] = {}
    while True:
        onward = (k for k in links if (k.group in T_root_group) != (k.unit in T_root_unit))
        link = next(onward, None)
        if link is None:
            return T_root_group, T_root_unit
        if link.group in T_root_group:
            T_root_unit[link.unit] = se2.compose(T_root_group[link.group], link.T_group_unit)
        else:
            T = se2.compose(T_root_unit[link.unit], se2.inverse(link.T_group_unit))
            T_root_group[link.group] = T
