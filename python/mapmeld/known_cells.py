"""Where the known cells of a map lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.grid import OccupancyGrid


@dataclass(frozen=True)
class KnownCells:
    """The known cells of one map.

    centre: mean of their centres, map coordinates, metres; (0, 0) for a blank map. radius: distance of the
        farthest one from it, metres. resolution: side of a cell, metres.
    """

    centre: tuple[float, float]
    radius: float
    resolution: float


def known_centre(grid: OccupancyGrid) -> tuple[float, float]:
    """The centre of a map's known cells alone, as KnownCells has it."""
    known = grid.data >= 0
    rows, cols = np.count_nonzero(known, axis=1), np.count_nonzero(known, axis=0)
    if not rows.any():
        return (0.0, 0.0)
    row = float(np.average(np.arange(grid.height), weights=rows)) + 0.5
    col = float(np.average(np.arange(grid.width), weights=cols)) + 0.5
    x, y = se2.apply(grid.origin, np.array([col, row]) * grid.resolution)
    return (float(x), float(y))


def known_cells(grid: OccupancyGrid) -> KnownCells:
    """Looks up the known cells of a map."""
    rows, cols = np.nonzero(grid.data >= 0)
    if rows.size == 0:
        return KnownCells((0.0, 0.0), 0.0, grid.resolution)
    points = grid.cell_centers(rows, cols)
    centre = points.mean(axis=0)
    radius = float(np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
    return KnownCells((float(centre[0]), float(centre[1])), radius, grid.resolution)
