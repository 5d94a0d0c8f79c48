"""The generated corridors: long, in rings, and told from each other by their doors and recesses alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mapmeld.simulate.floorplan import Floorplan, Rectangle, Size, chosen_size
from mapmeld.simulate.rooms import divide

_DEEPEST = 2.0
"""Of the strip of a block in which its doors and recesses lie, metres."""


def corridors(rng: np.random.Generator, size: Size | None, thickness: float) -> Floorplan:
    """Closed blocks of unlike sizes with corridors around them; nobody looks into a room.

    Doors lie a little deep in the walls, at the pitch of rooms; some walls have a wide recess, some a pier.
    """
    width, height = chosen_size(size, (140.0, 70.0), (40.0, 25.0), "a world of corridors")
    plan = Floorplan(thickness)
    plan.room(0.0, 0.0, width, height)
    way = float(rng.uniform(1.8, 2.8))
    columns = divide(rng, way / 2, width - way / 2, (20.0, 60.0))
    for left, right in pairwise(columns):
        for low, high in pairwise(divide(rng, way / 2, height - way / 2, (18.0, 45.0))):
            block = (left + way / 2, low + way / 2, right - way / 2, high - way / 2)
            _block(plan, rng, block)
    # Two of the outer walls have doors as well: frames that stand out beside them.
    for x in np.cumsum(rng.uniform(2.5, 7.0, int(width / 5.0))):
        if x < width - 1.0:
            plan.solid(float(x), 0.0, float(x) + 0.3, float(rng.uniform(0.1, 0.3)))
            plan.solid(float(x), height - float(rng.uniform(0.1, 0.3)), float(x) + 0.3, height)
    return plan


def _block(plan: Floorplan, rng: np.random.Generator, box: Rectangle) -> None:
    """A solid block whose sides are walls with doors and recesses."""
    x0, y0, x1, y1 = box
    plan.solid(x0 + _DEEPEST, y0 + _DEEPEST, x1 - _DEEPEST, y1 - _DEEPEST)
    for start, end, depth in _front(rng, x0, x1):
        plan.solid(start, y0 + depth, end, y0 + _DEEPEST)
    for start, end, depth in _front(rng, x0, x1):
        plan.solid(start, y1 - _DEEPEST, end, y1 - depth)
    for start, end, depth in _front(rng, y0, y1):
        plan.solid(x0 + depth, start, x0 + _DEEPEST, end)
    for start, end, depth in _front(rng, y0, y1):
        plan.solid(x1 - _DEEPEST, start, x1 - depth, end)


def _front(rng: np.random.Generator, start: float, end: float) -> list[tuple[float, float, float]]:
    """The pieces of a wall from corner to corner, each with how deep it lies, metres."""
    pieces: list[tuple[float, float, float]] = []
    for low, high in pairwise(divide(rng, start, end, (2.5, 7.0))):
        kind = rng.random()
        wide, depth = float(rng.uniform(0.85, 1.1)), float(rng.uniform(0.08, 0.3))
        if kind < 0.1:
            wide, depth = float(rng.uniform(1.5, 2.2)), float(rng.uniform(0.5, 1.8))
        elif kind < 0.2:
            wide, depth = float(rng.uniform(0.3, 0.6)), -float(rng.uniform(0.1, 0.25))
        elif kind < 0.35:
            wide = 0.0
        # The corners of the block stay.
        at = float(rng.uniform(low, max(low, high - wide)))
        first, last = max(at, start + 0.4), min(at + wide, end - 0.4)
        if last - first < 0.2:
            pieces.append((low, high, 0.0))
        else:
            pieces += [(low, first, 0.0), (first, last, depth), (last, high, 0.0)]
    return pieces
