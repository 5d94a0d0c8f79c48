"""How much two placed maps have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OCCUPIED, UNKNOWN, OccupancyGrid

_OCCUPIED_CELL = 0.25
"""Side in metres of the cells in which occupied cells are compared, at least two pixels."""


@dataclass(frozen=True)
class Overlap:
    """What two maps have in common, each from 0 to 1.

    overlap: share of the smaller map's known area that the other one knows too.
    iou: the same area over that of the union.
    overlap_occupied: share of the occupied cells (of 0.25 m or two pixels, the larger) of the map that has
        fewer which the other one has too.
    """

    overlap: float
    iou: float
    overlap_occupied: float


class PlacedMap:
    """A map and its T_world_map, prepared for comparison with others."""

    def __init__(self, grid: OccupancyGrid, T_world_map: NDArray[np.float64]) -> None:
        self.grid = grid
        self.area = float((grid.data != UNKNOWN).sum()) * grid.resolution**2
        self._T_grid_world = se2.inverse(se2.compose(T_world_map, grid.origin))
        rows, cols = np.nonzero(grid.data != UNKNOWN)
        self.known = se2.apply(T_world_map, grid.cell_centers(rows, cols))
        rows, cols = np.nonzero(grid.data == OCCUPIED)
        self.occupied = se2.apply(T_world_map, grid.cell_centers(rows, cols))
        # The box around the known cells' centres, shape (2, 2): low, high.
        self._box = np.array([self.known.min(axis=0), self.known.max(axis=0)]) if len(self.known) else None

    def is_far_from(self, other: PlacedMap) -> bool:
        """Whether the two lie so far apart that they have nothing in common."""
        if self._box is None or other._box is None:
            return True
        apart = 1.0 + 4 * max(self.grid.resolution, other.grid.resolution)
        return bool(
            (self._box[0] > other._box[1] + apart).any() or (other._box[0] > self._box[1] + apart).any()
        )

    def knows(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each world point, shape (n, 2), lies in a known cell."""
        local = se2.apply(self._T_grid_world, points) / self.grid.resolution
        col, row = np.floor(local).astype(np.intp).T
        inside = (col >= 0) & (col < self.grid.width) & (row >= 0) & (row < self.grid.height)
        inside[inside] = self.grid.data[row[inside], col[inside]] != UNKNOWN
        return np.asarray(inside, dtype=np.bool_)


def overlap(a: PlacedMap, b: PlacedMap) -> Overlap:
    """What two placed maps have in common; symmetric up to the rounding of areas to cells."""
    if not a.area or not b.area or a.is_far_from(b):
        return Overlap(0.0, 0.0, 0.0)
    # The finer cells of the two measure the common area, those of the smaller map where they are alike.
    probe, other = (a, b) if (a.grid.resolution, a.area) <= (b.grid.resolution, b.area) else (b, a)
    low, high = other.known.min(axis=0) - 1.0, other.known.max(axis=0) + 1.0
    near = ((probe.known >= low) & (probe.known <= high)).all(axis=1)
    common = float(other.knows(probe.known[near]).sum()) * probe.grid.resolution**2
    cell = max(_OCCUPIED_CELL, 2 * max(a.grid.resolution, b.grid.resolution))
    cells_a, cells_b = (np.unique(_cell_keys(m.occupied, cell)) for m in (a, b))
    fewer = min(len(cells_a), len(cells_b))
    both = len(np.intersect1d(cells_a, cells_b, assume_unique=True))
    return Overlap(
        overlap=min(1.0, common / min(a.area, b.area)),
        iou=min(1.0, common / max(a.area + b.area - common, 1e-12)),
        overlap_occupied=both / fewer if fewer else 0.0,
    )


def _cell_keys(points: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """One whole number for the cell of each point."""
    index = np.floor(points / cell).astype(np.int64)
    return np.asarray(index[:, 0] * (1 << 31) + index[:, 1])
