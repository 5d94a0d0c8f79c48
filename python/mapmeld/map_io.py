"""Saved maps: reads and writes the yaml and image pairs of ROS map_server and nav2_map_server."""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import yaml
from numpy.typing import NDArray

from mapmeld.errors import MapFileError
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from mapmeld.map_image import MapImage, read_map_image
from mapmeld.map_yaml import MODES, YAML_SUFFIXES, MapMode, MapYaml, one_line, read_map_yaml

ImageFormat = Literal["pgm", "png", "bmp"]
"""The image formats that write_map writes, named by their suffix."""

# The pixels that map_saver writes in trinary mode, and the thresholds that tell them apart again: unknown is
# (255 - 205) / 255 = 0.19608 occupied, which 0.196 leaves unknown and map_saver's own 0.25 would make free.
_TRINARY_OCCUPIED, _TRINARY_FREE, _TRINARY_UNKNOWN = 0, 254, 205
_TRINARY_THRESHOLDS = (0.65, 0.196)
_UNKNOWN_OCCUPANCY = (255 - _TRINARY_UNKNOWN) / 255
# Cells from and up to which write_map calls a cell occupied or free, in percent; map_saver's defaults.
_OCCUPIED_FROM, _FREE_UP_TO = 65, 25


def read_map(path: str | os.PathLike[str], name: str | None = None) -> OccupancyGrid:
    """Reads a saved map from its yaml (.yaml or .yml), which names the image.

    The grid is called `name` or, without one, like the yaml without its suffix, and keeps the yaml's origin,
    yaw included. The top row of the image becomes the grid's last row, the one of the highest y.

    A pixel's occupancy is 1 - brightness, or the brightness with `negate`; the brightness, 0 to 1, is the
    mean of the colour channels. The yaml's `mode` (trinary if it has none) decides what becomes of it:

    trinary: 100 from occupied_thresh on, 0 up to free_thresh, else unknown; a pixel that is not fully opaque
        is unknown.
    scale: the same, but between the thresholds the cell rises linearly from 0 to 100, rounded.
    raw: the pixel itself, on a scale of 0 to 255, is the cell; above 100 it is unknown. `negate`, the
        thresholds and opacity have no part in it.

    This is how nav2_map_server (map_io.cpp) reads maps since navigation2 pull request 5071 (2025), but for
    colour, which it has weighed by luminance from then on, and for scale cells halfway between two values.
    Before, it averaged the colours, left a trinary cell exactly on a threshold unknown, and in trinary mode
    averaged opacity with the colours. Trinary maps from map_saver read alike in all, with one exception: its
    former default, a free_thresh of 0.25, makes its own unknown pixels free. They are unknown here, where all
    pixels are of the three that map_saver writes.

    Raises MapFileError, naming the file and the field, for a file that is missing, damaged or truncated, a
    field that is missing or out of range, and an image above map_image.MAX_CELLS pixels.
    """
    yaml_path = Path(path)
    check_is_yaml(yaml_path)
    fields = read_map_yaml(yaml_path)
    try:
        image = read_map_image(fields.image)
    except MapFileError as error:
        raise MapFileError(one_line(f"{yaml_path}: {error}")) from error
    cell_of_level = _cell_of_level(fields, image.full_scale)
    if _takes_unknown_for_free(fields) and _is_of_map_saver(image):
        cell_of_level[_TRINARY_UNKNOWN * image.full_scale // 255] = UNKNOWN
    cells = _looked_up(image.levels, cell_of_level)
    if image.opaque is not None and fields.mode != "raw":
        cells[~image.opaque] = UNKNOWN
    return OccupancyGrid(cells[::-1], fields.resolution, fields.origin, name or yaml_path.stem)


def write_map(
    path: str | os.PathLike[str],
    grid: OccupancyGrid,
    *,
    mode: MapMode = "trinary",
    image_format: ImageFormat = "pgm",
) -> None:
    """Writes `grid` as <path>.yaml and, beside it, <path>.<image_format>; `path` may end in .yaml or .yml.

    trinary: cells from 65 on are written as occupied (pixel 0), up to 25 as free (254), others as unknown
        (205), with occupied_thresh 0.65 and free_thresh 0.196, as nav2's map_saver does. read_map and
        map_server read exactly these three classes, as 100, 0 and -1; values in between are lost.
    scale: dark in proportion to the cell, with thresholds 1 and 0, so that all 102 cell values come back.
        Unknown is a transparent pixel, hence image_format "png" only.
    raw: the pixel is the cell, unknown is 255. All 102 cell values come back.

    Resolution and origin, yaw included, come back to the last bit. Each file is replaced in one step, the
    image first: whoever reads meanwhile finds no half-written file and no yaml without its image. The folder
    must exist.

    Raises MapFileError, naming the file, if one cannot be written, and for an unknown mode or image format.
    """
    yaml_path = Path(path)
    if yaml_path.name in ("", ".."):
        raise MapFileError(one_line(f"{yaml_path}: is not the name of a file; pass the yaml's"))
    if yaml_path.suffix.lower().lstrip(".") in get_args(ImageFormat):
        raise MapFileError(one_line(f"{yaml_path}: is an image's name; pass the yaml's, or neither suffix"))
    if yaml_path.suffix.lower() not in YAML_SUFFIXES:
        # Not with_suffix: "floor.v2" is a name, not a suffix.
        yaml_path = yaml_path.parent / f"{yaml_path.name}.yaml"
    if mode not in MODES:
        raise MapFileError(one_line(f"{yaml_path}: mode: must be one of {', '.join(MODES)}, got {mode!r}"))
    if image_format not in get_args(ImageFormat):
        formats = ", ".join(get_args(ImageFormat))
        raise MapFileError(
            one_line(f"{yaml_path}: image_format: must be one of {formats}, got {image_format!r}")
        )
    if mode == "scale" and image_format != "png":
        raise MapFileError(
            one_line(f"{yaml_path}: image_format: mode scale needs transparent pixels; use 'png'")
        )

    image_path = yaml_path.parent / f"{yaml_path.stem}.{image_format}"
    occupied_thresh, free_thresh = (1.0, 0.0) if mode == "scale" else _TRINARY_THRESHOLDS
    fields = {
        "image": image_path.name,
        "mode": mode,
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": occupied_thresh,
        "free_thresh": free_thresh,
    }
    text = yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, allow_unicode=True, width=10_000)
    _replace_file(image_path, _encode(_pixel_of_cell(mode)[grid.data[::-1]], image_format))
    _replace_file(yaml_path, text.encode("utf-8"))


