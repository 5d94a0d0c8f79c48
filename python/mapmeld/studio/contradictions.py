"""How much of each map contradicts the others: which one lies wrong, if one does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.result import MergeResult

_MOST_CELLS = 40_000
"""Cells of a map that are looked at: a share needs no more."""


def contradictions(result: MergeResult, grids: Mapping[str, OccupancyGrid]) -> dict[str, float]:
    """For each map that lies with others, the share of its known cells, 0..1, where another one shows the
    opposite (see Component.conflicts)."""
    shares = {}
    for m in result.maps:
        component = result.components[m.component]
        layer, merged = component.conflicts, component.merged
        if layer is None or merged is None or m.T_component_map is None or len(component.order) < 2:
            continue
        grid = grids[m.name]
        rows, cols = np.nonzero(grid.data >= 0)
        step = max(1, len(rows) // _MOST_CELLS)
        own = np.asarray(
            (np.stack([cols[::step], rows[::step]], axis=-1) + 0.5) * grid.resolution, dtype=np.float64
        )
        T_merged_grid = se2.compose(se2.compose(se2.inverse(merged.origin), m.T_component_map), grid.origin)
        col, row = np.floor(se2.apply(T_merged_grid, own) / merged.resolution).astype(int).T
        inside = (col >= 0) & (row >= 0) & (col < merged.width) & (row < merged.height)
        shares[m.name] = float(layer[row[inside], col[inside]].sum() / max(len(own), 1))
    return shares
