"""Reading and writing whole maps: what pixels become, the row flip, and the way there and back."""

from __future__ import annotations

import io
import math
import os
import stat
from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from mapmeld.errors import MapFileError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_io import read_map, write_map

SaveMap = Callable[..., Path]

ALL_PIXELS = np.arange(256, dtype=np.uint8).reshape(16, 16)
ALL_CELLS = np.append(np.arange(-1, 101), [-1, 0]).reshape(8, 13)


def pgm(pixels: np.ndarray) -> bytes:
    return f"P5\n{pixels.shape[1]} {pixels.shape[0]}\n255\n".encode() + pixels.astype(np.uint8).tobytes()


def encoded(pixels: np.ndarray, image_format: str) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format=image_format)
    return buffer.getvalue()


def nav2_cells(pixel: int, mode: str, negate: bool, occupied: str, free: str) -> set[int]:
    """What nav2_map_server makes of a grey pixel, in exact arithmetic. Halfway between two cell values its
    versions round differently, by the errors of single or double precision: there, both are right."""
    if mode == "raw":
        return {pixel if pixel <= 100 else -1}
    occupancy = Fraction(pixel if negate else 255 - pixel, 255)
    if occupancy <= Fraction(free):
        return {0}
    if occupancy >= Fraction(occupied):
        return {100}
    if mode == "trinary":
        return {-1}
    percent = (occupancy - Fraction(free)) / (Fraction(occupied) - Fraction(free)) * 100
    half = Fraction(1, 2)
    return {math.ceil(percent - half), math.floor(percent + half)}


@pytest.mark.parametrize(
    ("occupied", "free"),
    [("0.65", "0.196"), ("0.65", "0.25"), ("1.0", "0.0"), ("0.6", "0.2"), ("0.8", "0.4")],
)
@pytest.mark.parametrize("negate", ["0", "1", "false", "true"])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_each_pixel_is_read_as_nav2_reads_it(
    save_map: SaveMap, mode: str, negate: str, occupied: str, free: str
) -> None:
    path = save_map(pgm(ALL_PIXELS), mode=mode, negate=negate, occupied_thresh=occupied, free_thresh=free)
    for pixel, cell in enumerate(read_map(path).data[::-1].ravel().tolist()):
        assert cell in nav2_cells(pixel, mode, negate in ("1", "true"), occupied, free), pixel


def test_without_mode_a_map_is_trinary_and_a_mode_may_be_in_capitals(save_map: SaveMap) -> None:
    pixels = np.array([[0, 254, 205, 130]])
    assert read_map(save_map(pgm(pixels))).data.tolist() == [[100, 0, -1, -1]]
    assert read_map(save_map(pgm(pixels), mode="RAW")).data.tolist() == [[0, -1, -1, -1]]


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("trinary", [100, 0, -1, -1, -1, -1]),
        ("scale", [100, 0, 54, -1, -1, -1]),
        ("raw", [0, -1, -1, 0, -1, 100]),
    ],
)
def test_a_pixel_that_is_not_opaque_is_unknown_but_in_raw_mode(
    save_map: SaveMap, mode: str, expected: list[int]
) -> None:
    pixels = np.array([[[0, 255], [255, 255], [142, 255], [0, 254], [255, 0], [100, 128]]], dtype=np.uint8)
    rgba = np.concatenate([pixels[..., :1].repeat(3, axis=2), pixels[..., 1:]], axis=2)
    for image in (pixels, rgba):
        path = save_map(encoded(image, "png"), "hall.png", mode=mode)
        assert read_map(path).data.tolist() == [expected]


def test_colours_count_with_their_mean(save_map: SaveMap) -> None:
    # Means 85 (occupancy 0.667), 170 (0.333) and 89.33 (0.6497): the last is occupied if it is rounded.
    pixels = np.array([[[255, 0, 0], [0, 255, 0], [255, 255, 0], [90, 89, 89]]], dtype=np.uint8)
    for image_format in ("png", "bmp", "ppm"):
        path = save_map(encoded(pixels, image_format), f"hall.{image_format}")
        assert read_map(path).data.tolist() == [[100, 100, -1, -1]]


def test_the_top_row_of_the_image_is_the_row_of_the_highest_y(save_map: SaveMap) -> None:
    grid = read_map(save_map(pgm(np.array([[0, 254], [205, 254], [254, 254]]))))
    assert grid.data.tolist() == [[0, 0], [-1, 0], [100, 0]]
    top_left = grid.cell_centers(*np.nonzero(grid.data == 100))
    np.testing.assert_allclose(top_left, [[0.025, 0.125]])


