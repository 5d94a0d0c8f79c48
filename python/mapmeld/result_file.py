"""Reads a result.json of an earlier merge, and the maps that it names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mapmeld import json_fields
from mapmeld.bag import Bag, is_bag
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_inputs import check_paths
from mapmeld.map_io import read_map
from mapmeld.map_names import name_among
from mapmeld.map_yaml import one_line

_PAIR_NUMBERS = (
    "log_likelihood",
    "hits",
    "conflicts",
    "second_direction",
    "shared_length",
    "decoy_log_likelihood",
)


def read_result(path: str | Path) -> dict[str, Any]:
    """The contents of a result.json, checked as far as a report needs them.

    Raises MapmeldError, naming file and field, for what no merge of this version has written.
    """
    found = json_fields.read_object(path)
    where = str(path)
    maps = json_fields.objects(found, "maps", where)
    components = json_fields.objects(found, "components", where)
    names = [json_fields.string(m, "name", f"{where}: maps[{i}]") for i, m in enumerate(maps)]
    _require(bool(names) and len(set(names)) == len(names), f"{where}: 'maps' must name maps, each once")
    _number(found, "probability", where)
    _number(found, "seed", where)
    json_fields.string(found, "version", where)
    for key in ("config", "seconds"):
        value = json_fields.required(found, key, where)
        _require(isinstance(value, dict), f"{where}: '{key}' must be an object")
    for stage in found["seconds"]:
        json_fields.optional_number(found["seconds"], stage, f"{where}: seconds")
    effective_config(found["config"], f"{where}: config")
    for i, m in enumerate(maps):
        _check_map(m, len(components), f"{where}: maps[{i}]")
    for k, c in enumerate(components):
        _check_component(c, maps, k, f"{where}: components[{k}]")
    for i, h in enumerate(json_fields.objects(found, "hypotheses", where)):
        at = f"{where}: hypotheses[{i}]"
        _number(h, "probability", at)
        for j, m in enumerate(json_fields.objects(h, "maps", at)):
            _name(m, "name", names, f"{at}: maps[{j}]")
            _number(m, "component", f"{at}: maps[{j}]")
            _pose(m, f"{at}: maps[{j}]")
    for i, p in enumerate(json_fields.objects(found, "pairs", where)):
        _check_pair(p, names, f"{where}: pairs[{i}]")
    return found


def read_maps(
    result: Mapping[str, Any], path: str | Path, given: Sequence[Path] = ()
) -> dict[str, OccupancyGrid]:
    """The maps of a result that was read from `path`, by name, in its order.

    given: saved maps that stand for those of their name, wherever the result says these are. Raises
    MapmeldError for a map that is not there any more, or that the result does not name a file of.
    """
    names = [m["name"] for m in result["maps"]]
    check_paths(given)
    by_name: dict[str, Path] = {}
    for file in given:
        name = name_among(file, names)
        if name is None or is_bag(file):
            alike = [n for n in names if n.rpartition("/")[2] == file.stem]
            hint = f"put it into a folder so that it is {' or '.join(alike)}" if alike else "leave it out"
            raise MapmeldError(one_line(f"{file}: {path} has no map called {file.stem!r}; {hint}"))
        if name in by_name:
            raise MapmeldError(
                one_line(f"{file}: is map {name!r} of {path}, as {by_name[name]} is; keep one")
            )
        by_name[name] = file
    return {
        name: read_map(by_name[name], name) if name in by_name else _read_named(m, Path(path))
        for name, m in zip(names, result["maps"], strict=True)
    }


def _read_named(placed: Mapping[str, Any], result: Path) -> OccupancyGrid:
    name, file = placed["name"], placed.get("file")
    hint = f"give it as well: mapmeld report {result} {name}.yaml"
    if file is None:
        raise MapmeldError(one_line(f"{result}: map {name} has no 'file', the place of its cells; {hint}"))
    where = f"{result}: map {name}: file"
    _require(isinstance(file, dict), f"{where} must be an object or null")
    path = result.parent / json_fields.string(file, "path", where)
    if not path.exists():
        raise MapmeldError(one_line(f"{path}: map {name} of {result} is not there any more; {hint}"))
    topic, moment = file.get("topic"), file.get("nanoseconds")
    if topic is None:
        return read_map(path, name)
    _require(is_bag(path), f"{path}: is no bag any more, as {where} says")
    _require(
        isinstance(topic, str) and isinstance(moment, int) and not isinstance(moment, bool),
        f"{where}: 'topic' must be a string and 'nanoseconds' a whole number",
    )
    with Bag(path) as bag:
        found = bag.last_map(topic, name, moment)
    if found is None:
        raise MapmeldError(one_line(f"{path}: has no map of {topic} any more, as {where} says; {hint}"))
    return found.grid


def _check_map(m: Mapping[str, Any], components: int, where: str) -> None:
    for key in ("status", "reason"):
        json_fields.string(m, key, where)
    _number(m, "probability", where)
    at = json_fields.required(m, "component", where)
    inside = isinstance(at, int) and not isinstance(at, bool) and 0 <= at < components
    _require(inside, f"{where}: 'component' must be an index into the components")
    json_fields.required(m, "T_component_map", where)
    if json_fields.optional_pose(m, "T_component_map", where) is not None:
        _covariance(m, where)


def _check_component(c: Mapping[str, Any], maps: Sequence[Mapping[str, Any]], k: int, where: str) -> None:
    order = json_fields.required(c, "order", where)
    members = [m["name"] for m in maps if m["component"] == k]
    is_theirs = isinstance(order, list) and all(isinstance(n, str) for n in order)
    _require(
        is_theirs and bool(order) and sorted(order) == sorted(members),
        f"{where}: 'order' must list the maps of this component, each once",
    )
    _name(c, "reference", members, where)
    for key in ("rms_m", "shared_cells", "conflict_cells"):
        json_fields.optional_number(c, key, where)
        json_fields.required(c, key, where)
    if json_fields.required(c, "merged", where) is not None:
        json_fields.string(c, "merged", where)
        for m in maps:
            if m["component"] == k:
                _pose(m, f"{where}: map {m['name']}")
    for j, s in enumerate(json_fields.objects(c, "steps", where)):
        _number(s, "effective_sample_size", f"{where}: steps[{j}]")
        weights = json_fields.required(s, "weights", f"{where}: steps[{j}]")
        are_shares = isinstance(weights, list) and all(_is_number(w) and 0 <= w <= 1 for w in weights)
        _require(are_shares and bool(weights), f"{where}: steps[{j}]: 'weights' must be a list of 0..1")
        json_fields.required(s, "resampled", f"{where}: steps[{j}]")


def _check_pair(p: Mapping[str, Any], names: Sequence[str], where: str) -> None:
    _name(p, "a", names, where)
    _name(p, "b", names, where)
    json_fields.string(p, "status", where)
    for key in ("probability", "candidates", "modes"):
        _number(p, key, where)
    for key in _PAIR_NUMBERS:
        value = json_fields.required(p, key, where)
        _require(value is None or _is_number(value), f"{where}: '{key}' must be a number or null")
    second = json_fields.required(p, "runner_up", where)
    if second is not None:
        _require(isinstance(second, dict), f"{where}: 'runner_up' must be an object or null")
        _pose(second, f"{where}: runner_up", "T_a_b")
        value = json_fields.required(second, "log_likelihood", f"{where}: runner_up")
        _require(value is None or _is_number(value), f"{where}: runner_up: 'log_likelihood' must be a number")
    json_fields.required(p, "T_a_b", where)
    if json_fields.optional_pose(p, "T_a_b", where) is not None:
        _covariance(p, where)
        _number(p, "shared_length", where)


def _covariance(item: Mapping[str, Any], where: str) -> None:
    rows = json_fields.required(item, "covariance", where)
    are_rows = isinstance(rows, list) and len(rows) == 3 and all(isinstance(r, list) for r in rows)
    fine = are_rows and all(len(r) == 3 and all(_is_number(v) for v in r) for r in rows)
    _require(fine, f"{where}: 'covariance' must be 3 x 3 numbers")


def _pose(item: Mapping[str, Any], where: str, key: str = "T_component_map") -> None:
    if json_fields.optional_pose(item, key, where) is None:
        raise MapmeldError(f"{where}: '{key}' must be [x, y, theta]")


def _name(item: Mapping[str, Any], key: str, names: Sequence[str], where: str) -> None:
    if json_fields.string(item, key, where) not in names:
        raise MapmeldError(one_line(f"{where}: '{key}' must be one of the maps, got {item[key]!r}"))


def _number(item: Mapping[str, Any], key: str, where: str) -> None:
    _require(_is_number(json_fields.required(item, key, where)), f"{where}: '{key}' must be a number")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise MapmeldError(one_line(f"{problem}; is it of another version? Merge anew"))
