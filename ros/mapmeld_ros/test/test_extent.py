"""A published map grows in whole cells and keeps its origin."""

from __future__ import annotations

import numpy as np

from mapmeld import OccupancyGrid
from mapmeld_ros.extent import grown


def grid(x: float, y: float, width: int, height: int, resolution: float = 0.1) -> OccupancyGrid:
    data = np.arange(width * height).reshape(height, width) % 100
    return OccupancyGrid(data, resolution, (x, y, 0.0))


def test_what_grew_to_the_right_is_as_it_is() -> None:
    bigger = grid(-1.0, -2.0, 12, 14)
    assert grown(bigger, grid(-1.0, -2.0, 10, 10)) is bigger


def test_what_shrank_is_padded_with_unknown() -> None:
    smaller = grid(-0.8, -1.9, 5, 4)
    padded = grown(smaller, grid(-1.0, -2.0, 10, 6))
    assert (padded.origin, padded.data.shape) == ((-1.0, -2.0, 0.0), (6, 10))
    np.testing.assert_array_equal(padded.data[1:5, 2:7], smaller.data)
    assert (padded.data == -1).sum() == 60 - 20


def test_what_grew_to_one_side_and_shrank_at_the_other_covers_both() -> None:
    padded = grown(grid(-1.5, -2.0, 10, 10), grid(-1.0, -2.0, 10, 10))
    assert padded.origin == (-1.5, -2.0, 0.0)
    assert padded.data.shape == (10, 15)


def test_origins_do_not_creep() -> None:
    """Over many changes the origin is the first one to the last bit, or whole cells from it."""
    first = earlier = grid(0.1 * 37, -0.1 * 11, 30, 30)
    rng = np.random.default_rng(5)
    for _ in range(100):
        dx, dy = rng.integers(0, 8, 2)
        earlier = grown(grid(first.origin[0] + 0.1 * dx, first.origin[1] + 0.1 * dy, 25, 25), earlier)
        assert earlier.origin == first.origin


def test_another_resolution_or_lattice_starts_anew() -> None:
    earlier = grid(0.0, 0.0, 10, 10)
    for other in (grid(0.2, 0.0, 5, 5, 0.05), grid(0.25, 0.0, 5, 5)):
        assert grown(other, earlier) is other


def test_a_map_that_is_somewhere_else_is_not_padded_to_there() -> None:
    far = grid(500.0, 0.0, 10, 10)
    assert grown(far, grid(0.0, 0.0, 10, 10)) is far
