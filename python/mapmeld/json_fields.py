"""Reads JSON objects and their fields; every complaint is one line that names the file and the field.

`where` in this file is how a message names the place: the file and the path to the object inside it, such
as "out/result.json: maps[3]".
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapmeld.errors import MapmeldError


def read_object(path: str | Path) -> dict[str, Any]:
    """The JSON object in a file.

    Raises MapmeldError when the file cannot be read, is not JSON in UTF-8, or holds something else than an
    object.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except IsADirectoryError as error:
        raise MapmeldError(f"{path}: is a folder; give the JSON file in it") from error
    except OSError as error:
        raise MapmeldError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise MapmeldError(f"{path}: is not a JSON file: not UTF-8 at byte {error.start}") from error
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise MapmeldError(
            f"{path}: is not a JSON file: {error.msg} (line {error.lineno}, column {error.colno})"
        ) from error
    except RecursionError as error:
        raise MapmeldError(f"{path}: is not a usable JSON file: nested too deeply") from error
    if not isinstance(value, dict):
        raise MapmeldError(f"{path}: must hold a JSON object, got {_kind(value)}")
    return value


def required(item: Mapping[str, Any], key: str, where: str) -> Any:
    """item[key]; raises MapmeldError when the key is missing (null counts as there)."""
    if key not in item:
        raise MapmeldError(f"{where}: key '{key}' is missing")
    return item[key]


def objects(item: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    """The list of objects item[key]; raises MapmeldError for anything else."""
    value = required(item, key, where)
    if not isinstance(value, list | tuple):
        raise MapmeldError(f"{where}: '{key}' must be a list, got {_kind(value)}")
    for i, entry in enumerate(value):
        if not isinstance(entry, Mapping):
            raise MapmeldError(f"{where}: {key}[{i}] must be an object, got {_kind(entry)}")
    return list(value)


def string(item: Mapping[str, Any], key: str, where: str) -> str:
    """The string item[key]; raises MapmeldError for anything else."""
    value = required(item, key, where)
    if not isinstance(value, str):
        raise MapmeldError(f"{where}: '{key}' must be a string, got {_kind(value)}")
    return value


def optional_number(item: Mapping[str, Any], key: str, where: str) -> float | None:
    """item[key] as a finite number >= 0, None when it is missing or null; MapmeldError for anything else."""
    value = item.get(key)
    if value is None:
        return None
    if not _is_finite(value) or value < 0:
        raise MapmeldError(f"{where}: '{key}' must be a number >= 0, got {_kind(value)}")
    return float(value)


def optional_pose(item: Mapping[str, Any], key: str, where: str) -> tuple[float, float, float] | None:
    """item[key] as (x, y, theta), None when it is missing or null; MapmeldError for anything else."""
    value = item.get(key)
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(_is_finite(v) for v in value):
        raise MapmeldError(f"{where}: '{key}' must be [x, y, theta] of three finite numbers, or null")
    x, y, theta = (float(v) for v in value)
    return x, y, theta


def _is_finite(value: Any) -> bool:
    # bool is an int to Python, and never a number to us. An int too large for a float is no number of metres.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _kind(value: Any) -> str:
    """What a message calls a value: short, in JSON's words."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:g}" if _is_finite(value) else "a number that is not finite"
    if isinstance(value, str):
        return "a string"
    return "a list" if isinstance(value, list | tuple) else "an object"
