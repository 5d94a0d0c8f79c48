"""The image half of a saved map: brightness and opacity of each pixel, from PGM, PNG or BMP."""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from mapmeld.errors import MapFileError
from mapmeld.map_yaml import one_line

MAX_CELLS = 2**28
"""Most pixels an image may have: 16384 x 16384, 819 m x 819 m at 5 cm. As cells they take 256 MiB; a header
that declares more is broken or made to exhaust memory, and is refused before anything is decoded."""

_HEADER_BYTES = 1 << 16
# First column, first row, column step and row step of the passes of an interlaced PNG.
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
# PGM header: magic, width, height, maxval; white space and comments between them, one white space after.
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PGM_HEADER = re.compile(rb"P[25]" + (_GAP + rb"(\d{1,18})") * 3 + rb"(?:#[^\r\n]*)?\s")


@dataclass(frozen=True, eq=False)
class MapImage:
    """An image as brightness, row 0 at the top.

    levels: shape (height, width), unsigned integers from 0 (black) to full_scale (white). Colour channels are
        summed, so that a level divided by full_scale is the mean of the channels without rounding.
    full_scale: the level of white, 1 to 65535.
    opaque: shape (height, width), bool, False where the alpha channel is below its maximum; None where the
        image has no alpha.
    """

    levels: NDArray[np.unsignedinteger[Any]]
    full_scale: int
    opaque: NDArray[np.bool_] | None


def read_map_image(path: Path) -> MapImage:
    """Reads a PGM (P2 or P5, 8 or 16 bits), PNG, BMP or PPM; the content decides which, not the suffix.

    Raises MapFileError, naming the file, for a file that is missing, empty, truncated, damaged, of another
    kind or larger than MAX_CELLS.
    """
    try:
        if not path.exists():
            _fail(path, "no such file; put it beside the yaml or correct 'image' there")
        # Opening a pipe would wait for a writer, a device may never end.
        if not path.is_file():
            _fail(path, "is not a regular file; correct 'image' in the yaml")
        with path.open("rb") as file:
            size = path.stat().st_size
            head = file.read(_HEADER_BYTES)
            if not head:
                _fail(path, "is empty; save the map again")
            if head[:2] in (b"P2", b"P5"):
                return _read_pgm(path, file, head, size)
            return _read_with_pillow(path, file, head, size)
    except MapFileError:
        raise
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise MapFileError(one_line(f"image {path}: cannot be read: {reason}")) from error


def _fail(path: Path, text: str) -> NoReturn:
    raise MapFileError(one_line(f"image {path}: {text}"))


def _check_size(path: Path, width: int, height: int) -> None:
    if width <= 0 or height <= 0:
        _fail(path, f"has no pixels (width {width}, height {height}); save the map again")
    if width * height > MAX_CELLS:
        _fail(
            path,
            f"declares {width} x {height} pixels, above the limit of {MAX_CELLS}; "
            "crop the map, or save it again if it is smaller than that",
        )


def _read_pgm(path: Path, file: BinaryIO, head: bytes, size: int) -> MapImage:
    # Read here and not by Pillow, which rescales to 8 bits any maxval but 255 and 65535.
    match = _PGM_HEADER.match(head)
    if match is None:
        _fail(path, "has a damaged or truncated PGM header; save the map again")
    width, height, maxval = (int(number) for number in match.groups())
    _check_size(path, width, height)
    if not 1 <= maxval <= 65535:
        _fail(path, f"declares the largest grey value {maxval}, must lie in 1..65535; save the map again")
    file.seek(match.end())
    dtype = np.dtype(np.uint8 if maxval < 256 else ">u2")
    count = width * height
    left = size - match.end()
    if head[:2] == b"P5":
        needed = count * dtype.itemsize
        data = file.read(needed) if left >= needed else b""
        if len(data) < needed:
            _fail(path, f"is truncated: {width} x {height} pixels need {needed} bytes, {left} are there")
        levels: NDArray[Any] = np.frombuffer(data, dtype=dtype)
    else:
        # Each number takes a digit and, but for the last, a space.
        tokens = re.sub(rb"#[^\r\n]*", b"", file.read()).split() if left >= 2 * count - 1 else []
        if len(tokens) < count:
            _fail(
                path,
                f"is truncated: it holds fewer than the {count} grey values of {width} x {height} pixels",
            )
        try:
            values = np.array([int(token) for token in tokens[:count]], dtype=np.int64)
        except (ValueError, OverflowError):
            _fail(path, "holds something else than grey values; save the map again")
        if values.min() < 0 or values.max() > maxval:
            _fail(path, f"holds a grey value outside 0..{maxval}; save the map again")
        levels = values.astype(dtype)
    if maxval not in (255, 65535) and levels.max() > maxval:
        _fail(path, f"holds a grey value above its declared largest, {maxval}; save the map again")
    return MapImage(levels.reshape(height, width), maxval, None)


