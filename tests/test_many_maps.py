"""Merges of more maps than are registered pair by pair."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mapmeld
from mapmeld.simulate import SimulatedCase, SimulateOptions, simulate
from test_pair_store import told

ROBOTS = 42


@pytest.fixture(scope="module")
def floor() -> SimulatedCase:
    return simulate(
        SimulateOptions(
            world="floor",
            size=(50.0, 50.0),
            robots=ROBOTS,
            seed=5,
            resolution=0.1,
            region_radius=3.0,
            path_length=12.0,
            max_range=5.0,
        )
    )


def test_threads_and_order_do_not_matter(floor: SimulatedCase, tmp_path: Path) -> None:
    config: dict[str, Any] = {"registration": {"partners": 6, "shortlist": 10}, "filter": {"particles": 20}}
    one = mapmeld.merge(floor.maps, threads=1, config=config, cache=tmp_path)
    assert len(one.pairs) <= 6 * ROBOTS < ROBOTS * (ROBOTS - 1) // 2
    two = mapmeld.merge(floor.maps, threads=2, config=config, cache=tmp_path)
    assert told(two) == told(one)
    backwards = mapmeld.merge(floor.maps[::-1], threads=2, config=config, cache=tmp_path)
    assert {m.name: m.T_component_map.tolist() for m in backwards.maps} == {
        m.name: m.T_component_map.tolist() for m in one.maps
    }
    assert sum(m.status == "merged" for m in one.maps) > ROBOTS // 2
