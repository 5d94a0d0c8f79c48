"""Names and defaults of parameters, and that each is declared with its range."""

from __future__ import annotations

import dataclasses

import pytest

from mapmeld import MapmeldError
from mapmeld.config import default_config
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


@pytest.mark.parametrize(
    ("confidence", "probability"), [(0.0, 0.0), (2.0, 0.9775), (3.0, 0.9966), (0.5, 0.6127)]
)
def test_the_doubt_is_taken_to_the_power_of_the_confidence(confidence: float, probability: float) -> None:
    options = merge_options(Parameters(estimation_confidence=confidence))
    assert options["evidence"]["min_probability"] == pytest.approx(probability, abs=1e-4)


@pytest.mark.parametrize(("confidence", "join"), [(0.0, 0.0), (0.5, 0.9), (1.0, 0.99), (2.0, 0.9999)])
def test_confidence_counts_while_maps_grow_too(confidence: float, join: float) -> None:
    assert hold(Parameters(estimation_confidence=confidence)).join == pytest.approx(join, abs=1e-4)


def test_the_default_confidence_is_the_merge_s_own_probability() -> None:
    assert merge_options(Parameters()) == {}
    assert default_config()["evidence"]["min_probability"] == pytest.approx(0.85)


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
