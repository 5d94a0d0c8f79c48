"""report.png: what lies where, in which colour."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mapmeld
from mapmeld.grid import OccupancyGrid
from mapmeld.palette import map_colour
from mapmeld.picture import Picture
from mapmeld.picture_axes import Axes, ticks
from mapmeld.report import draw_report
from mapmeld.report_raster import Layer, paint
from rooms import blank, building, hall, view

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def has(picture: np.ndarray, colour: tuple[float, float, float]) -> int:
    """Pixels of a colour."""
    return int((np.abs(picture.astype(int) - np.round(np.array(colour) * 255)) <= 1).all(axis=-1).sum())


def dot(size: int = 20) -> OccupancyGrid:
    """One occupied cell, at (0.5, 0.2) m, in free space."""
    data = np.zeros((size, size), dtype=np.int8)
    data[2, 5] = 100
    return OccupancyGrid(data, 0.1, (0.0, 0.0, 0.0))


def test_walls_lie_where_the_pose_says() -> None:
    canvas = OccupancyGrid(np.zeros((60, 80), dtype=np.int8), 0.1, (-2.0, -3.0, 0.0))
    T = np.array([1.0, 1.5, math.pi / 2])
    raster = paint(canvas, [Layer(dot(), T, RED)], 500)
    rows, cols = np.nonzero((raster.rgb == (255, 0, 0)).all(axis=-1))
    # The cell's centre (0.55, 0.25), turned by a quarter and moved: (1 - 0.25, 1.5 + 0.55).
    assert raster.extent == pytest.approx((-2, 6, -3, 3))
    assert cols.mean() * 0.1 + 0.05 - 2.0 == pytest.approx(0.75, abs=0.06)
    assert rows.mean() * 0.1 + 0.05 - 3.0 == pytest.approx(2.05, abs=0.06)


def test_no_wall_is_lost_when_the_picture_is_coarse() -> None:
    grid = view("big", (-0.5, 15.0), (0.0, 0.0, 0.3), resolution=0.02)
    canvas = mapmeld.merge([grid]).merged
    assert canvas is not None
    raster = paint(canvas, [Layer(grid, np.zeros(3), RED)], 60)
    assert max(raster.rgb.shape) <= 61
    # 68 m of wall in pixels of at least 0.28 m.
    assert (raster.rgb == (255, 0, 0)).all(axis=-1).sum() > 150


def test_shared_walls_show_every_map() -> None:
    grid = hall()
    canvas = mapmeld.merge([grid]).merged
    assert canvas is not None
    raster = paint(canvas, [Layer(grid, np.zeros(3), RED), Layer(grid, np.zeros(3), BLUE)], 500)
    red, blue = has(raster.rgb, RED), has(raster.rgb, BLUE)
    assert red + blue == (grid.data == 100).sum()
    assert abs(red - blue) <= 0.1 * (red + blue)


def test_the_report_shows_every_map(tmp_path: Path) -> None:
    grids = [*building(), hall(), blank()]
    result = mapmeld.merge(grids)
    draw_report(tmp_path / "report.png", result, grids)
    picture = np.asarray(Image.open(tmp_path / "report.png").convert("RGB"))
    for i in range(4):
        assert has(picture, map_colour(i)) > 300
    # The blank map has a rim in the legend, no more.
    assert 0 < has(picture, map_colour(4)) < 300
    assert has(picture, (237 / 255,) * 3) > 20_000


@pytest.mark.parametrize("count", [1, 2, 20])
def test_any_number_of_maps_and_components(count: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    grids = []
    for i in range(count):
        data = np.zeros((40, 60), dtype=np.int8)
        for row, col in rng.integers(5, 35, (6, 2)):
            data[row, col : col + 8] = 100
        # Names that are markup to some, and origins far from the map.
        grids.append(OccupancyGrid(data, 0.1, (500.0 * i, -3.0, 0.5), f"$x_{i}$ [b]{'long ' * (i % 3) * 10}"))
    result = mapmeld.merge(grids, particles=5)
    draw_report(tmp_path / "report.png", result, grids)
    with Image.open(tmp_path / "report.png") as picture:
        assert 300 < picture.width < 1500
        assert 150 < picture.height < 2500


def test_blank_maps_alone(tmp_path: Path) -> None:
    draw_report(tmp_path / "report.png", mapmeld.merge([blank()]), [blank()])
    with Image.open(tmp_path / "report.png") as picture:
        assert picture.height < 400


def test_the_same_result_makes_the_same_picture(tmp_path: Path) -> None:
    grids = building()
    result = mapmeld.merge(grids)
    for name in ("a.png", "b.png"):
        draw_report(tmp_path / name, result, grids)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_colours_differ() -> None:
    colours = [map_colour(i) for i in range(20)]
    nearest = min(math.dist(a, b) for i, a in enumerate(colours) for b in colours[:i])
    assert nearest > 0.12
    assert all(0 <= v <= 1 for colour in colours for v in colour)
    assert map_colour(20) == map_colour(0)


def test_drawing_is_not_the_slow_part(tmp_path: Path) -> None:
    """No time limit, which would measure the machine: drawing must only not grow with the cells of a map."""
    spent = []
    for resolution in (0.1, 0.02):
        grids = [view("v", (-0.5, 15.0), (0.0, 0.0, 0.3), resolution)]
        result = mapmeld.merge(grids, particles=5)
        draw_report(tmp_path / "warm.png", result, grids)
        started = time.process_time()
        draw_report(tmp_path / "report.png", result, grids)
        spent.append(time.process_time() - started)
    assert spent[1] < 5 * spent[0]


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0.0, 10.0, 4, ["0", "5", "10"]),
        (-0.35, 0.42, 8, ["−0.3", "−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3", "0.4"]),
        (512.0, 518.0, 8, ["512", "513", "514", "515", "516", "517", "518"]),
        (3.0, 3000.0, 4, ["1000", "2000", "3000"]),
    ],
)
def test_ticks_are_round_and_few(low: float, high: float, most: int, expected: list[str]) -> None:
    assert [text for _, text in ticks(low, high, most)] == expected


def test_axes_take_metres_to_the_rows_of_a_picture() -> None:
    axes = Axes.within((-2.0, 8.0, 1.0, 6.0), (100.0, 50.0, 600.0, 450.0))
    assert axes.box == pytest.approx((100.0, 50.0, 600.0, 300.0))
    assert axes.at(-2.0, 1.0) == pytest.approx((100.0, 300.0))
    assert axes.at(3.0, 6.0) == pytest.approx((350.0, 50.0))


def test_what_a_stranger_cannot_know_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    text = Picture.text
    monkeypatch.setattr(
        Picture, "text", lambda self, at, t, *rest, **more: said.append(t) or text(self, at, t, *rest, **more)
    )
    near = building()
    draw_report(tmp_path / "near.png", mapmeld.merge(near, seed=1), near)
    assert any("origins of the maps' frames" in t for t in said)
    assert not any("arrow" in t for t in said)
    far = [OccupancyGrid(g.data, g.resolution, (g.origin[0] + 500.0, *g.origin[1:]), g.name) for g in near]
    draw_report(tmp_path / "far.png", mapmeld.merge(far, seed=1), far)
    assert any("an arrow leads" in t for t in said)


def test_a_wide_component_beside_others_makes_a_low_picture(tmp_path: Path) -> None:
    wide = [view(n, x, (0.0, 0.0, 0.0)) for n, x in (("w1", (-0.5, 9.0)), ("w2", (3.0, 15.0)))]
    result = mapmeld.merge([*wide, hall()], seed=1)
    assert len(result.merged_maps) == 2
    draw_report(tmp_path / "r.png", result, [*wide, hall()])
    with Image.open(tmp_path / "r.png") as picture:
        assert picture.height < 0.7 * picture.width
