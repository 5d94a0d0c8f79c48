"""Options: where they come from, and what is said about wrong ones."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mapmeld import ConfigError, _core, default_config, load_config
from mapmeld.config import effective_config, least_probability, overlay, parse_setting
from rooms import assert_refused, hall, run_cli, save

# For the options whose value is neither a number nor None: another value than the default.
OTHER = {
    "perception.model": "psi_gamma",
    "perception.classes": "all",
    "fuse.rule": "max",
    "perception.more_bent": [
        {"climb_sigma": 0.2, "wall_sigma": 0.1, "bend_shift": 0.3, "bend_turn": 0.05},
    ],
    "evidence.weights": [0.5] * 19,
}


def leaves(options: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in options.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


LEAVES = list(leaves(json.loads(_core.default_config())))


def other_value(path: tuple[str, ...], default: Any) -> Any:
    """A valid value that differs from the default."""
    dotted = ".".join(path)
    if dotted in OTHER:
        return OTHER[dotted]
    if isinstance(default, bool):
        return not default
    if isinstance(default, int):
        return default + 1
    if isinstance(default, float):
        return round(default * 0.875, 3)
    assert default is None, f"add an example of another value for {dotted} to OTHER"
    return 2 if dotted in {"threads", "registration.partners"} else 0.25


def nested(path: tuple[str, ...], value: Any) -> dict[str, Any]:
    for key in reversed(path):
        value = {key: value}
    return value


@pytest.mark.parametrize(("path", "default"), LEAVES, ids=[".".join(p) for p, _ in LEAVES])
def test_every_option_is_reachable_from_file_and_set(
    path: tuple[str, ...], default: Any, tmp_path: Path
) -> None:
    value = other_value(path, default)
    assert value != default
    file = tmp_path / "options.yaml"
    file.write_text(yaml.safe_dump(nested(path, value)))
    expected = overlay(default_config(), nested(path, value))
    assert effective_config(load_config(file)) == expected
    assert effective_config(parse_setting(f"{'.'.join(path)}={json.dumps(value)}")) == expected


def test_defaults_are_those_of_the_core() -> None:
    assert default_config() == json.loads(_core.default_config()) == effective_config({})
    changed = default_config()
    changed["filter"]["particles"] = 1
    assert default_config() != changed


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("filter: {particels: 3}", ["filter.particels", "no such option", "particles"]),
        ("filtr: {particles: 3}", ["filtr", "no such option"]),
        ("filter: 3", ["filter", "stage"]),
        ("filter: {particles: many}", ["filter.particles", "many"]),
        ("filter: {particles: -3}", ["filter.particles", "-3"]),
        ("filter:\n  particles: 3\n  particles: 4", ["filter.particles", "twice"]),
        ("fuse: {resolution: .nan}", ["fuse.resolution", "finite"]),
        ("fuse: {resolution: -.inf}", ["fuse.resolution", "finite"]),
        ("fuse: {resolution: 2020-01-01}", ["fuse.resolution", "neither"]),
        ("seed: 123456789012345678901234567890", ["seed", "too large"]),
        ("seed: 18446744073709551615", ["seed", "2^53"]),
        ("[1, 2]", ["mapping"]),
        ("seed", ["mapping"]),
        ("filter: {particles: 3", ["valid YAML", "line"]),
        ("1: 2", ["1", "names"]),
        ("seed: [1, 2]", ["seed"]),
        ("[" * 50_000, ["valid YAML"]),
        ("a: &a [*a]", ["deeply"]),
    ],
)
def test_bad_files_name_file_and_key(text: str, words: list[str], tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_config(file)
    message = str(raised.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path / "none.yaml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_config(tmp_path / "binary")


def test_an_empty_file_is_no_options(tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text("# nothing yet\n")
    assert load_config(file) == {}


def test_yaml_writes_numbers_in_many_ways(tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text("structure: {line_tolerance: 5e-2}\nrefine: {kernel: null}\nfuse: {resolution: 1}\n")
    options = effective_config(load_config(file))
    assert options["structure"]["line_tolerance"] == 0.05
    assert options["fuse"]["resolution"] == 1.0


def test_numbers_of_numpy_are_numbers() -> None:
    options = effective_config({"seed": np.int64(4), "fuse": {"resolution": np.float32(0.5)}})
    assert (options["seed"], options["fuse"]["resolution"]) == (4, 0.5)


@pytest.mark.parametrize("text", ["filter.particles", "=3", "filter.=3", ".particles=3", ""])
def test_settings_need_a_key_and_a_value(text: str) -> None:
    with pytest.raises(ConfigError, match=r"stage\.option=value"):
        parse_setting(text)


def test_overlay_leaves_its_inputs_alone() -> None:
    base, over = {"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 5}, "e": 6}
    before = copy.deepcopy((base, over))
    assert overlay(base, over) == {"a": {"b": 5, "c": 2}, "d": 3, "e": 6}
    assert (base, over) == before


def test_stronger_places_win_on_the_command_line(tmp_path: Path) -> None:
    (map_path,) = save(tmp_path, [hall()])
    file = tmp_path / "options.yaml"
    file.write_text("seed: 11\nfilter: {particles: 12, resample_below: 0.25}\nrefine: {max_iterations: 9}\n")
    code, out, err = run_cli(
        "merge", map_path, "-q", "--json", "-", "--config", file, "--set", "filter.particles=13",
        "--set", "fuse.rule=max", "--set", "seed=14", "--seed", 15, "--resolution", 0.2,
    )  # fmt: skip
    assert (code, err) == (0, "")
    options = json.loads(out)["config"]
    assert options["seed"] == 15
    assert options["filter"]["particles"] == 13
    assert options["filter"]["resample_below"] == 0.25
    assert options["refine"]["max_iterations"] == 9
    assert options["fuse"] == {"rule": "max", "resolution": 0.2}


def test_the_command_line_names_the_place(tmp_path: Path) -> None:
    (map_path,) = save(tmp_path, [hall()])
    file = tmp_path / "options.yaml"
    file.write_text("filter: {particels: 3}\n")
    to = ("merge", map_path, "-o", tmp_path / "out")
    assert_refused(run_cli(*to, "--config", file), str(file), "filter.particels", "no such option")
    assert_refused(run_cli(*to, "--config", tmp_path / "no.yaml"), "no.yaml", "cannot be read")
    assert_refused(run_cli(*to, "--set", "filter.particels=3"), "--set filter.particels=3", "no such option")
    assert_refused(run_cli(*to, "--set", "filter"), "'filter'", "stage.option=value")
    assert_refused(run_cli(*to, "--particles", 0), "--particles", "between 1")
    assert_refused(run_cli(*to, "--threads", 0), "--threads", "between 1")
    assert_refused(run_cli(*to, "--seed", -1), "--seed")
    assert_refused(run_cli(*to, "--resolution", 0), "--resolution", "positive")
    assert_refused(run_cli(*to, "--resolution", "nan"), "--resolution", "finite")
    assert not (tmp_path / "out").exists()


def test_many_maps_are_asked_for_more() -> None:
    config = effective_config({"evidence": {"min_probability": 0.7}})
    assert [least_probability(config, n) for n in (2, 32)] == pytest.approx([0.7, 0.7])
    assert least_probability(config, 96) == pytest.approx(0.9)
