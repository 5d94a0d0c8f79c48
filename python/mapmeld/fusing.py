"""Placed maps into one, without a merge: for poses that are known."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from mapmeld import _core
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.estimate import checked_pose
from mapmeld.grid import OccupancyGrid


def fuse(
    placed: Sequence[tuple[OccupancyGrid, Sequence[float] | NDArray[Any]]],
    *,
    config: Mapping[str, Any] | None = None,
    name: str = "merged",
) -> OccupancyGrid:
    """One map of maps at known poses (map, T_frame_map), in metres and radians.

    The first map draws a wall that several show within a cell of each other. The fused map has yaw 0, the
    finest resolution (or the option fuse.resolution) and its origin on whole multiples of it. config: as in
    merge. Raises MapmeldError when there is no map or no known cell, and for a pose that is not three finite
    numbers.
    """
    if not placed:
        raise MapmeldError("fuse: there are no maps; give at least one")
    options = effective_config(config or {})
    found = _core.fuse(
        name,
        [
            (grid.name, grid.data, grid.resolution, grid.origin, checked_pose(T, "fuse: T_frame_map"))
            for grid, T in placed
        ],
        json.dumps(options),
    )
    return OccupancyGrid(found["data"], found["resolution"], found["origin"], name)
