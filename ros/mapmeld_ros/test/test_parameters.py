"""Names and defaults of parameters, and that each is declared with its range."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from mapmeld import MapmeldError
from mapmeld.config import default_config
from mapmeld.holding import Hold
from mapmeld_ros.parameters import Parameters, descriptor, problem
from mapmeld_ros.session import hold, merge_options

# multirobot_map_merge, ROS 2 branch.
UPSTREAM = {
    "merging_rate": 4.0,
    "discovery_rate": 0.05,
    "estimation_rate": 0.5,
    "known_init_poses": True,
    "estimation_confidence": 1.0,
    "robot_map_topic": "map",
    "robot_map_updates_topic": "map_updates",
    "robot_namespace": "",
    "merged_map_topic": "map",
    "world_frame": "world",
}


def test_the_parameters_of_multirobot_map_merge_keep_their_names_and_defaults() -> None:
    values = dataclasses.asdict(Parameters())
    assert list(values)[: len(UPSTREAM)] == list(UPSTREAM)
    assert {name: values[name] for name in UPSTREAM} == UPSTREAM


@pytest.mark.parametrize("parameter", dataclasses.fields(Parameters), ids=lambda f: f.name)
def test_every_parameter_is_described(parameter: dataclasses.Field) -> None:
    said = descriptor(parameter.name)
    assert said.description.endswith(".")
    is_number = isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool)
    assert bool(said.floating_point_range or said.integer_range) == is_number
    for span in (*said.floating_point_range, *said.integer_range):
        assert span.from_value <= parameter.default <= span.to_value
    assert problem(parameter.name, parameter.default) == ""


@pytest.mark.parametrize(
    ("name", "value"),
    [("publish_tf", "sometimes"), ("tf_namespaces", ""), ("world_frame", " "), ("robot_map_topic", "/")],
)
def test_values_that_make_no_sense_are_named(name: str, value: str) -> None:
    assert problem(name, value).startswith(f"{name}: ")


USUAL = default_config()["evidence"]["min_probability"]


@pytest.mark.parametrize(
    ("confidence", "doubt"),
    [(0.0, 1.0), (0.5, (1 - USUAL) ** 0.5), (2.0, (1 - USUAL) ** 2), (3.0, (1 - USUAL) ** 3)],
)
def test_confidence_is_the_power_of_the_doubt(confidence: float, doubt: float) -> None:
    options = merge_options(Parameters(estimation_confidence=confidence))
    assert options["evidence"]["min_probability"] == pytest.approx(1.0 - doubt, abs=1e-12)


@pytest.mark.parametrize("confidence", [0.0, 0.5, 1.0, 2.0])
def test_confidence_counts_while_maps_grow_too(confidence: float) -> None:
    join = 1.0 - (1.0 - Hold().join) ** confidence
    assert hold(Parameters(estimation_confidence=confidence)).join == pytest.approx(join, abs=1e-12)


def test_the_numbers_that_are_written_are_those_in_effect() -> None:
    """In the documentation and in what `ros2 param describe` shows."""

    def asked(confidence: float) -> list[str]:
        p = Parameters(estimation_confidence=confidence)
        merge = merge_options(p)["evidence"]["min_probability"] if confidence != 1.0 else USUAL
        return [f"{hold(p).join:.4g}", f"{merge:.2g}"]

    said = descriptor("estimation_confidence").description
    assert re.findall(r"0\.\d+", said) == asked(1.0)
    config = (Path(__file__).parents[1] / "config" / "map_merge.yaml").read_text()
    (comment,) = re.findall(r"# How sure a link must be.*?estimation_confidence", config, re.DOTALL)
    assert re.findall(r"0\.\d+", comment) == asked(1.0)
    docs = (Path(__file__).parents[3] / "docs" / "ros2.md").read_text()
    (text,) = re.findall(r"^`estimation_confidence` was .*?\n\n", docs, re.DOTALL | re.MULTILINE)
    doubts = [f"{1 - Hold().join:.2g}", f"{1 - USUAL:.2g}"]
    numbers = re.findall(r"\d+\.\d+", text)
    assert numbers == ["1.0", *asked(1.0), *doubts, "2.0", *asked(2.0), "0.5", *asked(0.5)]
    assert f"need {asked(1.0)[1]} instead of {asked(1.0)[0]}" in docs.replace("\n", " ")


def test_the_greatest_confidence_can_still_be_met() -> None:
    sure = Parameters(
        estimation_confidence=descriptor("estimation_confidence").floating_point_range[0].to_value
    )
    assert hold(sure).join < 1.0
    assert merge_options(sure)["evidence"]["min_probability"] < 1.0


def test_the_default_confidence_is_the_merge_s_own_probability() -> None:
    assert merge_options(Parameters()) == {}


def test_a_config_file_comes_first_and_confidence_on_top(tmp_path) -> None:
    file = tmp_path / "merge.yaml"
    file.write_text("evidence: {min_probability: 0.9}\nseed: 5\n")
    assert merge_options(Parameters(config_file=str(file)))["evidence"]["min_probability"] == 0.9
    options = merge_options(Parameters(config_file=str(file), estimation_confidence=2.0))
    assert options["evidence"]["min_probability"] == pytest.approx(0.99)
    assert options["seed"] == 5


def test_a_config_file_that_is_not_there_is_an_error() -> None:
    with pytest.raises(MapmeldError, match=r"nowhere\.yaml"):
        merge_options(Parameters(config_file="nowhere.yaml"))
