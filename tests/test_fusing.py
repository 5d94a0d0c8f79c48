"""Maps at known poses become one map, without a merge."""

from __future__ import annotations

import numpy as np
import pytest

import mapmeld
import rooms
from mapmeld import MapmeldError, OccupancyGrid, se2
from mapmeld.grid import FREE, UNKNOWN


def test_every_wall_lies_where_its_pose_puts_it() -> None:
    placed = [(grid, rooms.TRUTH[grid.name]) for grid in rooms.building()]
    fused = mapmeld.fuse(placed, name="site")
    assert (fused.name, fused.resolution, fused.origin[2]) == ("site", rooms.RESOLUTION, 0.0)
    walls = fused.cell_centers(*np.nonzero(fused.data == 100))
    for grid, T in placed:
        for point in se2.apply(T, grid.cell_centers(*np.nonzero(grid.data == 100)))[::40]:
            assert np.hypot(*(walls - point).T).min() < 1.5 * rooms.RESOLUTION


def test_the_origin_lies_on_whole_cells() -> None:
    """So that a map that has grown has the old cells at whole-cell offsets."""
    for x in (0.0, 0.033, -7.77):
        fused = mapmeld.fuse([(rooms.hall(), (x, 0.5 * x, 0.0))])
        cells = np.array(fused.origin[:2]) / fused.resolution
        np.testing.assert_allclose(cells, np.rint(cells), atol=1e-6)


def test_a_merge_fuses_the_same_way() -> None:
    result = mapmeld.merge(rooms.building())
    order = result.order
    grids = {g.name: g for g in rooms.building()}
    poses = {m.name: m.T_component_map for m in result.maps}
    fused = mapmeld.fuse([(grids[n], poses[n]) for n in order])
    assert result.merged is not None
    assert fused.data.shape == result.merged.data.shape
    assert np.mean(fused.data != result.merged.data) < 0.01


def test_options_count() -> None:
    fused = mapmeld.fuse([(rooms.hall(), (0, 0, 0))], config={"fuse": {"resolution": 0.2}})
    assert fused.resolution == 0.2


@pytest.mark.parametrize(
    ("placed", "words"),
    [
        ([], "no maps"),
        ([(rooms.blank(), (0, 0, 0))], "a known cell"),
        ([(rooms.hall(), (0, 0))], "three finite numbers"),
        ([(rooms.hall(), (0, 0, np.nan))], "three finite numbers"),
    ],
)
def test_what_cannot_be_fused_is_named(
    placed: list[tuple[OccupancyGrid, tuple[float, ...]]], words: str
) -> None:
    with pytest.raises(MapmeldError, match=words):
        mapmeld.fuse(placed)


@pytest.mark.parametrize("rule", ["log_odds", "max", "latest"])
def test_every_cell_of_a_merged_map_tells_which_map_it_is_from(rule: str) -> None:
    result = mapmeld.merge(rooms.building(), seed=3, particles=40, config={"fuse": {"rule": rule}})
    component = result.components[0]
    merged, sources, conflicts = component.merged, component.provenance, component.conflicts
    assert merged is not None
    assert sources is not None
    assert conflicts is not None
    assert sources.shape == conflicts.shape == merged.data.shape
    assert np.array_equal(sources == -1, merged.data == UNKNOWN)
    assert set(np.unique(sources)) == {-1, *range(len(component.order))}
    assert conflicts.sum() == component.conflict_cells
    assert not conflicts[merged.data == UNKNOWN].any()
    # What a cell is said to be from shows the same there, up to a wall that two maps have a cell apart.
    maps = {m.name: m for m in rooms.building()}
    poses = {m.name: m.T_component_map for m in result.maps}
    for k, name in enumerate(component.order):
        rows, cols = np.nonzero((sources == k) & (merged.data == FREE))
        points = se2.apply(se2.inverse(poses[name]), merged.cell_centers(rows, cols))
        own = maps[name]
        local = se2.apply(se2.inverse(np.array(own.origin)), points)
        c, r = (np.floor(local / own.resolution).astype(int)).T
        inside = (r >= 0) & (c >= 0) & (r < own.height) & (c < own.width)
        values = own.data[r[inside], c[inside]]
        assert inside.mean() > 0.99
        assert (values == UNKNOWN).mean() < 0.01
