"""The generated buildings: office, floor, cells, halls, wings, symmetric."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mapmeld.simulate.floorplan import Door, Floorplan, Size, chosen_size
from mapmeld.simulate.rooms import RoomStyle, divide, row_of_rooms

_CORRIDOR = (1.6, 2.6)
"""Narrowest and widest corridor, in metres: no two buildings have the same."""


def office(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Four rows of offices along two corridors, which two cross corridors join; no two rooms alike."""
    width, height = chosen_size(size, (40.0, 24.0), (20.0, 16.0), "an office")
    corridor = float(rng.uniform(*_CORRIDOR))
    depths = rng.uniform(0.8, 1.2, 4)
    first, second, third, _ = (float(v) for v in np.cumsum(depths) / depths.sum() * (height - 2 * corridor))
    low, high = (first, first + corridor), (third + corridor, third + 2 * corridor)
    middle = second + corridor
    cross = float(rng.uniform(0.5, 0.7)) * width
    plan = Floorplan(thickness)
    for y in (low, high):
        plan.floor(0.0, y[0], width, y[1])
    for x in ((0.0, corridor), (cross, cross + corridor)):
        plan.floor(x[0], low[1], x[1], high[0])
    plan.wall_y(0.0, 0.0, height)
    plan.wall_y(width, 0.0, height)
    row_of_rooms(plan, rng, (0.0, width), low[0], 0.0)
    row_of_rooms(plan, rng, (0.0, width), high[1], height)
    for x in ((corridor, cross), (cross + corridor, width)):
        row_of_rooms(plan, rng, x, low[1], middle)
        row_of_rooms(plan, rng, x, high[0], middle)
    return plan


