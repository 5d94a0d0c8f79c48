"""Odometry drift: how much it bends the maps, and what the truth says of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.simulate import SimulatedCase, simulate
from mapmeld.simulate.drift import common_fit, drifted, fit_rigid, seen_cells
from mapmeld.simulate.lidar import Lidar, RayCaster
from mapmeld.truth import parse_truth
from simulate_cases import SMALL, wall_agreement


@pytest.fixture(scope="module")
def small() -> SimulatedCase:
    return simulate(SMALL)


@pytest.fixture(scope="module")
def bent() -> SimulatedCase:
    return simulate(replace(SMALL, path_length=40.0, drift=1.5))


def test_drift_bends_the_maps_as_much_as_the_truth_says(bent: SimulatedCase) -> None:
    assert bent.truth["variant"] == "drift"
    assert parse_truth(bent.truth).bent
    fitted = [p for p in bent.truth["pairs"] if "rms_m" in p]
    assert fitted
    for pair in fitted:
        assert 0.003 < pair["rms_m"] < 0.3
        assert pair["common_cells"] >= 30
        assert pair["T_a_b"] != pair["T_a_b_first_pose"]
    for item in bent.truth["maps"]:
        assert 0.001 < item["drift_rms_m_after_fit"] < 0.3
        assert item["T_world_map_fit"] != item["T_world_map"]


def test_the_fitted_transform_places_bent_maps_better_than_the_first_poses(bent: SimulatedCase) -> None:
    by_name = {grid.name: grid for grid in bent.maps}
    gain = []
    for pair in bent.truth["pairs"]:
        if "rms_m" not in pair or pair["overlap_occupied"] < 0.2:
            continue
        a, b = by_name[pair["a"]], by_name[pair["b"]]
        cells = max(2.0, 2 * pair["rms_m"] / a.resolution)
        fit = wall_agreement(a, b, np.array(pair["T_a_b"]), cells)[0]
        gain.append(fit - wall_agreement(a, b, np.array(pair["T_a_b_first_pose"]), cells)[0])
        assert fit > 0.7
    assert gain
    assert np.mean(gain) > 0.0


def test_no_drift_is_the_path_itself_and_drift_grows(small: SimulatedCase) -> None:
    path = small.paths[0]
    np.testing.assert_allclose(drifted(path, 0.0, np.random.default_rng(1)), path, atol=1e-9)
    errors = [
        np.mean([np.hypot(*(drifted(path, d, np.random.default_rng(s)) - path)[-1, :2]) for s in range(20)])
        for d in (1.0, 4.0)
    ]
    assert errors[1] == pytest.approx(4 * errors[0], rel=0.1)
    assert np.array_equal(drifted(path, 2.0, np.random.default_rng(1))[0], path[0])


def test_rigid_fit_recovers_a_transform() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        T = np.array([*rng.uniform(-20, 20, 2), rng.uniform(-math.pi, math.pi)])
        points = rng.uniform(-10, 10, (40, 2))
        found, rms = fit_rigid(points, se2.apply(T, points))
        np.testing.assert_allclose(found, T, atol=1e-9)
        assert rms < 1e-9


def test_without_drift_the_fit_over_common_cells_is_exact(small: SimulatedCase) -> None:
    lidar = Lidar(beams=91, field_of_view=math.pi, max_range=8.0, range_noise=0.02, dropout=0.01)
    caster, frames, seen = RayCaster(small.world), [], []
    for k, path in enumerate(small.paths[:2]):
        T_world_map = np.array(small.truth["maps"][k]["T_world_map"])
        T_map_world = se2.inverse(T_world_map)
        in_map = np.column_stack([se2.apply(T_map_world, path[:, :2]), path[:, 2] + T_map_world[2]])
        ranges = lidar.scan(caster, path, np.random.default_rng(k))
        frames.append(T_world_map)
        seen.append(seen_cells(path, in_map, ranges, lidar.angles))
        # Every cell is shown where the frame puts its centre.
        centres = se2.apply(T_world_map, seen[-1].shown)
        np.testing.assert_allclose(centres, (seen[-1].index + 0.5) * 0.1, atol=1e-9)
    fit = common_fit(*seen)
    assert fit is not None
    T_a_b, rms, cells = fit
    np.testing.assert_allclose(T_a_b, se2.compose(se2.inverse(frames[0]), frames[1]), atol=1e-9)
    assert rms < 1e-9
    ours, theirs = ({tuple(index) for index in s.index.tolist()} for s in seen)
    assert cells == len(ours & theirs)
