"""Maps that state a wrong resolution are merged, and told of."""

from __future__ import annotations

from pathlib import Path

import pytest

import mapmeld
from mapmeld import OccupancyGrid, read_map
from mapmeld.datasets import bundled
from mapmeld.merge_view import warnings
from mapmeld.result import Pair
from mapmeld.true_size import wrong_sizes
from rooms import building, run_cli, save


def resized(grid: OccupancyGrid, times: float) -> OccupancyGrid:
    """The same cells, said to be of another size."""
    x, y, theta = grid.origin
    return OccupancyGrid(grid.data, grid.resolution * times, (x * times, y * times, theta), grid.name)


def pair(a: str, b: str, scale: float | None, deviation: float = 0.002) -> Pair:
    return Pair(a, b, 9, "merged", 0.99, 0.0, scale, None if scale is None else deviation, ())


@pytest.mark.parametrize("times", [0.96, 1.04])
def test_one_of_ten_mazes_is_of_another_size(times: float) -> None:
    maps = [read_map(path) for path in sorted(bundled().glob("*.yaml"))][:5]
    assert wrong_sizes(mapmeld.merge(maps, seed=1).pairs) == []
    maps[2] = resized(maps[2], times)
    result = mapmeld.merge(maps, seed=1)
    (wrong,) = wrong_sizes(result.pairs)
    assert wrong.name == maps[2].name
    assert wrong.scale == pytest.approx(1 / times, abs=0.008)
    assert any(maps[2].name in line and "times its size" in line for line in warnings(result))


def test_the_command_warns(tmp_path: Path) -> None:
    left, middle, right = building()
    paths = save(tmp_path / "maps", [left, resized(middle, 1.04), right])
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert "map middle would fit" in err


def test_who_is_doubted_most_is_told_of_alone() -> None:
    pairs = [pair("a", "b", 1.05), pair("b", "c", 0.95), pair("a", "c", 1.001), pair("b", "d", 0.952)]
    (wrong,) = wrong_sizes(pairs)
    assert (wrong.name, wrong.others) == ("b", ("a", "c", "d"))
    assert wrong.scale == pytest.approx(1.05, abs=0.005)


def test_who_all_others_doubt_comes_before_who_is_doubted_by_it() -> None:
    (wrong,) = wrong_sizes([pair("a", "b", 1.05), pair("b", "c", 1.0)])
    assert (wrong.name, wrong.others) == ("a", ("b",))
    assert wrong.scale == pytest.approx(1 / 1.05)


def test_two_wrong_ones_beside_one_that_most_find_right() -> None:
    right = [pair("b", o, 1.0) for o in "efg"]
    found = wrong_sizes([pair("b", "c", 0.95), pair("b", "d", 0.95), *right])
    assert {w.name for w in found} == {"c", "d"}


def test_only_those_that_agree_are_named() -> None:
    (wrong,) = wrong_sizes([pair("a", "b", 1.05), pair("c", "b", 1.05), pair("d", "b", 0.95)])
    assert (wrong.name, wrong.others) == ("b", ("a", "c"))


def test_it_is_no_matter_which_map_is_given_first() -> None:
    for scale, deviation in ((0.9, 0.0332), (0.96, 0.013), (1.04, 0.0134)):
        turned = pair("b", "a", 1 / scale, deviation / scale**2)
        assert bool(wrong_sizes([pair("a", "b", scale, deviation)])) == bool(wrong_sizes([turned]))


def test_of_two_maps_the_second_is_told_of() -> None:
    (wrong,) = wrong_sizes([pair("a", "b", 0.95)])
    assert (wrong.name, wrong.others) == ("b", ("a",))


def test_bent_maps_and_doubtful_sizes_are_not_told_of() -> None:
    bent = [pair("a", "b", 1.03), pair("a", "c", 0.97), pair("b", "c", 1.0), pair("c", "d", 1.0)]
    bent += [pair("a", "d", 1.0), pair("b", "d", 1.0)]
    assert wrong_sizes(bent) == []
    assert wrong_sizes([pair("a", "b", 1.05, deviation=0.02), pair("a", "c", None)]) == []
