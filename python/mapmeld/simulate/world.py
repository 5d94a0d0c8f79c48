"""The world of a case, as a grid in the world frame: generated from the seed, or read from a map file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mapmeld.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from mapmeld.simulate import buildings, corridors, homes, open_floors
from mapmeld.simulate.floorplan import Floorplan
from mapmeld.simulate.maze import maze
from mapmeld.simulate.options import WORLDS, SimulateOptions
from mapmeld.simulate.streams import Purpose, stream

_MAZE_CELL, _BUILDING_CELL = 0.01, 0.02
_FLOOR_CELL = 0.04
"""Of a floor, which may be hundreds of metres wide."""
_MAZE_WALL, _BUILDING_WALL = 0.06, 0.12
_OCCUPIED_FROM, _FREE_TO = 65, 25
"""Occupancy in percent that counts as a wall, and as free, in a map that has shades."""


def build_world(options: SimulateOptions) -> OccupancyGrid:
    """The world that the robots drive and scan: walls occupied, drivable ground free, the rest unknown.

    The world frame of a map file is its map frame. Raises MapFileError for a file that cannot be read and
    ConfigError for a size that is too small for the world.
    """
    if options.world not in WORLDS:
        from mapmeld.map_io import read_map

        return _definite(read_map(options.world))
    rng = stream(options.seed, Purpose.WORLD)
    if options.world == "maze":
        plan = maze(rng, options.size, options.density, options.wall_thickness or _MAZE_WALL)
        return plan.rasterise(_MAZE_CELL, options.world)
    build: dict[str, Callable[..., Floorplan]] = {
        "office": buildings.office,
        "floor": buildings.floor,
        "cells": buildings.cells,
        "halls": buildings.halls,
        "wings": buildings.wings,
        "symmetric": buildings.symmetric,
        "concourse": open_floors.concourse,
        "warehouse": open_floors.warehouse,
        "home": homes.home,
        "corridors": corridors.corridors,
    }
    plan = build[options.world](rng, options.size, options.wall_thickness or _BUILDING_WALL)
    cell = _FLOOR_CELL if options.world == "floor" else _BUILDING_CELL
    return plan.rasterise(cell, options.world)


def _definite(grid: OccupancyGrid) -> OccupancyGrid:
    """The map with every cell a wall, free or unknown."""
    data = np.full(grid.data.shape, UNKNOWN, dtype=np.int8)
    data[(grid.data >= 0) & (grid.data <= _FREE_TO)] = FREE
    data[grid.data >= _OCCUPIED_FROM] = OCCUPIED
    return OccupancyGrid(data, grid.resolution, grid.origin, grid.name)
