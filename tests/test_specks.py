"""Maps full of specks are merged as if they had none, and drawn as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mapmeld
from mapmeld import OccupancyGrid
from mapmeld.map_features import features
from rooms import building, relative_error, run_cli, save


def speckled(grid: OccupancyGrid, share: float, value: int) -> OccupancyGrid:
    """A map of whose known cells some, drawn at random, have another value."""
    rng = np.random.default_rng(len(grid.name))
    is_speck = (rng.random(grid.data.shape) < share) & (grid.data >= 0)
    cells = np.where(is_speck, value, grid.data).astype(np.int8)
    return OccupancyGrid(cells, grid.resolution, grid.origin, grid.name)


@pytest.mark.parametrize(
    ("share", "value"), [(0.2, -1), (0.4, -1), (0.4, 40), (0.02, 100)], ids=["some", "many", "grey", "echoes"]
)
def test_specks_do_not_keep_maps_apart(share: float, value: int) -> None:
    maps = [speckled(g, share, value) for g in building()]
    result = mapmeld.merge(maps, seed=1)
    assert [m.status for m in result.maps] == ["merged"] * 3
    first, *others = result.maps
    for m in others:
        assert first.T_component_map is not None
        assert m.T_component_map is not None
        metres, radians = relative_error(first.T_component_map, m.T_component_map, first.name, m.name)
        assert metres < 0.1
        assert radians < 0.02


def test_a_merged_map_is_made_of_the_cells_as_they_are() -> None:
    (grid,) = [speckled(g, 0.4, -1) for g in building()[:1]]
    (merged,) = mapmeld.merge([grid]).merged_maps
    assert np.array_equal(np.sort(merged.data[merged.data >= 0]), np.sort(grid.data[grid.data >= 0]))


def test_specks_are_told(tmp_path: Path) -> None:
    clean, *_ = building()
    assert features(clean).specks == 0
    dirty = speckled(clean, 0.1, -1)
    seen = features(dirty)
    gone = int((clean.data == 0).sum() - (dirty.data == 0).sum())
    assert 0.9 * gone < seen.specks < 1.1 * gone
    assert (seen.free, seen.occupied) == (int((dirty.data == 0).sum()), int((dirty.data == 100).sum()))
    (path,) = save(tmp_path, [dirty])
    code, out, _ = run_cli("inspect", path, "-o", tmp_path / "seen.png")
    assert code == 0
    assert f"{seen.specks} of the unknown and occupied ones are specks" in out
    (path,) = save(tmp_path, [clean])
    assert "are specks" not in run_cli("inspect", path, "-o", tmp_path / "seen.png")[1]
