"""What a report tells: a result as result.json has it, its maps, and the layers of its merged maps."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.known_cells import known_centre
from mapmeld.result import MergeResult


@dataclass(frozen=True, eq=False)
class Layers:
    """A merged map and what is behind it, as in Component."""

    merged: OccupancyGrid
    provenance: NDArray[np.int32]
    conflicts: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Story:
    """found: the contents of result.json. grids: the maps by name, in the order given. layers: of each
    component, None where it has no merged map."""

    found: Mapping[str, Any]
    grids: Mapping[str, OccupancyGrid]
    layers: Sequence[Layers | None]

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each map, from 0."""
        return {m["name"]: i for i, m in enumerate(self.found["maps"])}

    @cached_property
    def centres(self) -> dict[str, tuple[float, float]]:
        """Of the known cells of each map, map coordinates, metres."""
        return {name: known_centre(grid) for name, grid in self.grids.items()}

    @cached_property
    def left_out(self) -> list[Mapping[str, Any]]:
        """Maps that lie with no other, where there was one to lie with; and blank ones."""
        parts, maps = self.found["components"], self.found["maps"]
        return [
            m
            for m in maps
            if m["status"] == "blank" or (len(maps) > 1 and len(parts[m["component"]]["order"]) == 1)
        ]

    def pose(self, name: str) -> NDArray[np.float64]:
        """T_component_map of a map that has one."""
        return np.array(self.found["maps"][self.index[name]]["T_component_map"], dtype=np.float64)


def story_of(result: MergeResult, maps: Sequence[OccupancyGrid]) -> Story:
    """The story of a merge. maps: those that were merged, in the same order."""
    grids = {m.name: grid for m, grid in zip(result.maps, maps, strict=True)}
    found = result.to_dict()
    layers: list[Layers | None] = []
    for k, c in enumerate(result.components):
        if c.merged is None:
            layers.append(None)
        elif c.provenance is None or c.conflicts is None:
            layers.append(_fused(found, k, grids))
        else:
            layers.append(Layers(c.merged, c.provenance, c.conflicts))
    return Story(found, grids, layers)


def retold(found: Mapping[str, Any], grids: Mapping[str, OccupancyGrid]) -> Story:
    """The story of an earlier merge: its maps are put together again as they lay.

    found: the contents of a result.json, checked. grids: its maps by name. Raises MapmeldError when a map has
    no known cell where the result says that it has.
    """
    numbers = range(len(found["components"]))
    return Story(found, grids, [_fused(found, k, grids) for k in numbers])


def _fused(found: Mapping[str, Any], k: int, grids: Mapping[str, OccupancyGrid]) -> Layers | None:
    component = found["components"][k]
    if component["merged"] is None:
        return None
    poses = {m["name"]: m["T_component_map"] for m in found["maps"]}
    placed = []
    for name in component["order"]:
        g = grids[name]
        if not (g.data >= 0).any():
            raise MapmeldError(
                f"map {name}: has no known cell now, and had some when it was merged; merge anew"
            )
        placed.append((name, g.data, g.resolution, g.origin, poses[name]))
    name = str(component["merged"]).removesuffix(".yaml")
    fused = _core.fuse(name, placed, json.dumps(found["config"]))
    merged = OccupancyGrid(fused["data"], fused["resolution"], fused["origin"], name)
    return Layers(merged, fused["sources"], fused["disputed"])
