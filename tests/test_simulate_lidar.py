"""The lidar: exact ranges, then noise and lost returns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.grid import FREE, OCCUPIED, OccupancyGrid
from mapmeld.simulate.lidar import Lidar, RayCaster
from simulate_cases import box_world


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_ranges_against_the_walls_of_a_box(yaw: float) -> None:
    world = box_world(6.0, 4.0, yaw=yaw)
    rng = np.random.default_rng(2)
    local = np.column_stack([rng.uniform(0.3, 5.7, 500), rng.uniform(0.3, 3.7, 500)])
    angles = rng.uniform(-math.pi, math.pi, 500)
    angles[:8] = np.arange(8) * math.pi / 4
    # Just off a cell's border, and along it: the worst case for stepping from cell to cell.
    local[:8, 0] = 150 * 0.02 - 1e-15
    got = RayCaster(world).ranges(se2.apply(world.origin, local + 0.02), angles + yaw, 20.0)
    with np.errstate(divide="ignore"):
        to_x = np.where(np.cos(angles) > 0, 6.0 - local[:, 0], local[:, 0]) / np.abs(np.cos(angles))
        to_y = np.where(np.sin(angles) > 0, 4.0 - local[:, 1], local[:, 1]) / np.abs(np.sin(angles))
    np.testing.assert_allclose(got, np.minimum(to_x, to_y), atol=1e-4)
    short = RayCaster(world).ranges(se2.apply(world.origin, local + 0.02), angles + yaw, 1.0)
    assert np.array_equal(np.isinf(short), got > 1.0)


def test_ray_casting_against_small_steps() -> None:
    rng = np.random.default_rng(5)
    data = np.where(rng.random((60, 80)) < 0.03, OCCUPIED, FREE).astype(np.int8)
    world = OccupancyGrid(data, 0.1)
    points = rng.uniform([2.0, 2.0], [6.0, 4.0], (200, 2))
    angles = rng.uniform(-math.pi, math.pi, 200)
    got = RayCaster(world).ranges(points, angles, 3.0)
    for point, angle, distance in zip(points, angles, got, strict=True):
        t = np.arange(0.0, 3.0, 0.0005)
        cols, rows = np.floor((point + t[:, None] * [math.cos(angle), math.sin(angle)]) / 0.1).astype(int).T
        inside = (cols >= 0) & (rows >= 0) & (cols < 80) & (rows < 60)
        hits = np.flatnonzero(inside & (data[rows.clip(0, 59), cols.clip(0, 79)] == OCCUPIED))
        # Stepping may miss a corner by less than a step; never the other way round.
        assert distance <= (t[hits[0]] + 1e-6 if len(hits) else math.inf)
        if np.isfinite(distance):
            touched = np.floor((point + (distance + 1e-5) * np.array([np.cos(angle), np.sin(angle)])) / 0.1)
            assert data[int(touched[1]), int(touched[0])] == OCCUPIED


def test_noise_and_lost_returns_have_their_moments() -> None:
    world = box_world(6.0, 4.0)
    lidar = Lidar(beams=181, field_of_view=math.pi, max_range=8.0, range_noise=0.02, dropout=0.01)
    poses = np.tile(se2.compose(world.origin, (3.0, 2.0, 0.4)), (300, 1))
    caster = RayCaster(world)
    ranges = lidar.scan(caster, poses, np.random.default_rng(1))
    exact = caster.ranges(poses[:181, :2], poses[0, 2] + lidar.angles, 8.0)
    assert lidar.angles[[0, 90, -1]] == pytest.approx([-math.pi / 2, 0.0, math.pi / 2])
    lost = np.isnan(ranges)
    assert lost.mean() == pytest.approx(0.01, abs=0.002)
    errors = (ranges - exact)[~lost]
    assert errors.std() == pytest.approx(0.02, rel=0.02)
    assert errors.mean() == pytest.approx(0.0, abs=0.0005)
