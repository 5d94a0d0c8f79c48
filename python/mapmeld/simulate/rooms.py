"""Rooms in a row, with doors and furniture: what the generated buildings are made of."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mapmeld.simulate.floorplan import Door, Floorplan


@dataclass(frozen=True)
class RoomStyle:
    """How the rooms of a row vary. Lengths in metres, each a (smallest, largest) pair.

    width: of a room along the row. door: width of a door. door_at: where in its room's front a door is, 0..1;
        None: anywhere. furnished: share of rooms with furniture.
    """

    width: tuple[float, float] = (3.0, 5.5)
    door: tuple[float, float] = (0.9, 1.1)
    door_at: float | None = None
    furnished: float = 0.8


def divide(rng: np.random.Generator, start: float, end: float, width: tuple[float, float]) -> list[float]:
    """Borders of pieces between start and end, both included, with lengths of about `width`."""
    count = max(1, round((end - start) / ((width[0] + width[1]) / 2)))
    parts = rng.uniform(width[0], width[1], count)
    return [float(v) for v in start + (end - start) * np.concatenate([[0.0], np.cumsum(parts) / parts.sum()])]


def row_of_rooms(
    plan: Floorplan,
    rng: np.random.Generator,
    x: tuple[float, float],
    y_door: float,
    y_far: float,
    style: RoomStyle = RoomStyle(),
) -> None:
    """Adds rooms side by side along x, with their doors in the wall at y_door and their far wall at y_far."""
    borders = divide(rng, x[0], x[1], style.width)
    plan.floor(x[0], y_door, x[1], y_far)
    doors: list[Door] = []
    for left, right in pairwise(borders):
        width = float(rng.uniform(*style.door))
        slack = width / 2 + 0.25
        # A room that is hardly wider than its door has it in the middle.
        centre = (left + right) / 2
        if right - left > 2 * slack:
            at = float(rng.random()) if style.door_at is None else style.door_at
            centre = left + slack + at * (right - left - 2 * slack)
        doors.append((centre, width))
        if rng.random() < style.furnished:
            _furnish(plan, rng, (left, right), y_door, y_far)
    plan.wall_x(y_door, x[0], x[1], doors)
    plan.wall_x(y_far, x[0], x[1])
    for border in borders:
        plan.wall_y(border, min(y_door, y_far), max(y_door, y_far))


def _furnish(
    plan: Floorplan, rng: np.random.Generator, x: tuple[float, float], y_door: float, y_far: float
) -> None:
    """A desk at the far wall and a cabinet or two at a side wall, in the half away from the door."""
    inward = 1.0 if y_door > y_far else -1.0
    half = plan.thickness / 2
    left, right = x[0] + half, x[1] - half
    depth = abs(y_far - y_door)
    wall = y_far + inward * half
    desk = min(float(rng.uniform(1.2, 1.8)), (right - left) * 0.5)
    start = float(rng.uniform(left, right - desk))
    plan.solid(start, wall, start + desk, wall + inward * float(rng.uniform(0.6, 0.9)))
    for _ in range(int(rng.integers(0, 3))):
        long, deep = float(rng.uniform(0.5, 1.2)), float(rng.uniform(0.35, 0.5))
        at = wall + inward * float(rng.uniform(0.0, max(0.1, depth / 2 - long)))
        if rng.random() < 0.5:
            plan.solid(left, at, left + deep, at + inward * long)
        else:
            plan.solid(right - deep, at, right, at + inward * long)
