"""Where the known cells of a map lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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


def known_cells(grid: OccupancyGrid) -> KnownCells:
    """Looks up the known cells of a map."""
    rows, cols = np.nonzero(grid.data >= 0)
    if rows.size == 0:
        return KnownCells((0.0, 0.0), 0.0, grid.resolution)
    points = grid.cell_centers(rows, cols)
    centre = points.mean(axis=0)
    radius = float(np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
    return KnownCells((float(centre[0]), float(centre[1])), radius, grid.resolution)
