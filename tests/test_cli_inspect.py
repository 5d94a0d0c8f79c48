"""`mapmeld inspect`, and the features behind it."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mapmeld
from mapmeld import ConfigError, OccupancyGrid, read_map
from rooms import assert_refused, blank, hall, run_cli, save


def test_features_of_a_hall() -> None:
    grid = hall()
    seen = mapmeld.features(grid)
    assert (seen.name, seen.shape, seen.resolution) == ("hall", (30, 45), 0.1)
    assert seen.extent == pytest.approx((4.5, 3.0))
    assert seen.free + seen.occupied + seen.unknown == 30 * 45
    assert seen.occupied == (grid.data == 100).sum()
    assert len(seen.boundary.position) == len(seen.boundary.normal) > 50
    assert np.allclose(np.hypot(*seen.boundary.normal.T), 1)
    lengths = np.hypot(*(seen.lines.end - seen.lines.start).T)
    # Four walls of the hall and four of the block in it.
    assert len(lengths) == 8
    assert (np.diff(lengths) <= 1e-9).all()
    openings = np.sort(seen.corners.opening)
    assert np.allclose(openings, [math.pi / 2] * 4 + [3 * math.pi / 2] * 4, atol=0.05)
    # The hall's inner corners, a cell inside its outline from (-1, 2) to (3.5, 5).
    inner = seen.corners.vertex[seen.corners.opening < math.pi]
    expected = [(-0.95, 2.05), (-0.95, 4.95), (3.45, 2.05), (3.45, 4.95)]
    for corner in expected:
        assert np.hypot(*(inner - corner).T).min() < 0.12


def test_features_follow_the_config() -> None:
    assert len(mapmeld.features(hall(), {"structure": {"min_line_length": 2.0}}).lines.start) < 8
    with pytest.raises(ConfigError, match=r"structure\.length"):
        mapmeld.features(hall(), {"structure": {"length": 2.0}})


def test_features_turn_with_the_origin() -> None:
    grid = hall()
    turned = OccupancyGrid(grid.data, grid.resolution, (5.0, -2.0, 0.7), "turned")
    a, b = mapmeld.features(grid), mapmeld.features(turned)
    c, s = math.cos(0.7), math.sin(0.7)
    local = a.corners.vertex - np.array(grid.origin[:2])
    expected = local @ np.array([[c, s], [-s, c]]) + np.array([5.0, -2.0])
    for corner in expected:
        assert np.hypot(*(b.corners.vertex - corner).T).min() < 0.05


def test_text_and_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path,) = save(tmp_path / "maps", [hall()])
    monkeypatch.chdir(tmp_path)
    code, out, err = run_cli("inspect", path)
    assert (code, err) == (0, "")
    assert "45 x 30 cells of 0.1 m (4.50 x 3.00 m)" in out
    assert "lines: 8" in out
    assert "corners: 8 (4 inner, 4 outer)" in out
    assert "maps_hall_inspect.png" in out
    with Image.open(tmp_path / "maps_hall_inspect.png") as picture:
        assert picture.width > 500
    assert set(os.listdir(tmp_path)) == {"maps", "maps_hall_inspect.png"}
    monkeypatch.chdir(tmp_path / "maps")
    assert run_cli("inspect", "hall.yaml")[0] == 0
    assert (tmp_path / "maps" / "hall_inspect.png").is_file()


def test_the_picture_shows_classes_and_corners(tmp_path: Path) -> None:
    (path,) = save(tmp_path / "maps", [hall()])
    assert run_cli("inspect", path, "-o", tmp_path / "x.png")[0] == 0
    pixels = np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).reshape(-1, 3)
    for colour in [(30, 30, 30), (0, 114, 178), (213, 94, 0), (0, 158, 115)]:
        assert (np.abs(pixels.astype(int) - colour) <= 2).all(axis=1).sum() > 100, colour


def test_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path,) = save(tmp_path / "maps", [hall()])
    monkeypatch.chdir(tmp_path)
    code, out, err = run_cli("inspect", path, "--json")
    assert (code, err) == (0, "")
    contents = json.loads(out)
    assert contents == mapmeld.features(read_map(path)).to_dict()
    occupied = int((hall().data == 100).sum())
    assert contents["cells"] == {"free": 30 * 45 - occupied, "occupied": occupied, "unknown": 0}
    assert len(contents["corners"]) == 8
    assert set(os.listdir(tmp_path)) == {"maps"}
    assert run_cli("inspect", path, "--json", "-o", tmp_path / "x.png")[1] == out
    assert (tmp_path / "x.png").is_file()


def test_a_blank_map_has_nothing_to_see(tmp_path: Path) -> None:
    (path,) = save(tmp_path, [blank()])
    code, out, _ = run_cli("inspect", path, "-o", tmp_path / "x.png")
    assert code == 0
    assert "600 unknown" in out
    assert "corners: 0" in out


def test_options(tmp_path: Path) -> None:
    (path,) = save(tmp_path, [hall()])
    _, out, _ = run_cli("inspect", path, "-o", tmp_path / "x.png", "--set", "registration.max_corners=3")
    assert "corners: 3" in out
    assert_refused(run_cli("inspect", path, "--set", "a.b=3"), "--set a.b=3", "no such option")


def test_bad_pictures(tmp_path: Path) -> None:
    (path,) = save(tmp_path, [hall()])
    assert_refused(run_cli("inspect", path, "-o", tmp_path / "x.jpg"), "x.jpg", ".png")
    assert_refused(run_cli("inspect", path, "-o", tmp_path / "no" / "x.png"), "x.png", "cannot be written")
    (tmp_path / "dir.png").mkdir()
    assert_refused(run_cli("inspect", path, "-o", tmp_path / "dir.png"), "dir.png", "folder")
    mapmeld.write_map(tmp_path / "drawn.yaml", hall(), image_format="png")
    before = (tmp_path / "drawn.png").read_bytes()
    assert_refused(run_cli("inspect", tmp_path / "drawn.yaml", "-o", tmp_path / "drawn.png"), "own image")
    assert (tmp_path / "drawn.png").read_bytes() == before
    assert_refused(run_cli("inspect", tmp_path / "none.yaml"), "none.yaml", "no such file")
