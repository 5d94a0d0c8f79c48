"""The unknown about a map changes nothing: mappers keep large grids, or cut them to what is known."""

from __future__ import annotations

import numpy as np
import pytest

import mapmeld
from mapmeld import OccupancyGrid, se2
from rooms import building


def with_margins(grid: OccupancyGrid, left: int, below: int, right: int, above: int) -> OccupancyGrid:
    """The map in a larger grid; in a smaller one where `left` or `below` are negative."""
    cells = np.pad(
        grid.data, ((max(below, 0), max(above, 0)), (max(left, 0), max(right, 0))), constant_values=-1
    )
    assert min(right, above) >= 0
    cells = cells[max(-below, 0) :, max(-left, 0) :]
    x, y = se2.apply(grid.origin, np.array([-left, -below]) * grid.resolution)
    return OccupancyGrid(cells, grid.resolution, (float(x), float(y), grid.origin[2]), grid.name)


def cut(grid: OccupancyGrid) -> OccupancyGrid:
    """The map without the unknown rows and columns below and to the left of what is known."""
    rows, columns = np.nonzero(grid.data != -1)
    return with_margins(grid, -int(columns.min()), -int(rows.min()), 0, 0)


def test_the_unknown_about_maps_changes_nothing() -> None:
    maps = building()
    expected = mapmeld.merge(maps, seed=1)
    assert [m.status for m in expected.maps] == ["merged"] * 3
    left, middle, right = maps
    for others in (
        [with_margins(left, 900, 1, 30, 0), with_margins(middle, 0, 700, 0, 5), right],
        [cut(left), cut(middle), with_margins(cut(right), 3, 0, 3, 0)],
    ):
        found = mapmeld.merge(others, seed=1)
        for m, e in zip(found.maps, expected.maps, strict=True):
            assert m.status == e.status
            assert m.probability == pytest.approx(e.probability, abs=1e-6)
            assert m.T_component_map == pytest.approx(e.T_component_map, abs=1e-5)
            assert np.array(m.covariance) == pytest.approx(np.array(e.covariance), abs=1e-6)
        (merged,), (as_before,) = found.merged_maps, expected.merged_maps
        assert merged.data.shape == as_before.data.shape
        assert (merged.data == as_before.data).mean() > 0.999
