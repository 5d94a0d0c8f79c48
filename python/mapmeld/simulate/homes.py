"""The generated home: small rooms of all proportions, full of furniture, that lead into each other."""

from __future__ import annotations

import numpy as np

from mapmeld.simulate.floorplan import Floorplan, Rectangle, Size, chosen_size

_SIDE = 2.0
"""Least side of a room, metres."""
_WAY = 0.75
"""Least room to pass between things, metres."""
_Door = tuple[float, float, float]
"""Its middle (x, y) and its width, metres."""


def home(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """A rectangle halved again and again; every cut is a wall with a door or a wider opening.

    Furniture stands along the walls of every room and in the middle of large ones. Some corners of the
    outline belong to somebody else.
    """
    width, height = chosen_size(size, (14.0, 10.0), (7.0, 6.0), "a home")
    plan = Floorplan(thickness)
    plan.room(0.0, 0.0, width, height)
    rooms = _rooms(plan, rng, (0.0, 0.0, width, height), [])
    entered = [r for r in rooms if len(r[1]) == 1 and _is_corner(r[0], width, height)]
    closed = entered[: int(rng.integers(0, 3))] if len(rooms) > 3 else []
    for room in rooms:
        if room in closed:
            plan.solid(*room[0])
        else:
            _furnish(plan, rng, *room)
    return plan


def _rooms(
    plan: Floorplan, rng: np.random.Generator, box: Rectangle, doors: list[_Door]
) -> list[tuple[Rectangle, list[_Door]]]:
    """Cuts a box into rooms, with the doors of each."""
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    # Across the longer side, where no door would meet the wall.
    is_upright = bool(w * rng.uniform(0.8, 1.25) > h)
    low, high = (x0, x1) if is_upright else (y0, y1)
    cuts = [float(v) for v in rng.uniform(low + _SIDE, high - _SIDE, 8)] if high - low > 2 * _SIDE else []
    lines = [d for d in doors if _on_side(d, box, is_upright)]
    free = [c for c in cuts if all(abs(d[not is_upright] - c) > d[2] / 2 + 0.2 for d in lines)]
    if not free or w * h < float(rng.uniform(9.0, 24.0)):
        return [(box, doors)]
    cut = min(free, key=lambda c: abs(c - (low + high) / 2) + float(rng.uniform(0.0, 0.5)) * (high - low))
    start, end = (y0, y1) if is_upright else (x0, x1)
    wide = min(float(rng.uniform(1.4, 2.6)) if rng.random() < 0.25 else float(rng.uniform(0.8, 1.0)), 1.6)
    at = float(rng.uniform(start + wide / 2 + 0.15, end - wide / 2 - 0.15))
    if is_upright:
        plan.wall_y(cut, start, end, [(at, wide)])
        door, halves = (cut, at, wide), ((x0, y0, cut, y1), (cut, y0, x1, y1))
    else:
        plan.wall_x(cut, start, end, [(at, wide)])
        door, halves = (at, cut, wide), ((x0, y0, x1, cut), (x0, cut, x1, y1))
    of = [[d for d in doors if _touches(d, half)] for half in halves]
    return [r for half, d in zip(halves, of, strict=True) for r in _rooms(plan, rng, half, [*d, door])]


def _on_side(door: _Door, box: Rectangle, is_upright: bool) -> bool:
    """Whether a door lies in a wall that a cut of the box would meet."""
    at, sides = (door[1], (box[1], box[3])) if is_upright else (door[0], (box[0], box[2]))
    return min(abs(at - s) for s in sides) < 1e-6


def _touches(door: _Door, box: Rectangle) -> bool:
    return box[0] - 1e-6 <= door[0] <= box[2] + 1e-6 and box[1] - 1e-6 <= door[1] <= box[3] + 1e-6


def _is_corner(box: Rectangle, width: float, height: float) -> bool:
    return (box[0] == 0.0 or box[2] == width) and (box[1] == 0.0 or box[3] == height)


def _furnish(plan: Floorplan, rng: np.random.Generator, box: Rectangle, doors: list[_Door]) -> None:
    """Things along the walls, which leave a way between them, and a table where there is room around it."""
    half = plan.thickness / 2
    x0, y0, x1, y1 = box[0] + half, box[1] + half, box[2] - half, box[3] - half
    # Nothing stands in front of a door.
    kept = [(x - w / 2 - 0.1, y - w / 2 - 0.1, x + w / 2 + 0.1, y + w / 2 + 0.1) for x, y, w in doors]
    kept = [(a - 0.4, b - 0.4, c + 0.4, d + 0.4) for a, b, c, d in kept]
    stood: list[Rectangle] = []
    most = min(x1 - x0, y1 - y0) - _WAY
    for _ in range(int(rng.integers(4, 14))):
        long, deep = float(rng.uniform(0.5, 2.1)), float(rng.uniform(0.3, 0.65))
        if rng.random() < 0.25:
            long, deep = float(rng.uniform(1.6, 2.1)), float(rng.uniform(0.9, 1.8))
        if rng.random() < 0.5:
            long, deep = deep, long
        if long > most or deep > most:
            continue
        x, y = float(rng.uniform(x0, x1 - long)), float(rng.uniform(y0, y1 - deep))
        side = int(rng.integers(4))
        x = (x0, x1 - long, x, x)[side]
        y = (y, y, y0, y1 - deep)[side]
        thing = (x, y, x + long, y + deep)
        if not any(_meet(thing, k, 0.0) for k in kept) and _leaves_way(thing, stood):
            stood.append(thing)
            plan.solid(*thing)
    long, deep = float(rng.uniform(0.7, 2.0)), float(rng.uniform(0.6, 1.1))
    if x1 - x0 > long + 2 * _WAY and y1 - y0 > deep + 2 * _WAY and rng.random() < 0.7:
        x = float(rng.uniform(x0 + _WAY, x1 - _WAY - long))
        y = float(rng.uniform(y0 + _WAY, y1 - _WAY - deep))
        table = (x, y, x + long, y + deep)
        if not any(_meet(table, k, 0.0) for k in kept) and not any(_meet(table, k, _WAY) for k in stood):
            plan.solid(*table)


def _leaves_way(thing: Rectangle, others: list[Rectangle]) -> bool:
    """Whether things stand side by side, or far enough from each other to pass between them."""
    return all(
        not _meet(thing, o, _WAY) or (_meet(thing, o, 0.1) and not _meet(thing, o, 0.0)) for o in others
    )


def _meet(one: Rectangle, other: Rectangle, room: float) -> bool:
    """Whether two boxes come closer than so many metres."""
    a, b, c, d = other
    return one[0] < c + room and one[2] > a - room and one[1] < d + room and one[3] > b - room
