"""What the tests of simulated cases share."""

from __future__ import annotations

import numpy as np

from mapmeld import se2
from mapmeld.grid import FREE, OCCUPIED, OccupancyGrid
from mapmeld.simulate import SimulateOptions
from mapmeld.simulate.overlap import PlacedMap

SMALL = SimulateOptions(seed=7, robots=3, path_length=10.0, density=0.8)


def box_world(width: float, height: float, resolution: float = 0.02, yaw: float = 0.0) -> OccupancyGrid:
    """An empty room of that size, its walls one cell thick around it."""
    rows, cols = round(height / resolution), round(width / resolution)
    data = np.full((rows + 2, cols + 2), OCCUPIED, dtype=np.int8)
    data[1:-1, 1:-1] = FREE
    return OccupancyGrid(data, resolution, (1.0, -2.0, yaw), "box")


def occupied_points(grid: OccupancyGrid) -> np.ndarray:
    return grid.cell_centers(*np.nonzero(grid.data == OCCUPIED))


def wall_agreement(a: OccupancyGrid, b: OccupancyGrid, T_a_b: np.ndarray, cells: float) -> tuple[float, int]:
    """Share of b's occupied cells on a's known ground that lie near a wall of a, and their number."""
    placed = se2.apply(T_a_b, occupied_points(b))
    placed = placed[PlacedMap(a, np.zeros(3)).knows(placed)]
    walls = occupied_points(a)
    nearest = [float(np.hypot(*(walls - p).T).min()) for p in placed]
    return float(np.mean(np.array(nearest) <= cells * a.resolution)) if nearest else 0.0, len(nearest)
