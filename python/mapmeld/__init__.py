"""Mapmeld merges the occupancy grids of many robots."""

from mapmeld.errors import ConfigError, MapFileError, MapmeldError
from mapmeld.grid import OccupancyGrid

__all__ = ["ConfigError", "MapFileError", "MapmeldError", "OccupancyGrid"]
