"""Maps that lack a class of cells, which hardly anything can be merged with."""

from __future__ import annotations

import numpy as np

from mapmeld.grid import OccupancyGrid

_FREE_AT_MOST, _OCCUPIED_AT_LEAST = 25, 65
"""Percent, as the core has them."""


def lacking_class(grid: OccupancyGrid) -> str | None:
    """What a map that knows something lacks, and what to do. None where it has free, occupied and unknown
    cells, knows nothing, or ends at its walls."""
    cells = grid.data
    is_occupied = cells >= _OCCUPIED_AT_LEAST
    is_free = (cells >= 0) & (cells <= _FREE_AT_MOST)
    has_walls, has_floor = bool(is_occupied.any()), bool(is_free.any())
    if has_walls and not has_floor:
        return (
            "has no free cell; a wall is known by the floor before it, so nothing can be merged with this "
            "map: check free_thresh in its yaml, and that it was saved with its floor"
        )
    if has_floor and not has_walls:
        return (
            "has no occupied cell, so nothing can be merged with this map: check occupied_thresh in its "
            "yaml, and that it was saved with its walls"
        )
    # A closed hall that ends at its walls knows every cell as well.
    rim = np.concatenate([is_free[0], is_free[-1], is_free[:, 0], is_free[:, -1]])
    if has_walls and (is_occupied | is_free).all() and rim.mean() > 0.5:
        return (
            "has no unknown cell; what lies beyond its walls counts as seen to be free, and speaks against "
            "whatever other maps show there; if unknown cells were made free when it was edited or saved, "
            "save it anew"
        )
    return None