def test_a_rotated_origin_is_kept(save_map: SaveMap) -> None:
    path = save_map(pgm(np.full((2, 3), 254)), resolution="0.1", origin=f"[2, -3.5, {math.pi / 2}]")
    grid = read_map(path)
    assert grid.origin == (2.0, -3.5, math.pi / 2)
    # A quarter turn to the left: columns go up, rows go left.
    np.testing.assert_allclose(grid.cell_centers(np.array([1]), np.array([2])), [[2 - 0.15, -3.5 + 0.25]])


def test_name_suffix_and_image_path(save_map: SaveMap, tmp_path: Path) -> None:
    path = save_map(pgm(np.array([[0]])))
    assert read_map(path).name == "hall"
    assert read_map(str(path)).data.tolist() == [[100]]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    text = path.read_text()
    (elsewhere / "floor.2.yml").write_text(text.replace("hall.pgm", str(tmp_path / "hall.pgm")))
    assert read_map(elsewhere / "floor.2.yml").name == "floor.2"
    (elsewhere / "up.yaml").write_text(text.replace("hall.pgm", "../hall.pgm"))
    assert read_map(elsewhere / "up.yaml").data.tolist() == [[100]]


def test_an_image_in_place_of_the_yaml_is_refused_with_the_yaml_named(
    save_map: SaveMap, tmp_path: Path
) -> None:
    path = save_map(pgm(np.array([[0]])))
    with pytest.raises(MapFileError, match=r"hall\.pgm: is not a \.yaml file; pass .*hall\.yaml$"):
        read_map(path.with_suffix(".pgm"))
    with pytest.raises(MapFileError, match=r"other\.png: .*; pass the yaml beside the image$"):
        read_map(tmp_path / "other.png")


@pytest.mark.parametrize("image_format", ["pgm", "png", "bmp"])
def test_trinary_comes_back_in_its_three_classes(tmp_path: Path, image_format: str) -> None:
    grid = OccupancyGrid(ALL_CELLS, 0.05, (1 / 3, -1e-7, 2 / 3), "ward")
    write_map(tmp_path / "ward", grid, image_format=image_format)  # type: ignore[arg-type]
    expected = np.where(ALL_CELLS >= 65, 100, np.where((ALL_CELLS >= 0) & (ALL_CELLS <= 25), 0, -1))
    back = read_map(tmp_path / "ward.yaml")
    assert back.data.tolist() == expected.tolist()
    assert (back.resolution, back.origin, back.name) == (0.05, grid.origin, "ward")
    with Image.open(tmp_path / f"ward.{image_format}") as image:
        pixels = np.asarray(image.convert("L"))[::-1]
    assert Counter(zip(expected.ravel().tolist(), pixels.ravel().tolist(), strict=True)).keys() == {
        (100, 0),
        (0, 254),
        (-1, 205),
    }


@pytest.mark.parametrize(
    ("mode", "image_format"), [("scale", "png"), ("raw", "pgm"), ("raw", "png"), ("raw", "bmp")]
)
def test_scale_and_raw_come_back_cell_by_cell(tmp_path: Path, mode: str, image_format: str) -> None:
    write_map(tmp_path / "ward", OccupancyGrid(ALL_CELLS, 0.1), mode=mode, image_format=image_format)  # type: ignore[arg-type]
    assert read_map(tmp_path / "ward.yaml").data.tolist() == ALL_CELLS.tolist()


