"""What to simulate: every number that shapes a case, each written once, with its default."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from mapmeld.errors import ConfigError

WORLDS = (
    "maze", "office", "floor", "cells", "halls", "wings", "symmetric", "concourse", "warehouse", "home",
    "corridors",
)  # fmt: skip
"""The worlds that are generated from the seed; any other world is the path of a map file."""

_POSITIVE = (
    "path_length",
    "region_radius",
    "wall_thickness",
    "field_of_view",
    "max_range",
    "scan_spacing",
    "scan_turn",
    "robot_radius",
)
_DERIVED = ("path_length", "region_radius", "wall_thickness")
_NOT_NEGATIVE = ("range_noise", "drift", "margin")


@dataclass(frozen=True)
class SimulateOptions:
    """The options of one simulated case. Metres and radians; same options, same bytes.

    world: one of WORLDS, or the path of a map yaml whose occupied cells are the walls; robots drive only
        in its known free cells.
    seed: seeds the world and every robot; 0 or more.
    robots: how many robots, so how many maps; 1 or more.
    path_length: how far each robot drives, in metres. None: nine times the region radius, which is 20 m for
        ten robots in the default maze.
    region_radius: how far from its start, measured along free paths, a robot chooses its goals, in metres.
        None: from the free area and the number of robots, such that the regions overlap in part.
    size: width and height of a generated world in metres, None for the world's own default. A maze is made
        of whole panels, so its size is rounded to the panel lattice.
    density: maze only: 0 is an empty arena, 1 has as many panels as leave the free space connected.
    wall_thickness: thickness of generated walls in metres, None for the world's own default (0.06 m for the
        panels of a maze, 0.12 m for the walls of buildings).
    resolution: cell side of the maps in metres; a tuple is dealt to the robots in turn.
    beams: beams of a scan, spread evenly over the field of view, its borders included.
    field_of_view: of the lidar, in radians, centred on the heading.
    max_range: of the lidar in metres; a beam without return clears its way up to there.
    range_noise: standard deviation of a measured range in metres.
    dropout: share of beams that are lost; a lost beam says nothing, 0 to below 1.
    drift: odometry drift the maps are drawn with; 0 is none, 1 is light (see mapmeld.simulate.drift).
    scan_spacing: a robot scans at least every so many metres.
    scan_turn: and at least every so many radians.
    robot_radius: distance the robot's centre keeps from walls, in metres.
    origin_yaw: whether the axes of each grid are turned in its map frame (a yaml origin with a yaw).
    margin: unknown border around the known area of a map, in metres.

    Raises ConfigError, naming the field, for a value that cannot be used.
    """

    world: str = "maze"
    seed: int = 0
    robots: int = 10
    path_length: float | None = None
    region_radius: float | None = None
    size: tuple[float, float] | None = None
    density: float = 0.65
    wall_thickness: float | None = None
    resolution: float | tuple[float, ...] = 0.05
    beams: int = 181
    field_of_view: float = math.pi
    max_range: float = 8.0
    range_noise: float = 0.02
    dropout: float = 0.01
    drift: float = 0.0
    scan_spacing: float = 0.15
    scan_turn: float = math.radians(10.0)
    robot_radius: float = 0.2
    origin_yaw: bool = False
    margin: float = 0.5

    def __post_init__(self) -> None:
        if not isinstance(self.world, str):
            raise ConfigError(f"world: must be a string, got {self.world!r}")
        if self.world not in WORLDS and not self.world.endswith((".yaml", ".yml")):
            raise ConfigError(
                f"world: {self.world!r} is neither one of {', '.join(WORLDS)} nor the path of a map yaml"
            )
        _whole("seed", self.seed, 0)
        _whole("robots", self.robots, 1)
        _whole("beams", self.beams, 2)
        for key in _POSITIVE:
            value = getattr(self, key)
            if key in _DERIVED and value is None:
                continue
            if _number(key, value) <= 0:
                raise ConfigError(f"{key}: must be positive, got {value}")
        for key in _NOT_NEGATIVE:
            if _number(key, getattr(self, key)) < 0:
                raise ConfigError(f"{key}: must not be negative, got {getattr(self, key)}")
        if self.field_of_view > 2 * math.pi + 1e-9:
            raise ConfigError(f"field_of_view: must be at most 2 pi radians, got {self.field_of_view}")
        if not 0 <= _number("density", self.density) <= 1:
            raise ConfigError(f"density: must lie in 0..1, got {self.density}")
        if not 0 <= _number("dropout", self.dropout) < 1:
            raise ConfigError(f"dropout: must lie in 0 to below 1, got {self.dropout}")
        if self.wall_thickness is not None and self.wall_thickness > 0.5:
            raise ConfigError(f"wall_thickness: must be at most 0.5 m, got {self.wall_thickness}")
        if not isinstance(self.origin_yaw, bool):
            raise ConfigError(f"origin_yaw: must be true or false, got {self.origin_yaw!r}")
        if not self.resolutions or any(_number("resolution", r) <= 0 for r in self.resolutions):
            raise ConfigError(f"resolution: must be positive, got {self.resolution}")
        if self.size is not None:
            if not isinstance(self.size, tuple) or len(self.size) != 2:
                raise ConfigError(f"size: must be a tuple of width and height, got {self.size!r}")
            if self.world not in WORLDS:
                raise ConfigError("size: a world from a map file has the size of the map; leave size out")
            if any(_number("size", s) <= 0 for s in self.size):
                raise ConfigError(f"size: must be positive, got {self.size}")

    @property
    def resolutions(self) -> tuple[float, ...]:
        """The cell sides in metres; robot k has the one at k modulo their number."""
        return self.resolution if isinstance(self.resolution, tuple) else (self.resolution,)

    def to_dict(self) -> dict[str, object]:
        """All options as JSON values, for the record; SimulateOptions.from_dict takes them back."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in dataclasses.asdict(self).items()
        }

    @classmethod
    def from_dict(cls, values: dict[str, object]) -> SimulateOptions:
        """The options that to_dict recorded. Raises ConfigError for a key that is none."""
        known = {field.name for field in dataclasses.fields(cls)}
        for key in values:
            if key not in known:
                raise ConfigError(f"{key}: no such option of simulate")
        tuples = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        return cls(**tuples)  # type: ignore[arg-type]


def _number(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"{key}: must be a finite number, got {value!r}")
    return float(value)


def _whole(key: str, value: object, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ConfigError(f"{key}: must be a whole number of at least {least}, got {value!r}")