def floor(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """A floor of any extent: corridors with offices on both sides every 13 m or so, cross ones every 30 m."""
    width, height = chosen_size(size, (100.0, 100.0), (20.0, 12.0), "a floor")
    rows = max(1, round(height / 13.0))
    corridors = rng.uniform(*_CORRIDOR, rows)
    depths = rng.uniform(0.8, 1.2, 2 * rows)
    depths *= (height - corridors.sum()) / depths.sum()
    plan = Floorplan(thickness)
    for x in (0.0, width):
        plan.wall_y(x, 0.0, height)
    blocks = divide(rng, 0.0, width, (25.0, 35.0))
    base, previous = 0.0, 0.0
    for k in range(rows):
        low = base + float(depths[2 * k])
        high = low + float(corridors[k])
        far = high + float(depths[2 * k + 1])
        plan.floor(0.0, low, width, high)
        # The cross corridors lead from the corridor below to this one, somewhere else in every row.
        crossings = []
        if k:
            for left, right in pairwise(blocks):
                crossing = float(rng.uniform(*_CORRIDOR))
                start = left + float(rng.uniform(0.2, 0.8)) * (right - left - crossing)
                plan.floor(start, previous, start + crossing, low)
                crossings.append((start, start + crossing))
        edges = [0.0, *(x for crossing in crossings for x in crossing), width]
        for span in pairwise(edges):
            if span not in crossings:
                if k:
                    row_of_rooms(plan, rng, span, previous, base)
                row_of_rooms(plan, rng, span, low, base)
        base, previous = far, high
    row_of_rooms(plan, rng, (0.0, width), previous, base)
    return plan


def cells(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Offices of one size and door on both sides of a corridor; what tells one from the next is furniture."""
    width, height = chosen_size(size, (48.0, 14.0), (16.0, 10.0), "a row of cells")
    corridor, room = float(rng.uniform(*_CORRIDOR)), float(rng.uniform(2.8, 4.5))
    style = RoomStyle(width=(room, room), door=(0.9, 0.9), door_at=float(rng.uniform(0.25, 0.75)))
    low, high = (height - corridor) / 2, (height + corridor) / 2
    plan = Floorplan(thickness)
    plan.floor(0.0, low, width, high)
    for x in (0.0, width):
        plan.wall_y(x, low, high)
    row_of_rooms(plan, rng, (0.0, width), low, 0.0, style)
    row_of_rooms(plan, rng, (0.0, width), high, height, style)
    return plan


def halls(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Halls of 14 to 30 m, some with pillars, on both sides of a corridor as long as the building."""
    width, height = chosen_size(size, (120.0, 50.0), (40.0, 24.0), "a building of halls")
    corridor = float(rng.uniform(3.0, 5.0))
    plan = Floorplan(thickness)
    low, high = (height - corridor) / 2, (height + corridor) / 2
    plan.floor(0.0, low, width, high)
    for x in (0.0, width):
        plan.wall_y(x, low, high)
    for y_door, side in ((low, -1.0), (high, 1.0)):
        borders = divide(rng, 0.0, width, (14.0, 30.0))
        doors: list[Door] = []
        for left, right in pairwise(borders):
            y_far = y_door + side * float(rng.uniform(0.6, 1.0)) * low
            doors += _hall(plan, rng, (left, right), y_door, y_far)
        plan.wall_x(y_door, 0.0, width, doors)
    return plan


def wings(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Equal wings, a copy of one another, along a spine corridor; the rooms across the spine differ."""
    width, height = chosen_size(size, (60.0, 28.0), (26.0, 18.0), "a building of wings")
    corridor, spine = float(rng.uniform(*_CORRIDOR)), float(rng.uniform(2.4, 3.6))
    south, side = float(rng.uniform(4.0, 5.0)), float(rng.uniform(4.0, 5.0))
    base = south + spine
    wing = Floorplan(thickness)
    length = height - base
    wing.floor(0.0, 0.0, length, corridor)
    wing.wall_y(length, 0.0, corridor)
    row_of_rooms(wing, rng, (0.0, length), 0.0, -side)
    row_of_rooms(wing, rng, (0.0, length), corridor, corridor + side)
    wing = wing.transposed()
    plan = Floorplan(thickness)
    plan.floor(0.0, south, width, base)
    for x in (0.0, width):
        plan.wall_y(x, south, base)
    row_of_rooms(plan, rng, (0.0, width), south, 0.0)
    count = max(2, int(width // (2 * side + corridor + 1.0)))
    doors: list[Door] = []
    for k in range(count):
        centre = (k + 0.5) * width / count
        plan.add(wing, centre - corridor / 2, base)
        doors.append((centre, corridor))
    # The first walls of a wing's rooms lie on the spine's wall, which is open at the wing's corridor only.
    plan.wall_x(base, 0.0, width, doors)
    return plan


def symmetric(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """A block around a ring of corridors that a turn by 180 degrees takes to itself, furniture included."""
    width, height = chosen_size(size, (30.0, 24.0), (16.0, 16.0), "a symmetric block")
    corridor = float(rng.uniform(*_CORRIDOR))
    depth = (height - 2 * corridor) / 4
    low, high = height - depth - corridor, height - depth
    half = Floorplan(thickness)
    half.floor(0.0, low, width, high)
    for x in ((0.0, corridor), (width - corridor, width)):
        half.floor(x[0], height / 2, x[1], low)
    for edge in (0.0, width):
        half.wall_y(edge, height / 2, height)
    row_of_rooms(half, rng, (0.0, width), high, height)
    row_of_rooms(half, rng, (corridor, width - corridor), low, height / 2)
    plan = half.turned_copy(width / 2, height / 2)
    plan.add(half)
    return plan


def _hall(
    plan: Floorplan, rng: np.random.Generator, x: tuple[float, float], y_door: float, y_far: float
) -> list[Door]:
    """Adds one hall; returns its doors, which are cut into the wall at y_door."""
    left, right = x
    plan.floor(left, y_door, right, y_far)
    plan.wall_x(y_far, left, right)
    for edge in x:
        plan.wall_y(edge, min(y_door, y_far), max(y_door, y_far))
    inward = 1.0 if y_far > y_door else -1.0
    if rng.random() < 0.5:
        pitch, side = float(rng.uniform(5.0, 7.0)), float(rng.uniform(0.3, 0.6))
        for px in np.arange(left + pitch / 2, right - 1.0, pitch):
            for away in np.arange(pitch / 2, abs(y_far - y_door) - 1.0, pitch):
                py = y_door + inward * float(away)
                plan.solid(float(px), py, float(px) + side, py + inward * side)
    for _ in range(int(rng.integers(1, 5))):
        # Stands and machines: clear of the walls, so that no door is blocked.
        w, d = (float(v) for v in rng.uniform(0.8, 3.0, 2))
        px = float(rng.uniform(left + 2.0, right - 2.0 - w))
        py = y_door + inward * float(rng.uniform(2.5, abs(y_far - y_door) - 1.0 - d))
        plan.solid(px, py, px + w, py + inward * d)
    centres = divide(rng, left, right, (8.0, 14.0))
    return [((a + b) / 2, float(rng.uniform(2.0, 3.0))) for a, b in pairwise(centres)]
