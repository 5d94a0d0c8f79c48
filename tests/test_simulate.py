"""Simulated cases: the same bytes for the same seed, and a truth that the maps bear out."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN
from mapmeld.simulate import SimulatedCase, SimulateOptions, simulate, write_case
from mapmeld.simulate.overlap import PlacedMap, overlap
from mapmeld.simulate.raster import dilate
from mapmeld.truth import parse_truth
from simulate_cases import SMALL, occupied_points, wall_agreement


@pytest.fixture(scope="module")
def small() -> SimulatedCase:
    return simulate(SMALL)


def test_same_options_give_the_same_bytes(tmp_path: Path) -> None:
    options = replace(SMALL, robots=2, drift=1.0, origin_yaw=True)
    for folder in ("one", "two"):
        write_case(simulate(options), tmp_path / folder, image_format="png")
    names = sorted(p.name for p in (tmp_path / "one").iterdir())
    assert names == ["00_r0.png", "00_r0.yaml", "01_r1.png", "01_r1.yaml", "truth.json"]
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_another_seed_gives_another_world_and_frames(small: SimulatedCase) -> None:
    other = simulate(replace(SMALL, seed=8, robots=1))
    assert not np.array_equal(small.world.data, other.world.data)
    assert small.truth["maps"][0]["T_world_map"] != other.truth["maps"][0]["T_world_map"]


def test_drift_changes_neither_paths_nor_frames(small: SimulatedCase) -> None:
    drifting = simulate(replace(SMALL, drift=1.0))
    for ours, theirs in zip(small.paths, drifting.paths, strict=True):
        assert np.array_equal(ours, theirs)
    frames = [[m["T_world_map"] for m in case.truth["maps"]] for case in (small, drifting)]
    assert frames[0] == frames[1]


@pytest.mark.parametrize("extra", [{}, {"origin_yaw": True}, {"resolution": (0.05, 0.1, 0.025)}])
def test_walls_coincide_where_the_truth_places_them(extra: dict[str, object]) -> None:
    case = simulate(replace(SMALL, **extra))
    by_name = {grid.name: grid for grid in case.maps}
    checked = 0
    for pair in case.truth["pairs"]:
        if pair["overlap"] < 0.2:
            continue
        a, b = by_name[pair["a"]], by_name[pair["b"]]
        cells = 2 * max(a.resolution, b.resolution) / a.resolution
        share, count = wall_agreement(a, b, np.array(pair["T_a_b"]), cells)
        assert count > 50
        assert share > 0.9, (pair["a"], pair["b"], share)
        moved = se2.compose(pair["T_a_b"], (0.5, 0.5, 0.3))
        assert wall_agreement(a, b, moved, cells)[0] < 0.6
        checked += 1
    assert checked >= 2


def test_each_map_shows_the_world_it_was_made_in(small: SimulatedCase) -> None:
    for grid, item in zip(small.maps, small.truth["maps"], strict=True):
        share, count = wall_agreement(small.world, grid, np.array(item["T_world_map"]), 10)
        assert count > 200
        assert share > 0.98
        free = se2.apply(item["T_world_map"], grid.cell_centers(*np.nonzero(grid.data == FREE)))
        cols, rows = np.floor((free - small.world.origin[:2]) / small.world.resolution).astype(int).T
        assert np.mean(small.world.data[rows, cols] == FREE) > 0.98


def test_walls_are_thin_and_grids_cropped(small: SimulatedCase) -> None:
    margin = round(SMALL.margin / 0.05)
    for grid in small.maps:
        # Cells deep inside a wall would need walls more than four cells thick.
        solid = grid.data == OCCUPIED
        inner = ~dilate(~solid, 2)
        assert inner[2:-2, 2:-2].sum() <= 0.005 * solid.sum()
        known = grid.data != UNKNOWN
        assert not known[:margin].any()
        assert not known[:, :margin].any()
        assert not known[-margin:].any()
        assert not known[:, -margin:].any()
        assert known[margin].any()
        assert known[:, margin].any()


def test_truth_record_has_the_format_and_the_options(small: SimulatedCase) -> None:
    record = json.loads(json.dumps(small.truth))
    truth = parse_truth(record)
    assert list(truth.T_world_map) == ["00_r0", "01_r1", "02_r2"]
    assert len(truth.pairs) == 3
    assert not truth.bent
    assert record["variant"] == "corrected"
    assert record["maps"][0]["scans"] == len(small.paths[0])
    assert SimulateOptions.from_dict(record["options"]) == SMALL
    for pair in record["pairs"]:
        T_a, T_b = (truth.T_world_map[pair[k]] for k in "ab")
        np.testing.assert_allclose(pair["T_a_b"], se2.compose(se2.inverse(T_a), T_b), atol=2e-6)


def test_frames_are_random(small: SimulatedCase) -> None:
    yaws = [m["T_world_map"][2] for m in small.truth["maps"]]
    assert all(abs(se2.wrap(a - b)) > 0.01 for k, a in enumerate(yaws) for b in yaws[:k])
    assert all(grid.origin[2] == 0.0 for grid in small.maps)
    turned = simulate(replace(SMALL, robots=1, origin_yaw=True)).maps[0]
    assert abs(turned.origin[2]) > 0.01


def test_overlap_against_brute_force(small: SimulatedCase) -> None:
    a, b = small.maps[0], small.maps[1]
    T_a, T_b = (np.array(m["T_world_map"]) for m in small.truth["maps"][:2])
    shared = overlap(PlacedMap(a, T_a), PlacedMap(b, T_b))
    # Count on a fine lattice of the world, point by point.
    step = 0.02
    xs = np.arange(-1.0, 13.0, step)
    ys = np.arange(-1.0, 17.0, step)
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    known = []
    for grid, T in ((a, T_a), (b, T_b)):
        local = se2.apply(se2.inverse(se2.compose(T, grid.origin)), points)
        cols, rows = np.floor(local / grid.resolution).astype(int).T
        inside = (cols >= 0) & (rows >= 0) & (cols < grid.width) & (rows < grid.height)
        known.append(
            np.array([ok and grid.data[r, c] != -1 for ok, r, c in zip(inside, rows, cols, strict=True)])
        )
    both, either = (known[0] & known[1]).sum(), (known[0] | known[1]).sum()
    assert shared.overlap == pytest.approx(both / min(known[0].sum(), known[1].sum()), abs=0.01)
    assert shared.iou == pytest.approx(both / either, abs=0.01)
    sets = [
        {(math.floor(x / 0.25), math.floor(y / 0.25)) for x, y in se2.apply(T, occupied_points(grid))}
        for grid, T in ((a, T_a), (b, T_b))
    ]
    assert shared.overlap_occupied == pytest.approx(len(sets[0] & sets[1]) / min(len(s) for s in sets))
    assert small.truth["pairs"][0]["overlap"] == round(shared.overlap, 4)
