"""The worlds, and how robots drive in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.errors import ConfigError, MapmeldError
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from mapmeld.map_io import write_map
from mapmeld.simulate import WORLDS, SimulatedCase, SimulateOptions, simulate
from mapmeld.simulate.free_space import FreeSpace
from mapmeld.simulate.raster import dilate
from mapmeld.simulate.world import build_world
from simulate_cases import SMALL, box_world, wall_agreement


@pytest.fixture(scope="module")
def small() -> SimulatedCase:
    return simulate(SMALL)


@pytest.mark.parametrize("density", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_free_space_of_a_maze_is_connected(seed: int, density: float) -> None:
    world = build_world(SimulateOptions(seed=seed, density=density))
    free = world.data == FREE
    reached = np.zeros_like(free)
    reached[tuple(np.argwhere(free)[0])] = True
    while True:
        # Fill along rows and columns until nothing is new.
        grown = reached
        for axis in (0, 1):
            grown = _fill_runs(grown, free, axis)
        if grown.sum() == reached.sum():
            break
        reached = grown
    assert reached.sum() == free.sum()
    walls = (world.data == OCCUPIED).mean()
    assert walls > 0.015


def _fill_runs(reached: np.ndarray, free: np.ndarray, axis: int) -> np.ndarray:
    """All free runs along an axis that hold a reached cell."""
    ours, room = np.moveaxis(reached, axis, 1), np.moveaxis(free, axis, 1)
    starts = np.ones(room.shape, dtype=bool)
    starts[:, 1:] = room[:, 1:] != room[:, :-1]
    label = np.cumsum(starts.ravel()) - 1
    touched = np.zeros(label[-1] + 1, dtype=bool)
    touched[label[ours.ravel()]] = True
    return np.moveaxis((touched[label] & room.ravel()).reshape(room.shape), 1, axis)


def test_density_sets_the_number_of_panels() -> None:
    walls = [
        int((build_world(SimulateOptions(seed=1, density=d)).data == OCCUPIED).sum()) for d in (0.0, 0.5, 1.0)
    ]
    assert walls[0] < walls[1] < walls[2]
    # 10 x 13 cells: 237 inner edges, of which a spanning tree needs 129; a panel is 1.2 m by 0.06 m.
    assert (walls[2] - walls[0]) * 0.01**2 == pytest.approx(108 * 1.2 * 0.06, rel=0.05)


@pytest.mark.parametrize("world", WORLDS)
def test_every_world_has_rooms_that_can_be_reached(world: str) -> None:
    grid = build_world(SimulateOptions(world=world, seed=3))
    assert _reached(grid) > 0.97
    if world == "halls":
        assert grid.width * grid.resolution >= 100.0
    if world == "symmetric":
        assert np.array_equal(grid.data == OCCUPIED, (grid.data == OCCUPIED)[::-1, ::-1])


LEAST = {"concourse": (36.0, 24.0), "warehouse": (30.0, 34.0), "home": (7.0, 6.0), "corridors": (40.0, 25.0)}


@pytest.mark.parametrize("world", LEAST)
@pytest.mark.parametrize("seed", range(6))
def test_worlds_of_the_least_size_can_be_driven(world: str, seed: int) -> None:
    size = LEAST[world]
    grid = build_world(SimulateOptions(world=world, seed=seed, size=size))
    assert grid.width * grid.resolution == pytest.approx(size[0], abs=0.3)
    assert grid.height * grid.resolution == pytest.approx(size[1], abs=0.3)
    assert _reached(grid) > 0.9
    with pytest.raises(ConfigError, match="size: "):
        build_world(SimulateOptions(world=world, seed=seed, size=(size[0], size[1] - 1.0)))


@pytest.mark.parametrize("seed", range(6))
def test_nearly_all_of_a_home_can_be_driven(seed: int) -> None:
    assert _reached(build_world(SimulateOptions(world="home", seed=seed, size=(16.0, 12.0)))) > 0.98


def _reached(grid: OccupancyGrid) -> float:
    """Share of the floor where a robot may stand that it gets to."""
    radius = 0.2
    open_floor = ~dilate(grid.data != FREE, math.ceil(radius / grid.resolution))
    return FreeSpace(grid, radius).area / (float(open_floor.sum()) * grid.resolution**2)


@pytest.mark.parametrize("world", [w for w in WORLDS if w != "maze"])
def test_other_worlds_make_cases(world: str) -> None:
    case = simulate(SimulateOptions(world=world, seed=2, robots=2, path_length=15.0))
    assert all((grid.data == OCCUPIED).sum() > 100 for grid in case.maps)


def test_robots_keep_their_distance_and_their_steps(small: SimulatedCase) -> None:
    walls = small.world.data != FREE
    near = dilate(walls, round(0.15 / small.world.resolution))
    for path in small.paths:
        cols, rows = np.floor((path[:, :2] - small.world.origin[:2]) / small.world.resolution).astype(int).T
        assert not near[rows, cols].any()
        steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
        assert steps.max() <= SMALL.scan_spacing + 1e-9
        assert np.abs(np.diff(path[:, 2])).max() <= SMALL.scan_turn + 1e-9
        assert steps.sum() == pytest.approx(SMALL.path_length, abs=1e-6)


def test_distances_and_paths_in_an_empty_room() -> None:
    space = FreeSpace(box_world(6.0, 4.0), 0.2)
    nodes = np.flatnonzero(space.passable)
    start, goal = int(nodes[0]), int(nodes[-1])
    a, b = space.points(np.array([start, goal]))
    true = float(np.hypot(*(b - a)))
    assert space.distances(start, 100.0).ravel()[goal] == pytest.approx(true, rel=0.12)
    path = space.shortest_path(start, goal)
    assert path[0] == start
    assert path[-1] == goal
    assert space.straightened(path) == [start, goal]


def test_a_map_file_as_the_world(tmp_path: Path) -> None:
    data = np.array(box_world(8.0, 5.0, 0.05).data)
    data[40:45, 60:100] = OCCUPIED
    data[1:30, 120:] = UNKNOWN
    write_map(tmp_path / "hall.yaml", OccupancyGrid(data, 0.05, (3.0, -4.0, 0.6), "hall"))
    case = simulate(SimulateOptions(world=str(tmp_path / "hall.yaml"), robots=2, path_length=20.0, seed=1))
    assert case.truth["environment"] == "hall"
    for path in case.paths:
        local = se2.apply(se2.inverse((3.0, -4.0, 0.6)), path[:, :2])
        cols, rows = np.floor(local / 0.05).astype(int).T
        assert np.all(data[rows, cols] == FREE)
    for grid, item in zip(case.maps, case.truth["maps"], strict=True):
        share, count = wall_agreement(case.world, grid, np.array(item["T_world_map"]), 2)
        assert count > 100
        assert share > 0.95


def test_a_world_without_room_is_refused(tmp_path: Path) -> None:
    write_map(tmp_path / "tiny.yaml", box_world(0.3, 0.3, 0.05))
    with pytest.raises(MapmeldError, match="robot_radius"):
        simulate(SimulateOptions(world=str(tmp_path / "tiny.yaml")))
