"""Frames that stay: how arrangements follow one another, so that what is told moves no more than it must.

A merge is without memory: its components lie in the frame of one of their maps. Here each component of the
next merge is given the frame that its robots had before.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.known_cells import KnownCells
from mapmeld.one_place import Pose, apart

MOST_NOISE = 0.1
"""How far a refined pose may differ from the held one at most, metres, however uncertain it is."""


@dataclass(frozen=True)
class Held:
    """Robots whose maps lie in one frame, and have for a while.

    frame: a number that stays with the frame. anchor: the robot whose pose defines it. poses: T_frame_map.
    """

    frame: int
    anchor: str
    is_world: bool
    poses: Mapping[str, Pose]


@dataclass(frozen=True)
class Group:
    """Robots that lie together now: T_group_map. in_world: in the world, which priors give."""

    poses: Mapping[str, Pose]
    in_world: bool = False


@dataclass(frozen=True)
class Frames:
    """Gives groups the frames that their robots had before."""

    _numbers: Iterator[int] = field(default_factory=itertools.count)

    def follow(
        self, groups: Sequence[Group], held: Sequence[Held], arrival: Sequence[str], world_is_given: bool
    ) -> list[Held]:
        """The groups in frames that stay, in the groups' order.

        arrival: all robots, those that came first in front. world_is_given: by priors or pins; without, the
        world is the frame of the robot that came first, and stays where it is.
        """
        held = [h for h in (_left(h, groups, arrival) for h in held) if h is not None]
        world = next((h for h in held if h.is_world), None)
        given = next((g for g in groups if g.in_world), None)
        if world is not None and given is not None:
            if _is_lent(world, given, groups):
                held = [h for h in held if h is not world]
            else:
                # It stays the frame of those that it was of; the world is another one from now on.
                world = None
        placed = [
            self._in_world(g, world, arrival)
            if g.in_world
            else self._placed(g, held, arrival, world_is_given)
            for g in groups
        ]
        if world_is_given or any(h.is_world for h in placed):
            return placed
        first = next((n for n in arrival if any(n in h.poses for h in placed)), None)
        return [Held(h.frame, h.anchor, first in h.poses, h.poses) for h in placed]

    def _in_world(self, group: Group, world: Held | None, arrival: Sequence[str]) -> Held:
        """The group in the world that is given, which takes on the frame of the world that was, if any."""
        if world is not None and world.anchor in group.poses:
            return Held(world.frame, world.anchor, True, group.poses)
        first = next(n for n in arrival if n in group.poses)
        return Held(next(self._numbers) if world is None else world.frame, first, True, group.poses)

    def _placed(
        self, group: Group, held: Sequence[Held], arrival: Sequence[str], world_is_given: bool
    ) -> Held:
        first = next(n for n in arrival if n in group.poses)
        # The frame of the world is kept, then that of most robots, then that of the first.
        own = [h for h in held if h.anchor in group.poses]
        if not own:
            return Held(next(self._numbers), first, False, seen_from(group.poses, first, np.zeros(3)))
        lends = max(
            own,
            key=lambda h: (h.is_world, len(h.poses.keys() & group.poses.keys()), -arrival.index(h.anchor)),
        )
        poses = seen_from(group.poses, lends.anchor, lends.poses[lends.anchor])
        return Held(lends.frame, lends.anchor, lends.is_world and not world_is_given, poses)


def _is_lent(world: Held, given: Group, groups: Sequence[Group]) -> bool:
    """Whether the world that is given takes on the frame of the one that was: where no other group has its
    anchor, or some robot is still where it was."""
    if not any(world.anchor in g.poses for g in groups if g is not given):
        return True
    return any(
        np.allclose(T, world.poses[n], atol=MOST_NOISE) for n, T in given.poses.items() if n in world.poses
    )


def _left(held: Held, groups: Sequence[Group], arrival: Sequence[str]) -> Held | None:
    """What is left of a component whose robots may be gone; the first that stays is the anchor then."""
    there = {n for g in groups for n in g.poses}
    poses = {n: T for n, T in held.poses.items() if n in there}
    if not poses:
        return None
    anchor = held.anchor if held.anchor in poses else next(n for n in arrival if n in poses)
    return Held(held.frame, anchor, held.is_world, poses)


def seen_from(poses: Mapping[str, Pose], anchor: str, T_frame_anchor: Pose) -> dict[str, Pose]:
    """Poses of one frame in the one in which the anchor lies at T_frame_anchor."""
    T_frame_group = se2.compose(T_frame_anchor, se2.inverse(poses[anchor]))
    return {
        n: np.array(T_frame_anchor) if n == anchor else se2.compose(T_frame_group, T)
        for n, T in poses.items()
    }


def steady(
    new: Sequence[Held],
    old: Sequence[Held],
    cells: Mapping[str, KnownCells],
    covariances: Mapping[str, NDArray[np.float64]],
    exact: Collection[str],
    refine_cells: float,
) -> list[Held]:
    """New poses, or the old ones in the same frame where these differ by noise alone.

    That is where no known cell moves by more than so many cells, or by more than the pose's own standard
    deviation. exact: robots that are pinned.
    """
    before = {h.frame: h.poses for h in old}

    def settled(frame: int, name: str, T: Pose) -> Pose:
        held = before.get(frame, {}).get(name)
        if held is None or name in exact:
            return T
        own = cells[name]
        metres, radians = apart(held, T, own.centre)
        noise = refine_cells * own.resolution
        if name in covariances:
            variances = np.diag(covariances[name])
            deviation = math.sqrt(variances[0] + variances[1]) + own.radius * math.sqrt(variances[2])
            noise = max(noise, min(deviation, MOST_NOISE))
        return held if metres + own.radius * radians <= noise else T

    return [
        Held(h.frame, h.anchor, h.is_world, {n: settled(h.frame, n, T) for n, T in h.poses.items()})
        for h in new
    ]
