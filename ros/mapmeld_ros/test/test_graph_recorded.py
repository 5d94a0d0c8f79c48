"""Recorded maps over the graph: two halves of a real log, against the poses of the log."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from graph import Graph
from mapmeld import OccupancyGrid, read_map, se2
from mapmeld.known_cells import known_cells


@pytest.mark.parametrize("case", ["intel_ov50", "fr079_ov50"])
def test_two_recorded_maps_are_linked_where_the_log_has_them(
    graph: Graph, shared_data: Path, case: str
) -> None:
    truth = json.loads((shared_data / case / "truth.json").read_text())
    (pair,) = truth["pairs"]
    fleet = graph.fleet()
    graph.node()
    grids = {}
    for role in ("a", "b"):
        grid = read_map(shared_data / case / f"{pair[role]}.yaml")
        grids[role] = OccupancyGrid(grid.data, grid.resolution, grid.origin, role)
        graph.publish(fleet, grids[role])
    graph.wait_status(a="merged", b="merged")
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    places = {role: np.array(graph.tree()[f"{role}/map"][1]) for role in grids}
    found = se2.compose(se2.inverse(places["a"]), places["b"])
    centre = np.array(known_cells(grids["b"]).centre)
    assert math.hypot(*(se2.apply(found, centre) - se2.apply(pair["T_a_b"], centre))) < 0.1
    assert abs(se2.wrap(found[2] - pair["T_a_b"][2])) < math.radians(1.0)

    # One map that shows what either robot knows, and more than either.
    known = [int(np.count_nonzero(g.data != -1)) for g in grids.values()]
    msg = graph.wait_map(accept=lambda m: np.count_nonzero(np.array(m.data) != -1) > max(known))
    assert np.count_nonzero(np.array(msg.data) != -1) < sum(known)
