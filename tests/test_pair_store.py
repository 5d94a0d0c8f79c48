"""Registered pairs on disk: what is found again, what is not, and what is noticed."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mapmeld
from mapmeld import _core
from mapmeld.pair_store import PairStore
from rooms import building


def told(result: mapmeld.MergeResult) -> dict[str, Any]:
    """All but the times."""
    return {key: value for key, value in result.to_dict().items() if key != "seconds"}


def registered(maps: list[mapmeld.OccupancyGrid], folder: Path) -> tuple[int, dict[str, Any]]:
    """How many pairs a merge with a cache in this folder registers, and what it finds."""
    store = PairStore(folder)
    given = [(g.name, g.data, g.resolution, g.origin) for g in maps]
    fresh = _core.merge(given, "{}", store=store.core)["registered_pairs"]
    return fresh, told(mapmeld.merge(maps, cache=folder))


def pair_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/*.pair"))


def changed(grid: mapmeld.OccupancyGrid) -> mapmeld.OccupancyGrid:
    """The map with one cell unknown that was free."""
    data = grid.data.copy()
    row, col = np.argwhere(data == 0)[0]
    data[row, col] = -1
    return mapmeld.OccupancyGrid(data, grid.resolution, grid.origin, grid.name)


def test_one_changed_map_registers_only_its_pairs(tmp_path: Path) -> None:
    maps = building()
    n = len(maps)
    plain = told(mapmeld.merge(maps))
    fresh, found = registered(maps, tmp_path / "cache")
    assert fresh >= n * (n - 1) // 2
    assert found == plain
    assert registered(maps, tmp_path / "cache")[0] == 0
    others = [changed(maps[0]), *maps[1:]]
    given = [(g.name, g.data, g.resolution, g.origin) for g in others]
    plan = _core.plan(given, "{}")
    store = PairStore(tmp_path / "cache")
    assert sorted(sorted(p[:2]) for p in plan if not store.has(p[3])) == [[0, k] for k in range(1, n)]
    assert registered(others, tmp_path / "cache")[1] == told(mapmeld.merge(others))


def test_names_do_not_count_and_options_do(tmp_path: Path) -> None:
    maps = building()
    registered(maps, tmp_path)
    renamed = [
        mapmeld.OccupancyGrid(g.data, g.resolution, g.origin, f"other_{k}") for k, g in enumerate(maps)
    ]
    assert registered(renamed, tmp_path)[0] == 0
    before = len(pair_files(tmp_path))
    mapmeld.merge(maps, cache=tmp_path, particles=20)
    assert len(pair_files(tmp_path)) == before
    mapmeld.merge(maps, cache=tmp_path, config={"registration": {"shortlist": 10}})
    assert len(pair_files(tmp_path)) > before


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_noticed_and_rebuilt(tmp_path: Path, damage: str) -> None:
    maps = building()
    _, plain = registered(maps, tmp_path)
    victim = pair_files(tmp_path)[0]
    whole = victim.read_bytes()
    other = bytes([whole[-1] ^ 1])
    victim.write_bytes({"cut": whole[:-9], "changed": whole[:-1] + other, "empty": b""}[damage])
    with pytest.warns(UserWarning, match="1 pair damaged"):
        again = mapmeld.merge(maps, cache=tmp_path)
    assert told(again) == plain
    assert victim.read_bytes() == whole
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mapmeld.merge(maps, cache=tmp_path)


def test_what_an_ended_merge_registered_is_kept(tmp_path: Path) -> None:
    maps = building()

    def end(stage: str, done: int, total: int) -> None:
        if stage == "register" and done == 2:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        mapmeld.merge(maps, cache=tmp_path, threads=1, progress=end)
    assert registered(maps, tmp_path)[0] <= len(maps) * (len(maps) - 1) // 2
    assert not list(tmp_path.glob("*/.*.tmp"))


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("")
    with pytest.raises(mapmeld.MapmeldError, match=r"cache .*is a file"):
        mapmeld.merge(building(), cache=tmp_path / "cache")