def _read_with_pillow(path: Path, file: BinaryIO, head: bytes, size: int) -> MapImage:
    from PIL import BmpImagePlugin, PngImagePlugin, PpmImagePlugin

    # The plugins are called directly: Image.open would try every format it knows, and warn or raise by a
    # limit of its own, which is below MAX_CELLS and global.
    plugin: type[PngImagePlugin.PngImageFile | BmpImagePlugin.BmpImageFile | PpmImagePlugin.PpmImageFile]
    if head.startswith(b"\x89PNG\r\n\x1a\n"):
        plugin = PngImagePlugin.PngImageFile
        _check_png(path, file, size)
    elif head.startswith(b"BM"):
        plugin = BmpImagePlugin.BmpImageFile
        # 40 bytes or more: the header that every BMP but those of OS/2 has. A negative height: top row first.
        if len(head) >= 26 and struct.unpack("<I", head[14:18])[0] >= 40:
            width, height = struct.unpack("<ii", head[18:26])
            _check_size(path, width, abs(height))
    elif head[:2] in (b"P1", b"P3", b"P4", b"P6"):
        plugin = PpmImagePlugin.PpmImageFile
    else:
        _fail(path, "is not a PGM, PNG or BMP image; convert it to one of them")
    file.seek(0)
    try:
        with plugin(file) as image:
            _check_size(path, *image.size)
            image.load()
            return _levels(image)
    except MapFileError:
        raise
    # Pillow's decoders raise nearly anything on damaged files: OSError, SyntaxError, ValueError, EOFError,
    # struct.error, zlib.error, IndexError, TypeError, ...
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise MapFileError(
            one_line(f"image {path}: is truncated or damaged ({reason}); save the map again")
        ) from error


def _check_png(path: Path, file: BinaryIO, size: int) -> None:
    """Refuses a PNG that is truncated or damaged anywhere. Pillow fills up with black, which is occupied,
    where the compressed data ends early, skips the checksum of that data and does without the end mark."""
    file.seek(8)
    inflate = zlib.decompressobj()
    expected = found = 0
    kind = b""
    while kind != b"IEND":
        start = file.read(8)
        length, kind = struct.unpack(">I4s", start) if len(start) == 8 else (0, b"")
        # Not read and compared: reading sets aside the memory that a damaged length asks for.
        if not kind or file.tell() + length + 4 > size:
            _fail(path, "is truncated: the PNG ends early; save the map again")
        data = file.read(length)
        if zlib.crc32(kind + data) != int.from_bytes(file.read(4), "big"):
            _fail(path, "is damaged: a PNG checksum is wrong; save the map again")
        if kind == b"IHDR" and length == 13:
            expected = _png_data_size(path, data)
        while kind == b"IDAT" and data and found < expected:
            try:
                found += len(inflate.decompress(data, 1 << 20))
            except zlib.error as error:
                _fail(path, f"is damaged: {error}; save the map again")
            data = inflate.unconsumed_tail
    if found < expected:
        _fail(path, f"is truncated: its pixels need {expected} bytes, {found} are there; save the map again")


def _png_data_size(path: Path, header: bytes) -> int:
    """Bytes of the pixels of a PNG before compression, a filter byte per row included."""
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    _check_size(path, width, height)
    bits = depth * {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(colour, 1)
    size = 0
    for x, y, dx, dy in _ADAM7 if interlaced else ((0, 0, 1, 1),):
        columns, rows = -((x - width) // dx), -((y - height) // dy)
        if columns > 0:
            size += max(rows, 0) * (1 + (columns * bits + 7) // 8)
    return size


def _levels(image: Any) -> MapImage:
    transparent = image.info.get("transparency")
    if image.mode.startswith("I"):  # 16-bit grey; Pillow cannot convert it with its transparent value
        levels = np.asarray(image).astype(np.uint16)
        return MapImage(levels, 65535, None if transparent is None else levels != transparent)
    if transparent is not None or image.mode in ("LA", "PA", "RGBA"):
        pixels = np.asarray(image.convert("RGBA"))
        return MapImage(pixels[..., :3].sum(axis=2, dtype=np.uint16), 3 * 255, pixels[..., 3] == 255)
    if image.mode in ("1", "L"):
        return MapImage(np.asarray(image.convert("L")), 255, None)
    return MapImage(np.asarray(image.convert("RGB")).sum(axis=2, dtype=np.uint16), 3 * 255, None)
