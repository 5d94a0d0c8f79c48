"""Maps that grow: the known cells of finished maps, revealed as a robot would come to see them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.grid import UNKNOWN, OccupancyGrid

# Occupancy, percent, up to which a cell is free.
FREE_AT_MOST = 25


class Growth:
    """One map's known cells in the order of their distance, through free space, from a place in it.

    The place is drawn by `seed` among the free cells. Walls are known once a free cell beside them is. Known
    cells that no way leads to come last.
    """

    def __init__(self, grid: OccupancyGrid, seed: int) -> None:
        self._grid = grid
        free = (grid.data != UNKNOWN) & (grid.data <= FREE_AT_MOST)
        rows, cols = np.nonzero(free)
        start = int(np.random.default_rng(seed).integers(rows.size))
        distance = _steps(free, (int(rows[start]), int(cols[start])))
        # A wall is seen from where one stands before it.
        beside = np.min([_moved(distance, dr, dc, np.inf) for dr in (-1, 0, 1) for dc in (-1, 0, 1)], axis=0)
        known = grid.data != UNKNOWN
        when = np.where(free, distance, beside)
        finite = np.isfinite(when) & known
        when[known & ~finite] = when[finite].max() + 1
        self._when = np.where(known, when, np.inf)
        self._sorted = np.sort(self._when[known])

    def at(self, share: float) -> OccupancyGrid:
        """The map when a share of its known cells, in (0, 1], is revealed."""
        last = self._sorted[max(0, int(np.ceil(share * self._sorted.size)) - 1)]
        seen = self._when <= last
        data = np.where(seen, self._grid.data, UNKNOWN)
        rows, cols = np.nonzero(seen.any(axis=1))[0], np.nonzero(seen.any(axis=0))[0]
        data = data[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        # The map frame stays: only the corner of the grid moves in it.
        x, y, theta = self._grid.origin
        u, v = cols[0] * self._grid.resolution, rows[0] * self._grid.resolution
        c, s = np.cos(theta), np.sin(theta)
        origin = (x + c * u - s * v, y + s * u + c * v, theta)
        return OccupancyGrid(data, self._grid.resolution, origin, self._grid.name)


def _steps(free: NDArray[np.bool_], start: tuple[int, int]) -> NDArray[np.float64]:
    """Breadth-first distance in steps from the start through free cells; infinite where no way leads."""
    distance = np.full(free.shape, np.inf)
    front = np.zeros(free.shape, dtype=bool)
    front[start] = True
    seen = front.copy()
    cross = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    square = [*cross, (1, 1), (1, -1), (-1, 1), (-1, -1)]
    step = 0
    while front.any():
        distance[front] = step
        step += 1
        # Crosses and squares in turn make an octagon, which is near enough to a circle.
        grown = np.logical_or.reduce([_moved(front, *way, False) for way in (cross, square)[step % 2]])
        front = grown & free & ~seen
        seen |= front
    return distance


def _moved(values: NDArray[Any], rows: int, cols: int, fill: object) -> NDArray[Any]:
    """The array moved by so many rows and columns; what comes in is `fill`."""
    padded = np.pad(values, 1, constant_values=fill)
    height, width = values.shape
    return padded[1 - rows : 1 - rows + height, 1 - cols : 1 - cols + width]
