"""The image of a map: every kind that is read, and damaged ones refused in one line."""

from __future__ import annotations

import io
import struct
import tracemalloc
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mapmeld.errors import MapFileError
from mapmeld.map_image import MAX_CELLS, read_map_image
from mapmeld.map_io import read_map

SaveMap = Callable[..., Path]
PIXELS = np.array([[0, 254, 205, 7], [100, 1, 255, 99], [254, 254, 0, 13]], dtype=np.uint8)


def encoded(image: Image.Image, image_format: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format=image_format, **options)
    return buffer.getvalue()


def refusal(path: Path) -> str:
    """The message for a map whose image is bad, raised without any warning before it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(MapFileError) as caught:
            read_map(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert "hall.yaml: image " in message
    return message


def brightness(tmp_path: Path, content: bytes) -> list[list[float]]:
    path = tmp_path / "image"
    path.write_bytes(content)
    image = read_map_image(path)
    return (image.levels / image.full_scale).tolist()


@pytest.mark.parametrize(
    "content",
    [
        b"P5\n4 3\n255\n" + PIXELS.tobytes(),
        b"P5 4 3 255 " + PIXELS.tobytes(),
        b"P5\n# CREATOR: map_saver 0.050 m/pix\n4 3\n255\n" + PIXELS.tobytes(),
        b"P5 # a\n# b\n4# c\n 3\n# d\n255\n" + PIXELS.tobytes() + b"more, which is not looked at",
        b"P5\n4 3\n65535\n" + (PIXELS.astype(">u2") * 257).tobytes(),
        b"P2\n4 3\n255\n" + " ".join(map(str, PIXELS.ravel())).encode(),
        b"P2\n# c\n4 3\n255\n0 254 205 7 # first row\n100 1 255 99\n254\r\n254 0\t13\n",
        b"P2\n4 3\n65535\n" + " ".join(str(257 * int(p)) for p in PIXELS.ravel()).encode(),
        encoded(Image.fromarray(PIXELS), "png"),
        encoded(Image.fromarray(PIXELS), "bmp"),
        encoded(Image.fromarray(PIXELS).convert("RGB"), "png"),
        encoded(Image.fromarray(PIXELS).convert("RGB"), "bmp"),
        encoded(Image.fromarray(PIXELS).convert("RGB"), "ppm"),
        encoded(Image.fromarray(PIXELS).convert("RGB").quantize(16), "png"),
        encoded(Image.fromarray(PIXELS).convert("RGBA"), "png"),
        encoded(Image.fromarray(PIXELS.astype(np.uint16) * 257), "png"),
    ],
)
def test_each_kind_gives_the_same_brightness(tmp_path: Path, content: bytes) -> None:
    np.testing.assert_allclose(brightness(tmp_path, content), PIXELS / 255, rtol=1e-12)


@pytest.mark.parametrize("maxval", [1, 3, 100, 254, 256, 1000, 65534])
def test_white_of_a_pgm_is_its_declared_largest_value(tmp_path: Path, maxval: int) -> None:
    levels = np.array([0, maxval // 2, maxval])
    p5 = f"P5 3 1 {maxval}\n".encode() + levels.astype("u1" if maxval < 256 else ">u2").tobytes()
    p2 = f"P2 3 1 {maxval}\n".encode() + " ".join(map(str, levels)).encode()
    assert brightness(tmp_path, p5) == brightness(tmp_path, p2) == [(levels / maxval).tolist()]


@pytest.mark.parametrize(("mode", "expected"), [("trinary", [-1, 100, 0]), ("raw", [50, -1, 0])])
def test_a_16_bit_pgm_is_scaled_to_its_range(save_map: SaveMap, mode: str, expected: list[int]) -> None:
    # 12880 / 65535 is 50.12 / 255, and 0.1965 occupied: just above free_thresh.
    content = b"P5 3 1 65535\n" + np.array([12880, 65535, 0], ">u2").tobytes()
    assert read_map(save_map(content, mode=mode, negate="1")).data.tolist() == [expected]


def test_a_1_bit_png_needs_whole_bytes_in_each_row(tmp_path: Path) -> None:
    assert brightness(tmp_path, png(9, 2, b"\0\x80\x80\0\x01\0", depth=1)) == [
        [1, 0, 0, 0, 0, 0, 0, 0, 1],
        [0, 0, 0, 0, 0, 0, 0, 1, 0],
    ]
    with pytest.raises(MapFileError, match="need 6 bytes, 5 are there"):
        brightness(tmp_path, png(9, 2, b"\0\x80\x80\0\x01", depth=1))


@pytest.mark.parametrize("height", [1, 1023, 1024, 1025, 3000])
def test_a_png_that_compresses_well_is_not_taken_for_truncated(tmp_path: Path, height: int) -> None:
    pixels = np.full((height, 1023), 205, dtype=np.uint8)
    assert brightness(tmp_path, encoded(Image.fromarray(pixels), "png"))[-1] == [205 / 255] * 1023


def test_a_png_chunk_of_a_huge_declared_length_takes_no_memory(save_map: SaveMap) -> None:
    path = save_map(SOURCES["png"][:33] + b"\xff\xff\xff\xffIDAT" + b"\0" * 50)
    tracemalloc.start()
    message = refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "is truncated" in message
    assert peak < 10e6


@pytest.mark.parametrize(
    ("image", "transparent"),
    [
        (Image.fromarray(PIXELS), 254),
        (Image.fromarray(PIXELS.astype(np.uint16)), 254),
        (Image.fromarray(PIXELS).convert("RGB"), (254, 254, 254)),
    ],
)
def test_the_transparent_value_of_a_png_is_not_opaque(
    tmp_path: Path, image: Image.Image, transparent: Any
) -> None:
    path = tmp_path / "image"
    path.write_bytes(encoded(image, "png", transparency=transparent))
    opaque = read_map_image(path).opaque
    assert opaque is not None
    assert opaque.tolist() == (PIXELS != 254).tolist()


SOURCES = {
    "p5": b"P5\n4 3\n255\n" + PIXELS.tobytes(),
    "p5_16": b"P5\n4 3\n65535\n" + PIXELS.astype(">u2").tobytes(),
    "p2": b"P2\n4 3\n255\n" + " ".join(map(str, PIXELS.ravel())).encode(),
    "p3": b"P3\n2 1\n255\n0 0 0 255 255 255",
    "p6": encoded(Image.fromarray(PIXELS).convert("RGB"), "ppm"),
    "png": encoded(Image.fromarray(PIXELS), "png"),
    "png_rgba": encoded(Image.fromarray(PIXELS).convert("RGBA"), "png"),
    "bmp": encoded(Image.fromarray(PIXELS), "bmp"),
    "bmp_rgb": encoded(Image.fromarray(PIXELS).convert("RGB"), "bmp"),
}
# The digits of the last number of a text format may be cut off unnoticed.
LAST_DIGITS = {"p2": 1, "p3": 2}


@pytest.mark.parametrize("kind", SOURCES)
def test_a_truncated_image_is_refused_wherever_it_is_cut(
    save_map: SaveMap, tmp_path: Path, kind: str
) -> None:
    content = SOURCES[kind]
    for length in range(len(content) - LAST_DIGITS.get(kind, 0)):
        assert "hall.pgm" in refusal(save_map(content[:length])), length


@pytest.mark.parametrize("kind", ["png", "png_rgba"])
def test_a_flipped_bit_of_a_png_is_noticed_wherever_it_is(save_map: SaveMap, kind: str) -> None:
    for position in range(8, len(SOURCES[kind])):
        content = bytearray(SOURCES[kind])
        content[position] ^= 4
        refusal(save_map(bytes(content)))


# Column and row of the first pixel, and the steps from there, of each pass (PNG specification, section 8).
ADAM7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]


@pytest.mark.parametrize(("width", "height"), [(1, 1), (3, 2), (5, 9), (17, 4)])
@pytest.mark.parametrize("cut", [0, 1])
def test_an_interlaced_png_needs_the_data_of_all_seven_passes(
    tmp_path: Path, width: int, height: int, cut: int
) -> None:
    data = b""
    for x, y, dx, dy in [
        (0, 0, 8, 8),
        (4, 0, 8, 8),
        (0, 4, 4, 8),
        (2, 0, 4, 4),
        (0, 2, 2, 4),
        (1, 0, 2, 2),
        (0, 1, 1, 2),
    ]:
        columns = len(range(x, width, dx))
        data += (b"\0" + b"\xfe" * columns) * len(range(y, height, dy)) if columns else b""
    content = png(width, height, data[: len(data) - cut], interlaced=1)
    if cut:
        with pytest.raises(MapFileError, match="is truncated"):
            brightness(tmp_path, content)
    else:
        assert brightness(tmp_path, content) == [[254 / 255] * width] * height


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, data: bytes, interlaced: int = 0, depth: int = 8) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, interlaced)
    chunks = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", zlib.compress(data)) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def bmp(width: int, height: int) -> bytes:
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54, 0, 0, 54) + info + b"\0" * 12


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"resolution: 0.05\n", "is not a PGM, PNG or BMP image"),
        (b"\xff\xd8\xff\xe0" + b"\0" * 50, "is not a PGM, PNG or BMP image"),
        (b"P5\n4 3\n", "PGM header"),
        (b"P5\n-4 3\n255\n" + b"\0" * 12, "PGM header"),
        (b"P5\nx 3\n255\n" + b"\0" * 12, "PGM header"),
        (b"P5\n4 3\n255", "PGM header"),
        (b"P5\n0 3\n255\n", "has no pixels"),
        (b"P2\n3 0\n255\n", "has no pixels"),
        (b"P5\n4 3\n0\n" + b"\0" * 12, "largest grey value 0"),
        (b"P5\n4 3\n65536\n" + b"\0" * 24, "largest grey value 65536"),
        (b"P5\n2 1\n100\n\x64\x65", "above its declared largest, 100"),
        (b"P2\n2 1\n100\n100 101", "outside 0..100"),
        (b"P2\n2 1\n100\n100 -1", "outside 0..100"),
        (b"P2\n2 1\n255\n1 1.5", "something else than grey values"),
        (b"P2\n2 1\n255\n1 " + b"9" * 30, "something else than grey values"),
        (b"P2\n2 1\n255\n100", "is truncated"),
        (b"P5\n4 3\n255\n" + b"\0" * 11, "4 x 3 pixels need 12 bytes, 11 are there"),
        (b"P5\n4 3\n256\n" + b"\0" * 12, "4 x 3 pixels need 24 bytes, 12 are there"),
        (png(0, 3, b""), "has no pixels"),
        (png(4, 3, b"\0" * 14), "its pixels need 15 bytes, 14 are there"),
        (b"\x89PNG\r\n\x1a\n" + png_chunk(b"IEND", b""), "truncated or damaged"),
        (bmp(0, 2), "has no pixels"),
        (bmp(4, 3), "truncated or damaged"),
    ],
)
def test_a_damaged_image_is_refused(save_map: SaveMap, content: bytes, says: str) -> None:
    message = refusal(save_map(content))
    assert "hall.pgm" in message
    assert says in message


@pytest.mark.parametrize(
    "content",
    [
        b"P5\n100000 100000\n255\n" + b"\0" * 100,
        b"P5\n16385 16384\n255\n" + b"\0" * 100,
        b"P2\n100000 100000\n255\n0 0 0",
        b"P5\n999999999999999999 999999999999999999\n255\n\0",
        b"P6\n100000 100000\n255\n" + b"\0" * 100,
        png(100000, 100000, b"\0" * 100),
        bmp(100000, 100000),
    ],
)
def test_a_huge_declared_size_is_refused_before_it_is_decoded(save_map: SaveMap, content: bytes) -> None:
    path = save_map(content)
    tracemalloc.start()
    message = refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert f"above the limit of {MAX_CELLS}" in message
    assert peak < 10e6


def test_a_large_declared_size_with_little_data_is_truncated(save_map: SaveMap) -> None:
    for content in (b"P5 16384 16384 255\n\0", b"P2 16384 16384 255\n0", png(16384, 16384, b"\0" * 100)):
        assert "is truncated" in refusal(save_map(content))


def test_a_png_above_pillows_own_limit_is_read_without_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(brightness(tmp_path, SOURCES["png"])) == 3


def test_an_image_that_is_no_file_is_refused(save_map: SaveMap, tmp_path: Path) -> None:
    assert "absent.pgm: no such file" in refusal(save_map(b"", image="absent.pgm"))
    (tmp_path / "folder").mkdir()
    assert "folder: is not a regular file" in refusal(save_map(b"", image="folder"))
    refusal(save_map(b"", image='"nul\\0.pgm"'))
    assert "two lines.pgm: no such file" in refusal(save_map(b"", image='"two\\nlines.pgm"'))
