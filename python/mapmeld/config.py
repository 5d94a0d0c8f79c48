"""The options of a merge: nested by stage, partial anywhere, each default written in the Rust core alone."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mapmeld import _core
from mapmeld.errors import ConfigError
from mapmeld.map_yaml import one_line
from mapmeld.yaml_loader import Loader

# A configuration takes some kilobytes; what is far larger is another file.
_MAX_BYTES = 1 << 20


def default_config() -> dict[str, Any]:
    """All options with their defaults: {"seed": ..., "threads": ..., stage: {option: value}}.

    Lengths are in metres, angles in radians. None stands for "derived from the resolution of the maps", and
    in `threads` for all cores.
    """
    options: dict[str, Any] = json.loads(_core.default_config())
    return options


def least_probability(config: Mapping[str, Any], maps: int) -> float:
    """Least probability of a merge among so many maps: evidence.min_probability, and more from 33 maps on.

    config: all options, as effective_config gives them.
    """
    return _core.least_probability(config["evidence"]["min_probability"], maps)


def effective_config(config: Mapping[str, Any], source: str = "config") -> dict[str, Any]:
    """All options: those of `config`, and the defaults for the rest.

    source: what messages call the place that the options come from. Raises ConfigError, naming it and the
    key, for a key that does not exist and a value of a wrong type or out of range.
    """
    try:
        plain = _plain(config, "", source)
        options: dict[str, Any] = json.loads(_core.effective_config(json.dumps(plain)))
    except RecursionError:
        raise ConfigError(f"{source}: is nested too deeply; write stages and their options") from None
    except ConfigError as error:
        raise ConfigError(one_line(f"{source}: {_without_prefix(str(error), source)}")) from None
    return options


def load_config(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The options in a YAML (or JSON) file, as they are there: the defaults are not filled in.

    An empty file is no options. Raises ConfigError, naming the file and the key, for a file that cannot be
    read, is no mapping, gives a key twice, or holds what effective_config does not take.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            raw = stream.read(_MAX_BYTES + 1)
        if len(raw) > _MAX_BYTES:
            raise ConfigError(f"{file}: is larger than {_MAX_BYTES} bytes, which no configuration is")
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        raise ConfigError(f"{file}: is not UTF-8 text; pass a YAML file of options") from None
    except (OSError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError(one_line(f"{file}: cannot be read: {reason}")) from error
    options = _parse(text, str(file))
    if options is None:
        return {}
    if not isinstance(options, dict):
        raise ConfigError(
            f"{file}: must be a mapping of stages to options, such as 'filter: {{particles: 50}}'"
        )
    effective_config(options, str(file))
    return options


def parse_setting(text: str) -> dict[str, Any]:
    """The options that "stage.option=value" sets; the value is read as YAML (null, true, 0.1, max, ...).

    Raises ConfigError, naming the key, as effective_config does.
    """
    key, equals, value = text.partition("=")
    path = [part.strip() for part in key.split(".")]
    if not equals or not all(path):
        raise ConfigError(f"{text!r} is no option; write stage.option=value, such as filter.particles=50")
    options: dict[str, Any] = {path[-1]: _parse(value, f"the value of {key.strip()}")}
    for part in reversed(path[:-1]):
        options = {part: options}
    return options


def overlay(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the options of `over` in the place of its own, stage by stage. Neither is changed."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        both = isinstance(below, Mapping) and isinstance(value, Mapping)
        merged[key] = overlay(below, value) if both else value  # type: ignore[arg-type]
    return merged


def _without_prefix(message: str, source: str) -> str:
    return message.removeprefix(f"{source}: ").removeprefix("config: ")


def _parse(text: str, source: str) -> Any:
    try:
        loader = Loader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        _refuse_double_keys(node, "", source)
        return loader.construct_document(node)
    # Constructors of numbers and dates raise ValueError or OverflowError, deep nesting RecursionError.
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, ConfigError):
            raise
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error) or type(error).__name__
        where = f"line {mark.line + 1}: " if mark else ""
        raise ConfigError(one_line(f"{source}: is not valid YAML: {where}{problem}")) from error


def _refuse_double_keys(node: yaml.Node, path: str, source: str) -> None:
    if not isinstance(node, yaml.MappingNode):
        return
    seen = set()
    for key, value in node.value:
        at = f"{path}{key.value}"
        if at in seen:
            raise ConfigError(one_line(f"{source}: {at}: given twice; keep one"))
        seen.add(at)
        _refuse_double_keys(value, f"{at}.", source)


def _plain(value: Any, path: str, source: str) -> Any:
    """`value` as JSON has it, numpy's numbers as Python's; what JSON cannot say is an error with its key."""
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ConfigError(one_line(f"{source}: {path}{key!r}: keys must be names"))
        return {key: _plain(v, f"{path}{key}.", source) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v, path, source) for v in value]
    if hasattr(value, "item") and getattr(value, "ndim", None) == 0:
        value = value.item()
    is_number = isinstance(value, int | float)
    if not (value is None or is_number or isinstance(value, str)):
        problem = f"{value!r} is neither a number nor a name"
    elif is_number and (abs(value) >= 1 << 64 or not math.isfinite(value)):
        problem = f"{value} is not finite or too large"
    else:
        return value
    raise ConfigError(one_line(f"{source}: {path.rstrip('.') or '(whole)'}: {problem}"))