def check_is_yaml(path: Path) -> None:
    """Raises MapFileError for a file that by its name is no yaml, as an image is none; says which to pass."""
    if not path.suffix and not os.path.lexists(path):
        raise MapFileError(one_line(f"{path}: no such file or folder; check the path"))
    if path.suffix.lower() not in YAML_SUFFIXES and not path.is_dir():
        raise MapFileError(one_line(f"{path}: is not a .yaml file; {_advise_yaml(path)}"))


def _advise_yaml(path: Path) -> str:
    for suffix in YAML_SUFFIXES:
        if (beside := path.with_name(f"{path.stem}{suffix}")).is_file():
            return f"pass {beside}"
    return "pass the yaml beside the image"


def _takes_unknown_for_free(fields: MapYaml) -> bool:
    """Whether the thresholds of a trinary map call free what map_saver writes for unknown."""
    return fields.mode == "trinary" and not fields.negate and fields.free_thresh >= _UNKNOWN_OCCUPANCY


def _is_of_map_saver(image: MapImage) -> bool:
    """Whether the image has pixels for unknown and free cells as map_saver writes them, and no others but for
    occupied ones."""
    if image.full_scale % 255:
        return False
    levels = set(np.flatnonzero(np.bincount(image.levels.ravel())).tolist())
    occupied, free, unknown = (
        p * (image.full_scale // 255) for p in (_TRINARY_OCCUPIED, _TRINARY_FREE, _TRINARY_UNKNOWN)
    )
    return {free, unknown} <= levels <= {occupied, free, unknown}


def _cell_of_level(fields: MapYaml, full_scale: int) -> NDArray[np.int8]:
    """The cell value of each brightness level, shape (full_scale + 1,)."""
    level = np.arange(full_scale + 1)
    if fields.mode == "raw":
        pixel = np.floor(level * 255 / full_scale + 0.5)
        return np.where(pixel <= OCCUPIED, pixel, UNKNOWN).astype(np.int8)
    # One division of integers: a level that is exactly on a threshold compares equal to it.
    occupancy = (level if fields.negate else full_scale - level) / full_scale
    if fields.mode == "scale":
        share = (occupancy - fields.free_thresh) / (fields.occupied_thresh - fields.free_thresh)
        # Clipped only so that what the next lines overwrite fits in int8.
        cell = np.floor(np.clip(share, 0.0, 1.0) * 100 + 0.5).astype(np.int8)
    else:
        cell = np.full(full_scale + 1, UNKNOWN, dtype=np.int8)
    cell[occupancy >= fields.occupied_thresh] = OCCUPIED
    cell[occupancy <= fields.free_thresh] = FREE
    return cell


def _looked_up(levels: NDArray[np.unsignedinteger[Any]], cell_of_level: NDArray[np.int8]) -> NDArray[np.int8]:
    """The cell of each level, in the levels' shape."""
    if levels.dtype != np.uint8:
        return np.take(cell_of_level, levels)
    # NumPy would make indices of eight bytes of the levels first, which takes ten times as long.
    table = np.full(256, UNKNOWN, dtype=np.int8)
    table[: len(cell_of_level)] = cell_of_level
    return np.frombuffer(bytearray(levels.tobytes()).translate(table.tobytes()), np.int8).reshape(
        levels.shape
    )


def _pixel_of_cell(mode: MapMode) -> NDArray[np.uint8]:
    """The pixel of each cell value, unknown at index -1: shape (102,), or (102, 4) (RGBA) for scale."""
    cell = np.arange(102)  # 101, the last, stands for unknown
    if mode == "scale":
        # Grey with alpha as RGBA, as map_saver does it: GraphicsMagick misreads the alpha of grey images.
        grey = np.where(cell <= OCCUPIED, np.rint((OCCUPIED - cell) * 255 / 100), 128)
        alpha = np.where(cell <= OCCUPIED, 255, 0)
        return np.stack([grey, grey, grey, alpha], axis=-1).astype(np.uint8)
    if mode == "raw":
        return np.where(cell <= OCCUPIED, cell, 255).astype(np.uint8)
    pixel = np.full(102, _TRINARY_UNKNOWN, dtype=np.uint8)
    pixel[: _FREE_UP_TO + 1] = _TRINARY_FREE
    pixel[_OCCUPIED_FROM : OCCUPIED + 1] = _TRINARY_OCCUPIED
    return pixel


def _encode(pixels: NDArray[np.uint8], image_format: ImageFormat) -> bytes:
    if image_format == "pgm":
        height, width = pixels.shape
        return b"P5\n%d %d\n255\n" % (width, height) + pixels.tobytes()
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format=image_format)
    return buffer.getvalue()


def _replace_file(path: Path, content: bytes) -> None:
    """Writes beside `path` and renames, so that `path` holds the old content or the new, never a part."""
    draft = path.with_name(f".{path.name}.{os.urandom(8).hex()}.tmp")
    try:
        try:
            # "x" and not tempfile: the file gets the permissions of any new file, not the owner's alone.
            with draft.open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.replace(draft, path)
        except BaseException:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)
            raise
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise MapFileError(
            one_line(
                f"{path}: cannot be written: {reason}; check that the folder exists and can be written to"
            )
        ) from error
