"""What a grid refuses, and what it takes."""

from __future__ import annotations

import numpy as np
import pytest

import mapmeld
from mapmeld import MapmeldError, OccupancyGrid
from rooms import building, hall


@pytest.mark.parametrize(
    ("resolution", "origin", "word"),
    [
        (0.0, (0.0, 0.0, 0.0), "resolution"),
        (float("nan"), (0.0, 0.0, 0.0), "resolution"),
        (50.0, (0.0, 0.0, 0.0), "is it in metres"),
        (0.05, (0.0, float("inf"), 0.0), "origin"),
        (0.05, (2e8, 0.0, 0.0), "within 1e\\+08 m"),
    ],
)
def test_numbers_that_no_map_has_are_refused_by_name(
    resolution: float, origin: tuple[float, float, float], word: str
) -> None:
    with pytest.raises(MapmeldError, match=word) as raised:
        OccupancyGrid(np.zeros((3, 3), dtype=np.int8), resolution, origin, "robot1")
    assert "robot1" in str(raised.value)


def test_a_map_in_huge_cells_beside_ordinary_ones_takes_nobody_down() -> None:
    """The other maps are merged as without it, in memory that exists."""
    huge = OccupancyGrid(hall().data, 10.0, (0.0, 0.0, 0.0), "huge")
    result = mapmeld.merge([*building(), huge], seed=1)
    alone = mapmeld.merge(building(), seed=1)
    by_name = {m.name: m for m in result.maps}
    assert by_name["huge"].status == "no evidence"
    for m in alone.maps:
        assert by_name[m.name].status == m.status
