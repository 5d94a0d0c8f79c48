"""Where maps contradict each other, and how deep: a wall at the rim of another is bending, one amid its free
floor is not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.report_page.raster import FREE_BELOW, OCCUPIED_FROM
from mapmeld.report_page.story import Layers, Story

DEPTHS_CELLS = (2, 5)
"""How far a wall lies from every wall of a map that shows free floor there: beyond the first it is deep in
that floor, beyond the second amid it."""
DEEP, AMID = 2, 3


@dataclass(frozen=True, eq=False)
class Contest:
    """strength: uint8, of each cell of the merged map: 0 no conflict, 1 at the rim of a wall, 2 deep, 3 amid
    free floor. shares: by name, the share of a map's walls that lie amid the free floor of another, 0..1."""

    strength: NDArray[np.uint8]
    shares: Mapping[str, float]


def contest(layers: Layers, order: Sequence[str], story: Story) -> Contest:
    """order: the maps of the component."""
    merged = layers.merged
    own = {name: _wall_cells(story.grids[name], story.pose(name), merged) for name in order}
    has_wall = np.zeros(merged.data.size, dtype=bool)
    for walls in own.values():
        has_wall[walls] = True
    cells = np.flatnonzero(has_wall)
    centres = merged.cell_centers(cells // merged.width, cells % merged.width)
    against = np.zeros(cells.size, dtype=np.uint8)
    for name in order:
        _add_free(against, centres, story.grids[name], story.pose(name), merged.resolution)
    strength = layers.conflicts.astype(np.uint8)
    for level in (DEEP, AMID):
        hit = np.zeros(merged.data.size, dtype=bool)
        hit[cells[against >= level]] = True
        # Walls are taken to the nearest cell, the merged map asks each map at its cells: one may be between.
        strength[layers.conflicts & near_to(hit.reshape(merged.data.shape), 1)] = level
    shares = {
        name: float((against[np.searchsorted(cells, walls)] == AMID).mean()) if walls.size else 0.0
        for name, walls in own.items()
    }
    return Contest(strength, shares)


def near_to(cells: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Cells that are within so many rows and columns of a set one."""
    for axis in (0, 1):
        out = cells.copy()
        for k in range(1, reach + 1):
            low, high = (slice(k, None), slice(None, -k)) if axis == 0 else (np.s_[:, k:], np.s_[:, :-k])
            out[low] |= cells[high]
            out[high] |= cells[low]
        cells = out
    return cells


def _wall_cells(grid: OccupancyGrid, T: NDArray[np.float64], merged: OccupancyGrid) -> NDArray[np.int64]:
    """Flat indices of the merged map's cells that a placed map's walls fall on."""
    rows, cols = np.nonzero(grid.data >= OCCUPIED_FROM)
    row, col, inside = _cells_of(merged, se2.apply(T, grid.cell_centers(rows, cols)), merged.origin)
    return np.unique(row[inside] * merged.width + col[inside])


def _add_free(
    against: NDArray[np.uint8],
    centres: NDArray[np.float64],
    grid: OccupancyGrid,
    T: NDArray[np.float64],
    resolution: float,
) -> None:
    """Marks how deep the points lie in what a placed map shows as free floor, away from its own walls."""
    walls = grid.data >= OCCUPIED_FROM
    depth = np.zeros(grid.data.shape, dtype=np.uint8)
    for level, cells in zip((DEEP, AMID), DEPTHS_CELLS, strict=True):
        reach = math.ceil(cells * max(grid.resolution, resolution) / grid.resolution - 1e-9)
        depth[(grid.data >= 0) & (grid.data <= FREE_BELOW) & ~near_to(walls, reach)] = level
    frame = se2.compose(T, np.array(grid.origin))
    sides = np.array([(0, 0), (0, grid.height), (grid.width, 0), (grid.width, grid.height)])
    around = se2.apply(frame, sides * grid.resolution)
    # The points come row by row: those at the map's height are one piece.
    low, high = around.min(axis=0), around.max(axis=0)
    first, last = np.searchsorted(centres[:, 1], (low[1], high[1]))
    across = centres[first:last, 0]
    chosen = first + np.flatnonzero((across >= low[0]) & (across <= high[0]))
    row, col, inside = _cells_of(grid, centres[chosen], frame)
    chosen = chosen[inside]
    against[chosen] = np.maximum(against[chosen], depth[row[inside], col[inside]])


def _cells_of(
    grid: OccupancyGrid, points: NDArray[np.float64], frame: Sequence[float] | NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Row and column of points, and whether the grid has them. frame: pose of its lower left corner."""
    local = se2.apply(se2.inverse(np.array(frame)), points) / grid.resolution
    col, row = np.floor(local).astype(np.int64).T
    return row, col, (row >= 0) & (row < grid.height) & (col >= 0) & (col < grid.width)
