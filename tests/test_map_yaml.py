"""The yaml of a map: what is accepted, and the one line that says why another is not."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mapmeld.errors import MapFileError
from mapmeld.map_io import read_map

SaveMap = Callable[..., Path]
IMAGE = b"P5\n1 1\n255\n\x00"
LONG = b"\n# a long file is read by another parser" * 40


def refusal(path: Path) -> str:
    with pytest.raises(MapFileError) as caught:
        read_map(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert path.name in message
    return message


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        *((field, None, "missing") for field in ("image", "resolution", "origin", "negate")),
        *((field, None, "missing") for field in ("occupied_thresh", "free_thresh")),
        *(("image", value, "must be the name") for value in ("[a.pgm, b.pgm]", "", "''", "5", "{a: b}")),
        *(("resolution", value, "must be a number") for value in ("'0.05'", "fine", "true", "[0.05]", "")),
        ("resolution", "'0.05'", "remove the quotes"),
        *(("resolution", value, "must be a finite number") for value in (".nan", ".inf", "1e999", "9" * 400)),
        *(("resolution", value, "must be a positive number") for value in ("0", "-0.05", "-0.0")),
        *(
            ("origin", value, "list of three")
            for value in ("[0, 0]", "[0, 0, 0, 0]", "0", "{x: 0}", "", "0 0 0")
        ),
        *(
            ("origin", value, "number")
            for value in ("[0, '0', 0]", "[0, 0, east]", "[true, 0, 0]", "[[0], 0, 0]")
        ),
        *(("origin", value, "finite") for value in ("[.nan, 0, 0]", "[0, -.inf, 0]", "[0, 0, .inf]")),
        *(("negate", value, "must be 0, 1") for value in ("2", "-1", "0.0", "'0'", "maybe", "[0]", "")),
        *(("occupied_thresh", value, "must lie in 0..1") for value in ("1.5", "-0.1", "65")),
        *(("free_thresh", value, "must lie in 0..1") for value in ("-0.001", "25")),
        *(("free_thresh", value, "must be below occupied_thresh") for value in ("0.65", "0.9")),
        *(("occupied_thresh", value, "number") for value in ("high", "true", ".nan", "[0.65]")),
        *(("free_thresh", value, "number") for value in ("low", "false", ".nan", "''")),
        *(
            ("mode", value, "must be one of trinary, scale, raw")
            for value in ("grey", "1", "[raw]", "", "''")
        ),
    ],
)
def test_a_bad_field_is_named(save_map: SaveMap, field: str, value: str | None, says: str) -> None:
    message = refusal(save_map(IMAGE, **{field: value}))
    assert f"hall.yaml: {field}" in message
    assert says in message
    assert len(message) < 400


def test_all_missing_fields_are_named_at_once(save_map: SaveMap) -> None:
    assert "origin, free_thresh: missing; add them" in refusal(save_map(IMAGE, origin=None, free_thresh=None))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is not a yaml mapping"),
        (b"# nothing\n", "is not a yaml mapping"),
        (b"- image: a.pgm\n", "is not a yaml mapping"),
        (b"just words", "is not a yaml mapping"),
        (b"image: [a.pgm\nresolution: 1\n", "is not valid yaml: line "),
        (b"image: a\n\tresolution: 1\n", "is not valid yaml: line 2"),
        (b"image: a\n---\nimage: b\n", "is not valid yaml"),
        (b"image: !!python/object/apply:os.getcwd []\n", "is not valid yaml"),
        (b"image: &a [*a, *b]\n", "is not valid yaml"),
        (b"date: 2024-13-45\n", "is not valid yaml"),
        (b"? [a]\n: b\n", "is not valid yaml"),
        (b"\x00\x01\x02", "is not valid yaml"),
        (b"image: caf\xe9.pgm\n", "is not UTF-8 text"),
        (IMAGE[:-1] + b"\xcd" * 100, "is not UTF-8 text"),
        (b"[" * 60000, "is not valid yaml"),
        (b"- " * 30000, "is not valid yaml"),
        (b" " * 70000, "is larger than"),
    ],
)
@pytest.mark.parametrize("more", [b"", LONG], ids=["short", "long"])
def test_a_file_that_is_no_map_yaml_is_refused(
    tmp_path: Path, content: bytes, says: str, more: bytes
) -> None:
    path = tmp_path / "hall.yaml"
    path.write_bytes(content + more)
    assert says in refusal(path)


def test_a_field_given_twice_is_refused(save_map: SaveMap) -> None:
    path = save_map(IMAGE)
    path.write_text(path.read_text() + "resolution: 0.1\n")
    assert "hall.yaml: resolution: given 2 times" in refusal(path)


def test_a_path_that_is_no_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "absent.yaml")
    (tmp_path / "folder.yaml").mkdir()
    assert "is a folder" in refusal(tmp_path / "folder.yaml")
    assert "is a folder" in refusal(tmp_path)
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    refusal(tmp_path / "loop.yaml")
    refusal(tmp_path / ("long" * 100 + ".yaml"))
    with pytest.raises(MapFileError):
        read_map("nul\0.yaml")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_refused_and_not_waited_for(save_map: SaveMap, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    assert "is not a regular file" in refusal(tmp_path / "pipe.yaml")
    assert "is not a regular file" in refusal(save_map(IMAGE, image="pipe.yaml"))


@pytest.mark.parametrize(
    ("fields", "resolution", "origin"),
    [
        ({"resolution": "1"}, 1.0, (0.0, 0.0, 0.0)),
        ({"resolution": "5e-2", "origin": "[1e3, -2E-1, 1e-07]"}, 0.05, (1000.0, -0.2, 1e-07)),
        ({"origin": "\n  - 1\n  - -2.5\n  - .5"}, 0.05, (1.0, -2.5, 0.5)),
        ({"cost_scaling": "[1, {a: b}]", "Image": "other.pgm"}, 0.05, (0.0, 0.0, 0.0)),
        ({"image": "'hall.pgm'  # quoted"}, 0.05, (0.0, 0.0, 0.0)),
    ],
)
def test_what_nav2_accepts_is_accepted(
    save_map: SaveMap, fields: dict[str, str], resolution: float, origin: tuple[float, ...]
) -> None:
    path = save_map(IMAGE, **fields)
    for more in (b"", LONG):
        path.write_bytes(path.read_bytes() + more)
        grid = read_map(path)
        assert (grid.resolution, grid.origin) == (resolution, origin)


def test_a_byte_order_mark_and_windows_line_ends_are_accepted(save_map: SaveMap) -> None:
    path = save_map(IMAGE, resolution="0.2")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    for more in (b"", LONG.replace(b"\n", b"\r\n")):
        path.write_bytes(path.read_bytes() + more)
        assert read_map(path).resolution == 0.2