def test_the_written_yaml_is_a_plain_map_server_yaml(tmp_path: Path) -> None:
    write_map(tmp_path / "ward.yaml", OccupancyGrid([[0, 100]], 0.05, (1.5, -2.0, 1e-7)))
    assert yaml.safe_load((tmp_path / "ward.yaml").read_text()) == {
        "image": "ward.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [1.5, -2.0, 1e-7],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }


@pytest.mark.parametrize(
    ("given", "written"),
    [
        ("a", "a.yaml"),
        ("a.yaml", "a.yaml"),
        ("a.yml", "a.yml"),
        ("a.v2", "a.v2.yaml"),
        ("é: #1", "é: #1.yaml"),
    ],
)
def test_write_map_names_both_files_by_the_stem(tmp_path: Path, given: str, written: str) -> None:
    write_map(tmp_path / given, OccupancyGrid([[100]], 0.05))
    stem = written.rpartition(".")[0]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([written, f"{stem}.pgm"])
    assert read_map(tmp_path / written).name == stem


def test_a_failed_write_leaves_the_old_map_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_map(tmp_path / "a", OccupancyGrid([[100]], 0.05))
    renamed = []

    def replace(source: Path, target: Path) -> None:
        renamed.append(Path(target).name)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(MapFileError, match=r"a\.pgm: cannot be written: No space left"):
        write_map(tmp_path / "a", OccupancyGrid([[0, 0]], 0.1))
    assert renamed == ["a.pgm"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.pgm", "a.yaml"]
    assert read_map(tmp_path / "a.yaml").data.tolist() == [[100]]


def test_the_image_is_in_place_before_the_yaml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda a, b: (order.append(Path(b).name), replace(a, b)))
    write_map(tmp_path / "a", OccupancyGrid([[100]], 0.05))
    assert order == ["a.pgm", "a.yaml"]


@pytest.mark.skipif(os.name != "posix", reason="file permissions of POSIX")
def test_written_files_have_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_map(tmp_path / "a", OccupancyGrid([[100]], 0.05))
    assert len({stat.S_IMODE(p.stat().st_mode) for p in tmp_path.iterdir()}) == 1


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("absent/a", {}, r"absent/a\.pgm: cannot be written: No such file or directory"),
        ("a.png", {}, r"a\.png: is an image's name"),
        ("", {}, r"is not the name of a file"),
        ("a", {"mode": "grey"}, r"a\.yaml: mode: must be one of trinary, scale, raw, got 'grey'"),
        ("a", {"image_format": "gif"}, r"a\.yaml: image_format: must be one of pgm, png, bmp, got 'gif'"),
        ("a", {"mode": "scale"}, r"a\.yaml: image_format: mode scale needs transparent pixels; use 'png'"),
    ],
)
def test_write_map_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, options: dict[str, str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MapFileError, match=message):
        write_map(name, OccupancyGrid([[100]], 0.05), **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_recorded_maps_hold_the_classes_their_pixels_say(shared_data: Path, tmp_path: Path) -> None:
    paths = sorted(shared_data.glob("*/*.yaml"))
    assert paths
    for path in paths:
        # The recorded files are P5 without comments; a reader of three lines is the oracle.
        _, size, _, pixels = path.with_suffix(".pgm").read_bytes().split(b"\n", 3)
        counts = Counter(pixels)
        assert counts.keys() <= {0, 205, 254}
        grid = read_map(path)
        assert (grid.width, grid.height) == tuple(int(n) for n in size.split())
        assert [int((grid.data == c).sum()) for c in (100, 0, -1)] == [counts[p] for p in (0, 254, 205)]
        write_map(tmp_path / "copy", grid)
        copy = read_map(tmp_path / "copy.yaml")
        assert (copy.resolution, copy.origin) == (grid.resolution, grid.origin)
        assert (tmp_path / "copy.pgm").read_bytes().endswith(pixels)


def test_a_recorded_map_keeps_its_yaw(shared_data: Path) -> None:
    grids = [read_map(path) for path in sorted((shared_data / "seattle_pair_hi").glob("*.yaml"))]
    assert any(grid.origin[2] != 0 for grid in grids)


@pytest.mark.parametrize("free_thresh", ["0.196", "0.25", "0.45"])
@pytest.mark.parametrize("colours", [False, True])
def test_what_map_saver_wrote_for_unknown_is_unknown(
    save_map: SaveMap, free_thresh: str, colours: bool
) -> None:
    """Its former default free_thresh, 0.25, would make it free."""

    def read(pixels: list[list[int]]) -> list[list[int]]:
        grey = np.array(pixels, dtype=np.uint8)
        content = encoded(np.stack([grey] * 3, axis=-1), "png") if colours else pgm(grey)
        return read_map(save_map(content, free_thresh=free_thresh)).data[::-1].tolist()

    assert read([[0, 254, 205], [205, 254, 254]]) == [[100, 0, -1], [-1, 0, 0]]
    # Where another grey says that it is another's image, it is read as map_server does.
    unknown = -1 if free_thresh == "0.196" else 0
    assert read([[0, 254, 205], [205, 254, 230]]) == [[100, 0, unknown], [unknown, 0, 0]]
