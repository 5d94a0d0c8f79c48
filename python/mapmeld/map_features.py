"""What the merge sees in one map: classes of cells, oriented walls, lines and corners."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core
from mapmeld.config import effective_config
from mapmeld.grid import OccupancyGrid

Points = NDArray[np.float64]
"""Shape (n, 2): map coordinates in metres, or unit vectors of the map frame."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """Oriented wall points: position in metres and unit normal into free space."""

    position: Points
    normal: Points


@dataclass(frozen=True, eq=False)
class Lines:
    """Walls fitted to the boundary: ends in metres, unit normal into free space. Longest first."""

    start: Points
    end: Points
    normal: Points


@dataclass(frozen=True, eq=False)
class Corners:
    """Where two lines meet, most visible first.

    vertex: metres. arm0, arm1: unit directions from the vertex along its walls; turning anticlockwise from
    arm0 by the opening angle leads through free space to arm1. lengths: (n, 2), of the arms, metres.
    opening: (n,), the angle through free space, radians, 0..2 pi: below pi the inner corner of a room, above
    it an outer one. opening_sigma: (n,), its standard deviation.
    """

    vertex: Points
    arm0: Points
    arm1: Points
    lengths: Points
    opening: NDArray[np.float64]
    opening_sigma: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MapFeatures:
    """What the merge sees in one map. free, occupied, unknown: numbers of cells as the map has them.
    specks: how many of the others are taken for free, 0 where the map has few of them: unknown cells amid the
    floor and along walls, occupied ones that stand alone. extent: width and height of the grid in metres."""

    name: str
    resolution: float
    shape: tuple[int, int]
    extent: tuple[float, float]
    free: int
    occupied: int
    unknown: int
    specks: int
    boundary: Boundary
    lines: Lines
    corners: Corners

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists and numbers, ready for JSON: counts, and all lines and corners."""
        return {
            "name": self.name,
            "resolution": self.resolution,
            "height": self.shape[0],
            "width": self.shape[1],
            "extent_m": list(self.extent),
            "cells": {"free": self.free, "occupied": self.occupied, "unknown": self.unknown},
            "specks": self.specks,
            "boundary_points": len(self.boundary.position),
            "lines": _rows(start=self.lines.start, end=self.lines.end, normal=self.lines.normal),
            "corners": _rows(
                vertex=self.corners.vertex,
                arm0=self.corners.arm0,
                arm1=self.corners.arm1,
                lengths_m=self.corners.lengths,
                opening=self.corners.opening,
                opening_sigma=self.corners.opening_sigma,
            ),
        }


def features(grid: OccupancyGrid, config: Mapping[str, Any] | None = None) -> MapFeatures:
    """What `merge` with the same `config` sees in `grid`; all coordinates are map coordinates.

    Raises ConfigError for an option that does not exist or is out of range.
    """
    options = json.dumps(effective_config(config or {}))
    seen = _core.LocalMap(grid.name, grid.data, grid.resolution, grid.origin, options)
    free, occupied = seen.class_counts()
    corners = seen.corners()
    return MapFeatures(
        name=grid.name,
        resolution=grid.resolution,
        shape=(grid.height, grid.width),
        extent=(grid.width * grid.resolution, grid.height * grid.resolution),
        free=free,
        occupied=occupied,
        unknown=grid.data.size - free - occupied,
        specks=seen.specks(),
        boundary=Boundary(**seen.boundary()),
        lines=Lines(**seen.lines()),
        corners=Corners(
            vertex=corners["vertex"],
            arm0=corners["arm0"],
            arm1=corners["arm1"],
            lengths=corners["lengths"],
            opening=np.array(corners["opening"], dtype=np.float64),
            opening_sigma=np.array(corners["opening_sigma"], dtype=np.float64),
        ),
    )


def _rows(**columns: NDArray[np.float64]) -> list[dict[str, Any]]:
    lists = [column.tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]
