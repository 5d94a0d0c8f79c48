"""What a published map covers: it grows in whole cells and does not shrink, so that its origin stays."""

from __future__ import annotations

import numpy as np

from mapmeld import OccupancyGrid

# A map that had this many times the cells it needs has been placed anew; keeping its extent helps nobody.
_MOST_TO_SPARE = 16.0
# Cells by which lattices may miss each other: what floating point leaves.
_LATTICE_TOLERANCE = 1e-3


def grown(grid: OccupancyGrid, earlier: OccupancyGrid | None) -> OccupancyGrid:
    """The grid, padded with unknown cells so that it covers `earlier` too.

    A grid that does not share the earlier one's resolution and lattice comes back as it is, and so does one
    that would be mostly padding.
    """
    if earlier is None or grid.resolution != earlier.resolution or grid.origin[2] != earlier.origin[2]:
        return grid
    offset = (np.array(grid.origin[:2]) - np.array(earlier.origin[:2])) / grid.resolution
    cells = np.rint(offset)
    if np.abs(offset - cells).max() > _LATTICE_TOLERANCE:
        return grid
    col, row = (int(v) for v in cells)
    left, below = max(col, 0), max(row, 0)
    right = max(earlier.width - (col + grid.width), 0)
    above = max(earlier.height - (row + grid.height), 0)
    height, width = below + grid.height + above, left + grid.width + right
    if (height, width) == grid.data.shape or height * width > _MOST_TO_SPARE * grid.data.size:
        return grid
    data = np.full((height, width), -1, dtype=np.int8)
    data[below : below + grid.height, left : left + grid.width] = grid.data
    # Where the earlier origin stays it stays to the last bit.
    x = earlier.origin[0] if col >= 0 else grid.origin[0]
    y = earlier.origin[1] if row >= 0 else grid.origin[1]
    return OccupancyGrid(data, grid.resolution, (x, y, grid.origin[2]), grid.name)
