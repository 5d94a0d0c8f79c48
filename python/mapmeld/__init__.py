"""Mapmeld merges the occupancy grids of many robots.

    maps = [mapmeld.read_map(path) for path in paths]
    result = mapmeld.merge(maps, particles=100, seed=1)

Names are imported when they are first used, so that `import mapmeld` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mapmeld._core import __version__
    from mapmeld.config import default_config, load_config
    from mapmeld.errors import ConfigError, MapFileError, MapmeldError
    from mapmeld.estimate import Estimate, EstimatedComponent, Prior, RobotEstimate, RunnerUp
    from mapmeld.estimator import Estimator
    from mapmeld.fusing import fuse
    from mapmeld.grid import OccupancyGrid
    from mapmeld.holding import Hold
    from mapmeld.known import Known, SamePoints
    from mapmeld.map_features import MapFeatures, features
    from mapmeld.map_io import read_map, write_map
    from mapmeld.merging import merge
    from mapmeld.output import write_output
    from mapmeld.result import MergeResult, PlacedMap

__all__ = [
    "ConfigError",
    "Estimate",
    "EstimatedComponent",
    "Estimator",
    "Hold",
    "Known",
    "MapFeatures",
    "MapFileError",
    "MapmeldError",
    "MergeResult",
    "OccupancyGrid",
    "PlacedMap",
    "Prior",
    "RobotEstimate",
    "RunnerUp",
    "SamePoints",
    "__version__",
    "default_config",
    "features",
    "fuse",
    "load_config",
    "merge",
    "read_map",
    "write_map",
    "write_output",
]

# No module may be called like a name here: importing the module would put it in that one's place.
_HOME = {
    "ConfigError": "errors",
    "Estimate": "estimate",
    "EstimatedComponent": "estimate",
    "Estimator": "estimator",
    "Hold": "holding",
    "Known": "known",
    "SamePoints": "known",
    "MapFeatures": "map_features",
    "MapFileError": "errors",
    "MapmeldError": "errors",
    "MergeResult": "result",
    "OccupancyGrid": "grid",
    "PlacedMap": "result",
    "Prior": "estimate",
    "RobotEstimate": "estimate",
    "RunnerUp": "estimate",
    "__version__": "_core",
    "default_config": "config",
    "features": "map_features",
    "fuse": "fusing",
    "load_config": "config",
    "merge": "merging",
    "read_map": "map_io",
    "write_map": "map_io",
    "write_output": "output",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mapmeld' has no attribute {name!r}")
    value = getattr(import_module(f"mapmeld.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
