"""The yaml half of a saved map: what its pixels mean and where they lie."""

from __future__ import annotations

import contextlib
import math
import re
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import yaml

from mapmeld.errors import MapFileError
from mapmeld.yaml_loader import open_loader

MapMode = Literal["trinary", "scale", "raw"]
"""How pixels become cells; see read_map."""

MODES: tuple[MapMode, ...] = ("trinary", "scale", "raw")
YAML_SUFFIXES = (".yaml", ".yml")

_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
# A map's yaml takes a few hundred bytes. What is far larger is another file, and not worth parsing.
_MAX_YAML_BYTES = 1 << 16
_IMAGE_SUFFIXES = (".pgm", ".png", ".bmp")
_NAMES_IMAGE = re.compile(rb"""^[^\w\n]*image["']?\s*:""", re.MULTILINE)


@dataclass(frozen=True)
class MapYaml:
    """The fields of a map_server yaml, checked.

    image: path of the image; a relative one has been taken from the yaml's folder.
    resolution: side of a cell in metres, positive.
    origin: (x, y, yaw) in metres and radians: pose of the lower left corner of the lower left pixel in the
        map frame.
    negate: False if dark means occupied, True if bright does.
    occupied_thresh, free_thresh: occupancy, 0 to 1, from which a cell is occupied and up to which it is free;
        free_thresh < occupied_thresh.
    mode: "trinary" where the yaml names none.
    """

    image: Path
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: MapMode


def read_map_yaml(path: Path) -> MapYaml:
    """Reads and checks a map's yaml; the image it names is not touched.

    All fields but `mode` are required, as nav2_map_server requires them; keys it does not know are ignored.
    Raises MapFileError, naming the file and the field.
    """
    fields = _load_mapping(path)
    missing = [key for key in _REQUIRED if key not in fields]
    if missing:
        _fail(path, f"{', '.join(missing)}: missing; add {'it' if len(missing) == 1 else 'them'} to the yaml")

    image = fields["image"]
    if not isinstance(image, str) or not image.strip():
        _fail(path, f"image: must be the name of the image file, got {reprlib.repr(image)}")
    resolution = _number(path, "resolution", fields["resolution"])
    if resolution <= 0:
        _fail(path, f"resolution: must be a positive number of metres per pixel, got {resolution:g}")
    occupied_thresh, free_thresh = (
        _threshold(path, key, fields[key]) for key in ("occupied_thresh", "free_thresh")
    )
    if free_thresh >= occupied_thresh:
        _fail(path, f"free_thresh: must be below occupied_thresh, got {free_thresh:g} >= {occupied_thresh:g}")
    return MapYaml(
        image=path.parent / image,
        resolution=resolution,
        origin=_origin(path, fields["origin"]),
        negate=_negate(path, fields["negate"]),
        occupied_thresh=occupied_thresh,
        free_thresh=free_thresh,
        mode=_mode(path, fields.get("mode", "trinary")),
    )


def is_saved_map(path: Path) -> bool:
    """Whether a yaml file is, or was meant to be, a saved map's: it names an image, or where a map lies, or
    has an image of its own name beside it. No other yaml of ROS does."""
    if any(path.with_suffix(suffix).exists() for suffix in _IMAGE_SUFFIXES):
        return True
    try:
        fields = _load_mapping(path)
    except MapFileError:
        # Broken, or out of reach: whoever reads it as a map says what is wrong. A pipe would never end.
        if path.is_file():
            with contextlib.suppress(OSError), path.open("rb") as file:
                return _NAMES_IMAGE.search(file.read(_MAX_YAML_BYTES)) is not None
        return True
    return "image" in fields or {"resolution", "origin"} <= fields.keys()


def one_line(text: object) -> str:
    """`text` with each run of white space, line breaks among it, made one space: fit for an error message."""
    return " ".join(str(text).split())


def _fail(path: Path, text: str) -> NoReturn:
    raise MapFileError(one_line(f"{path}: {text}"))


def _load_mapping(path: Path) -> dict[str, Any]:
    try:
        if path.is_dir():
            _fail(path, "is a folder; pass the map's yaml file")
        if not path.exists():
            _fail(path, "no such file; check the path of the map's yaml")
        # Opening a pipe would wait for a writer, a device may never end.
        if not path.is_file():
            _fail(path, "is not a regular file; pass the map's yaml file")
        with path.open("rb") as file:
            raw = file.read(_MAX_YAML_BYTES + 1)
    except MapFileError:
        raise
    except (OSError, ValueError) as error:
        raise MapFileError(one_line(f"{path}: cannot be read: {_reason(error)}")) from error
    if len(raw) > _MAX_YAML_BYTES:
        _fail(path, f"is larger than {_MAX_YAML_BYTES} bytes, which no map yaml is; pass the map's yaml file")
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        _fail(path, "is not UTF-8 text; pass the map's yaml file, not its image")

    try:
        loader = open_loader(text)
        node = loader.get_single_node()
        if not isinstance(node, yaml.MappingNode):
            _fail(path, "is not a yaml mapping; it must hold lines such as 'resolution: 0.05'")
        # yaml-cpp, and so nav2, takes the first of two equal keys, PyYAML the last. Neither is right.
        keys = [str(key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for key in (*_REQUIRED, "mode"):
            if keys.count(key) > 1:
                _fail(path, f"{key}: given {keys.count(key)} times; keep one")
        fields: dict[str, Any] = loader.construct_document(node)
    except MapFileError:
        raise
    # Constructors of numbers and dates raise ValueError or OverflowError, deep nesting RecursionError.
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise MapFileError(one_line(f"{path}: is not valid yaml: {_problem(error)}; correct it")) from error
    return fields


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _problem(error: Exception) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {error.problem or error.context}"
    return str(error) or type(error).__name__


def _number(path: Path, field: str, value: object) -> float:
    # bool is an int to Python, and no number to whoever wrote the file.
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        _fail(path, f"{field}: must be a number, got {reprlib.repr(value)}{_unquoted(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        _fail(path, f"{field}: must be a finite number, got {number}")
    return number


def _unquoted(value: object) -> str:
    """What to do about a number that is quoted."""
    try:
        return "; remove the quotes" if isinstance(value, str) and math.isfinite(float(value)) else ""
    except ValueError:
        return ""


def _threshold(path: Path, field: str, value: object) -> float:
    number = _number(path, field, value)
    if not 0.0 <= number <= 1.0:
        _fail(path, f"{field}: must lie in 0..1, got {number:g}")
    return number


def _origin(path: Path, value: object) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        _fail(path, f"origin: must be a list of three numbers [x, y, yaw], got {reprlib.repr(value)}")
    x, y, yaw = (
        _number(path, f"origin ({name})", v) for name, v in zip(("x", "y", "yaw"), value, strict=True)
    )
    return x, y, yaw


def _negate(path: Path, value: object) -> bool:
    # nav2 reads an int and, failing that, a bool. 2 or -1 is a mistake, not a way to say true.
    if not isinstance(value, int) or value not in (0, 1):
        _fail(path, f"negate: must be 0, 1, true or false, got {reprlib.repr(value)}")
    return bool(value)


def _mode(path: Path, value: object) -> MapMode:
    for mode in MODES:
        if isinstance(value, str) and value.lower() == mode:
            return mode
    _fail(path, f"mode: must be one of {', '.join(MODES)}, got {reprlib.repr(value)}")
