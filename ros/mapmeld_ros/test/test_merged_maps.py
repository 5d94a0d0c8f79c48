"""What is drawn of each component, and what is said where that cannot be done."""

from __future__ import annotations

import numpy as np

import rooms
from mapmeld import Estimate, OccupancyGrid
from mapmeld.estimate import EstimatedComponent, RobotEstimate
from mapmeld_ros.components import Named
from mapmeld_ros.merged_maps import MergedMaps

NAMES = (Named(1, "world"), Named(2, "world_b"))


def robot(name: str, component: int, x: float = 0.0) -> RobotEstimate:
    T = np.array([x, 0.0, 0.0])
    return RobotEstimate(name, component, T, None, 1.0, "pinned", "", None, 0)


def estimate(x: float) -> Estimate:
    """a and far are one component, and far lies at x; b is alone."""
    robots = (robot("a", 0), robot("far", 0, x), robot("b", 1))
    found = [(("a", "far"), True), (("b",), False)]
    components = tuple(EstimatedComponent(names, names[0], is_world, None) for names, is_world in found)
    return Estimate(robots, components, None, 0, 0.0)


def test_a_map_that_cannot_be_made_is_said_and_the_others_are_drawn() -> None:
    merged = MergedMaps({})
    grids = {name: rooms.hall(name) for name in ("a", "far", "b")}
    assert [n.frame for n, _ in merged.changed(estimate(20.0), NAMES, grids)] == ["world", "world_b"]
    assert merged.problems == {}
    before = merged.by_frame()["world"]
    grids["b"] = rooms.view("b", (-0.5, 9.0), (0.0, 0.0, 0.0))
    # A pin with a slip: so many cells are no map.
    assert [n.frame for n, _ in merged.changed(estimate(2e7), NAMES, grids)] == ["world_b"]
    assert list(merged.problems) == ["world"]
    assert "cells" in merged.problems["world"]
    assert merged.by_frame()["world"] is before
    merged.changed(estimate(20.0), NAMES, grids)
    assert merged.problems == {}


def test_nothing_to_draw_is_no_problem() -> None:
    merged = MergedMaps({})
    blank = OccupancyGrid(np.full((5, 5), -1), 0.05, name="a")
    assert merged.changed(estimate(20.0), NAMES, {"a": blank}) == []
    assert merged.problems == {}
