"""Maps that lack a class of cells, or have two of them confused: hardly anything can be merged with these."""

from __future__ import annotations

import numpy as np

from mapmeld.grid import OccupancyGrid

_FREE_AT_MOST, _OCCUPIED_AT_LEAST, _MOST = 25, 65, 100
"""Percent, as the core has them (grid.rs)."""


def lacking_class(grid: OccupancyGrid) -> str | None:
    """What a map that knows something lacks, and what to do. None where it has free, occupied and unknown
    cells, more free than occupied ones, knows nothing, or ends at its walls."""
    # As bytes, unknown cells are the largest.
    cells = grid.data.view(np.uint8)
    has_walls = int(grid.data.max()) >= _OCCUPIED_AT_LEAST
    has_floor = int(cells.min()) <= _FREE_AT_MOST
    if has_walls and not has_floor:
        return (
            "has no free cell; a wall is known by the floor before it, so nothing can be merged with this "
            "map: check the thresholds that it was saved with, and that it was saved with its floor"
        )
    if has_floor and not has_walls:
        return (
            "has no occupied cell, so nothing can be merged with this map: check the thresholds that it was "
            "saved with, and that it was saved with its walls"
        )
    if has_walls and has_floor:
        occupied = int(((cells >= _OCCUPIED_AT_LEAST) & (cells <= _MOST)).sum())
        free = int((cells <= _FREE_AT_MOST).sum())
        if occupied > free:
            return (
                f"has more occupied cells ({occupied}) than free ones ({free}), which is not to be expected: "
                "check the thresholds that it was drawn with, and `negate` in the yaml file of a saved one"
            )
    # A closed hall that ends at its walls knows every cell as well.
    rim = np.concatenate([cells[0], cells[-1], cells[:, 0], cells[:, -1]])
    is_open = has_walls and (rim <= _FREE_AT_MOST).mean() > 0.5
    undecided = (cells > _FREE_AT_MOST) & (cells < _OCCUPIED_AT_LEAST) | (cells > _MOST) if is_open else None
    if undecided is not None and not undecided.any():
        return (
            "has no unknown cell; what lies beyond its walls counts as seen to be free, and speaks against "
            "whatever other maps show there: if unknown cells were made free when it was edited or saved, "
            "save it anew"
        )
    return None
