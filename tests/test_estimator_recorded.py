"""The estimator on recorded and simulated robots whose maps are revealed step by step."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from mapmeld import Estimator, OccupancyGrid, merge, read_map, se2
from mapmeld.known_cells import known_cells
from mapmeld.replay_files import result_of_estimate


def revealed(grid: OccupancyGrid, share: float) -> OccupancyGrid:
    """The part of a map that lies nearest to one of its free cells."""
    rows, cols = np.nonzero(grid.data >= 0)
    free = np.nonzero(grid.data[rows, cols] == 0)[0]
    start = free[free.size // 3]
    distance = np.hypot(rows - rows[start], cols - cols[start])
    known = distance <= np.quantile(distance, share)
    data = np.full_like(grid.data, -1)
    data[rows[known], cols[known]] = grid.data[rows[known], cols[known]]
    return OccupancyGrid(data, grid.resolution, grid.origin, grid.name)


@pytest.mark.parametrize(("case", "together"), [("mazeA_k6_drift", 6), ("fr079_k4_drift", 4)])
def test_robots_are_told_right_all_the_way(shared_data: Path, case: str, together: int) -> None:
    truth = json.loads((shared_data / case / "truth.json").read_text(encoding="utf-8"))
    maps = [read_map(shared_data / case / f"{m['name']}.yaml") for m in truth["maps"]]
    centres = {g.name: np.array(known_cells(g).centre) for g in maps}
    estimator = Estimator()
    for step in range(1, 6):
        for grid in maps:
            estimator.update(revealed(grid, step / 5))
        estimate = estimator.estimate(maps_are_done=step == 5)
        assert len(estimate.robots) == len(maps)
        for pair in truth["pairs"]:
            a, b = estimate.robot(pair["a"]), estimate.robot(pair["b"])
            if a.component is None or a.component != b.component:
                continue
            found = se2.compose(se2.inverse(a.T_world_map), b.T_world_map)
            centre = centres[b.name]
            miss = se2.apply(found, centre) - se2.apply(pair["T_a_b"], centre)
            assert math.hypot(*miss) < 0.5, (step, a.name, b.name)
            assert abs(se2.wrap(found[2] - pair["T_a_b"][2])) < math.radians(5)
    assert len(estimate.components[0].names) == together
    # In the frame of others once, and elsewhere at most once more.
    assert max(r.placements for r in estimate.robots) <= 2


def test_the_anchor_is_sure_and_the_other_carries_the_doubt(shared_data: Path) -> None:
    """The merge begins with the other map; the frame is that of the one that came first."""
    maps = {name: read_map(shared_data / "mazeA_k10" / f"{name}.yaml") for name in ("02_r2", "05_r5")}
    second, first = merge(list(maps.values()), seed=1).components[0].order
    estimator = Estimator()
    for name in (first, second):
        estimator.update(maps[name])
    estimator.estimate()
    estimate = estimator.estimate(maps_are_done=True)
    assert estimate.result is not None
    assert (estimate.components[0].anchor, estimate.result.components[0].order[0]) == (first, second)
    anchor, other = estimate.robot(first), estimate.robot(second)
    assert (anchor.status, other.status) == ("merged", "merged")
    assert anchor.probability == 1.0
    assert other.probability == pytest.approx(estimate.result.pairs[0].probability, abs=1e-4)
    assert 0.75 < other.probability < 0.95
    # What is written says the same.
    written = {m.name: m.probability for m in result_of_estimate(estimate, {}).maps}
    assert written == {first: 1.0, second: other.probability}
