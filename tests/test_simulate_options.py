"""The options of a simulated case: what is refused, and how."""

from __future__ import annotations

import math

import pytest

from mapmeld.errors import ConfigError
from mapmeld.simulate import WORLDS, SimulateOptions
from mapmeld.simulate.world import build_world


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("world", "castle"),
        ("world", None),
        ("seed", -1),
        ("seed", 1.5),
        ("robots", 0),
        ("robots", True),
        ("path_length", 0.0),
        ("path_length", math.nan),
        ("region_radius", -1.0),
        ("size", (12.0, -1.0)),
        ("size", (12.0, 3.0, 4.0)),
        ("size", 12.0),
        ("density", 1.2),
        ("wall_thickness", 0.0),
        ("wall_thickness", 0.7),
        ("resolution", 0.0),
        ("resolution", ()),
        ("resolution", (0.05, -0.1)),
        ("beams", 1),
        ("field_of_view", 7.0),
        ("max_range", "far"),
        ("range_noise", -0.1),
        ("dropout", 1.0),
        ("drift", -1.0),
        ("scan_spacing", 0.0),
        ("scan_turn", 0.0),
        ("robot_radius", math.inf),
        ("origin_yaw", 1),
        ("margin", -0.1),
    ],
)
def test_a_bad_option_is_named(field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"^{field}: "):
        SimulateOptions(**{field: value})


def test_sizes_that_do_not_fit_the_world_are_named() -> None:
    for world in WORLDS:
        with pytest.raises(ConfigError, match=r"^size: "):
            build_world(SimulateOptions(world=world, size=(1.5, 1.5)))
    with pytest.raises(ConfigError, match=r"^size: "):
        SimulateOptions(world="map.yaml", size=(10.0, 10.0))
    with pytest.raises(ConfigError, match=r"^speed: "):
        SimulateOptions.from_dict({"speed": 1})
