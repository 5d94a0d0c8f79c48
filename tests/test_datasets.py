"""The bundled case."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapmeld import datasets
from mapmeld.errors import MapmeldError
from mapmeld.map_io import read_map
from mapmeld.simulate import SimulateOptions, simulate


def test_the_bundled_case_is_what_its_options_make(tmp_path: Path) -> None:
    folder = datasets.bundled()
    assert "maze10" in datasets.names()
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    case = simulate(SimulateOptions.from_dict(truth["options"]))
    assert len(case.maps) == 10
    for ours, theirs in zip(case.truth["maps"], truth["maps"], strict=True):
        np.testing.assert_allclose(ours["T_world_map"], theirs["T_world_map"], atol=1e-6)
    # Another machine's sine may move a beam across a cell border; no more than that.
    for grid in case.maps:
        stored = read_map(folder / f"{grid.name}.yaml")
        assert stored.data.shape == grid.data.shape
        assert np.mean(stored.data != grid.data) < 0.001
    assert sum(p.stat().st_size for p in folder.iterdir()) < 150_000


def test_the_bundled_maps_hang_together_and_differ_in_overlap() -> None:
    truth = json.loads((datasets.bundled() / "truth.json").read_text(encoding="utf-8"))
    joined = {m["name"]: {m["name"]} for m in truth["maps"]}
    for pair in truth["pairs"]:
        if pair["overlap_occupied"] >= 0.10 and pair["overlap"] >= 0.10:
            union = joined[pair["a"]] | joined[pair["b"]]
            for name in union:
                joined[name] = union
    assert len(joined[truth["maps"][0]["name"]]) == 10
    overlaps = [pair["overlap"] for pair in truth["pairs"]]
    assert min(overlaps) < 0.05
    assert max(overlaps) > 0.7


def test_an_unknown_bundled_case_is_refused() -> None:
    with pytest.raises(MapmeldError, match="maze10"):
        datasets.bundled("castle")
