"""The generated floors of few walls: concourse, warehouse. What stands there repeats itself, never quite."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapmeld.simulate.floorplan import Floorplan, Rectangle, Size, chosen_size
from mapmeld.simulate.rooms import row_of_rooms

_ROBOT_WAY = 1.2
"""Least room between things that stand about, metres: robots pass everywhere."""
_SLABS = 9
"""Boxes that a round pillar is made of."""


def concourse(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """An open floor with round pillars in a lattice around equal blocks at equal distances.

    The sides of the blocks are bays, alike from block to block but for one in six; kiosks stand about.
    """
    width, height = chosen_size(size, (80.0, 50.0), (36.0, 24.0), "a concourse")
    plan = Floorplan(thickness)
    plan.room(0.0, 0.0, width, height)
    way = float(rng.uniform(5.0, 8.0))
    count = max(2, round(width / float(rng.uniform(18.0, 28.0))))
    deep = height - 2 * way - float(rng.uniform(0.0, 0.2)) * height
    long = (width - (count + 1) * way) / count
    bay = float(rng.uniform(3.0, 6.0))
    usual = {side: rng.random(int(length // bay)) for side, length in (("x", long), ("y", deep))}
    for k in range(count):
        left = way + k * (long + way)
        _block(plan, rng, (left, way, left + long, way + deep), bay, usual)
    pitch, radius = float(rng.uniform(4.0, 9.0)), float(rng.uniform(0.15, 0.45))
    for x in np.arange(pitch / 2, width - 1.0, pitch):
        for y in (way / 2, height - (height - way - deep) / 2):
            _pillar(plan, float(x), y, radius)
    for x in (way / 2 + k * (long + way) for k in range(count + 1)):
        for y in np.arange(way + pitch / 2, way + deep - 1.0, pitch):
            _pillar(plan, x, float(y), radius)
    _stand_about(plan, rng, (0.0, 0.0, width, height), round(width * height / 150.0))
    return plan


def warehouse(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Rows of racks, all of one build, with pallets in some of their bays, between docks and offices.

    A laser sees the posts of the racks and what stands between them.
    """
    width, height = chosen_size(size, (60.0, 40.0), (30.0, 34.0), "a warehouse")
    plan = Floorplan(thickness)
    plan.room(0.0, 0.0, width, height)
    apron, office = float(rng.uniform(6.0, 9.0)), float(rng.uniform(4.0, 6.0))
    _docks(plan, rng, width)
    plan.wall_y(width * 0.4, height - office, height)
    row_of_rooms(plan, rng, (0.0, width * 0.4), height - office, height)
    aisle, bay, deep = (float(rng.uniform(*r)) for r in ((2.6, 3.6), (2.4, 3.6), (0.9, 1.2)))
    cross = float(rng.uniform(2.5, 4.0))
    middle = (apron + height - office - cross) / 2
    full = float(rng.uniform(0.4, 0.8))
    for x in np.arange(2.0, width - 2.0 - 2 * deep, 2 * deep + aisle):
        for low, high in ((apron, middle - cross / 2), (middle + cross / 2, height - office - cross)):
            for side in (0.0, deep):
                _rack(plan, rng, (float(x) + side, low, high), bay, deep, full)
    for x in np.arange(2.0 + deep, width - 2.0, 2 * (2 * deep + aisle)):
        # Pillars of the roof, in line with every second row.
        plan.solid(float(x) - 0.2, apron / 2 - 0.2, float(x) + 0.2, apron / 2 + 0.2)
    _stand_about(plan, rng, (0.0, 0.0, width, apron), round(width / 10.0))
    return plan


def _block(
    plan: Floorplan,
    rng: np.random.Generator,
    box: Rectangle,
    bay: float,
    usual: dict[str, NDArray[np.float64]],
) -> None:
    """A block whose sides have a niche, a pier or nothing in each bay; one bay in four is drawn anew."""
    x0, y0, x1, y1 = box
    depth = 0.6
    plan.solid(x0 + depth, y0 + depth, x1 - depth, y1 - depth)
    for side, start, end in (("x", x0, x1), ("y", y0, y1)):
        for other in (False, True):
            kinds = np.where(rng.random(len(usual[side])) < 0.25, rng.random(len(usual[side])), usual[side])
            for k, kind in enumerate(kinds):
                at = start + k * bay
                to = min(end, at + bay) if k + 1 < len(kinds) else end
                # Below a third a niche: the bay stays as deep as the block's core. Above two thirds a pier.
                if kind < 1 / 3:
                    continue
                out = 0.3 if kind > 2 / 3 else 0.0
                if side == "x":
                    y = (y1 - depth, y1 + out) if other else (y0 - out, y0 + depth)
                    plan.solid(at, y[0], to, y[1])
                else:
                    x = (x1 - depth, x1 + out) if other else (x0 - out, x0 + depth)
                    plan.solid(x[0], at, x[1], to)


def _docks(plan: Floorplan, rng: np.random.Generator, width: float) -> None:
    """Gates in a row along the wall at y = 0, each between two posts; a lorry's bed fills some."""
    pitch = float(rng.uniform(4.0, 6.0))
    for x in np.arange(pitch / 2, width - pitch / 2, pitch):
        for post in (x - 1.5, x + 1.5):
            plan.solid(float(post) - 0.15, 0.0, float(post) + 0.15, 0.4)
        if rng.random() < 0.4:
            plan.solid(float(x) - 1.3, 0.0, float(x) + 1.3, float(rng.uniform(0.2, 0.6)))


def _rack(
    plan: Floorplan,
    rng: np.random.Generator,
    at: tuple[float, float, float],
    bay: float,
    deep: float,
    full: float,
) -> None:
    """A rack along y: posts at every bay, and up to three pallets in each."""
    x, low, high = at
    bays = int((high - low) // bay)
    for k in range(bays + 1):
        for post in (x, x + deep - 0.1):
            plan.solid(post, low + k * bay, post + 0.1, low + k * bay + 0.1)
    for k in range(bays):
        for place in range(3):
            if rng.random() < full:
                y = low + k * bay + 0.15 + place * (bay - 0.2) / 3 + float(rng.uniform(-0.05, 0.05))
                inset = 0.05 + float(rng.uniform(0.0, 0.1))
                plan.solid(x + inset, y, x + deep - inset, y + (bay - 0.2) / 3 - 0.15)


def _pillar(plan: Floorplan, x: float, y: float, radius: float) -> None:
    for k in range(_SLABS):
        low, high = (-1.0 + 2.0 * edge / _SLABS for edge in (k, k + 1))
        half = radius * math.sqrt(1.0 - ((low + high) / 2) ** 2)
        plan.solid(x - half, y + low * radius, x + half, y + high * radius)


def _stand_about(
    plan: Floorplan,
    rng: np.random.Generator,
    floor: Rectangle,
    count: int,
) -> None:
    """Boxes of 0.5 to 2 m, each with room to pass around it."""
    x0, y0, x1, y1 = floor
    taken = list(plan.solids)
    for _ in range(count):
        w, d = (float(v) for v in rng.uniform(0.5, 2.0, 2))
        x, y = float(rng.uniform(x0 + 1.5, x1 - 1.5 - w)), float(rng.uniform(y0 + 1.5, y1 - 1.5 - d))
        room = (x - _ROBOT_WAY, y - _ROBOT_WAY, x + w + _ROBOT_WAY, y + d + _ROBOT_WAY)
        if not any(a < room[2] and b < room[3] and c > room[0] and e > room[1] for a, b, c, e in taken):
            plan.solid(x, y, x + w, y + d)
            taken.append((x, y, x + w, y + d))
