"""What all figures are drawn from: the maps, prepared, and what a merge of all of them says."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2
from mapmeld.datasets import bundled
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_io import read_map
from mapmeld.merging import merge
from mapmeld.metrics import centre_of_known_cells
from mapmeld.result import MergeResult
from mapmeld.tolerance import ACCEPTED

Pose = NDArray[np.float64]
"""(x, y, theta), metres and radians; an array of them has the shape (n, 3)."""

PARTICLES = 100


class Perceived(TypedDict):
    """Both perception models of a pool of poses, an entry a pose; see _core.perceive."""

    psi: NDArray[np.float64]
    gamma: NDArray[np.float64]
    psi_normalised: NDArray[np.float64]
    gamma_normalised: NDArray[np.float64]
    product: NDArray[np.float64]
    walls: list[dict[str, float]]


@dataclass(frozen=True, eq=False)
class Study:
    """The maps and what is known of them. Maps are named by their index here.

    local: the same maps as the core prepares them. result: all of them merged, order unknown. seed: of the
    merges, and of every sample that a figure draws.
    """

    grids: tuple[OccupancyGrid, ...]
    local: tuple[_core.LocalMap, ...]
    result: MergeResult
    seed: int

    def T_a_b(self, a: int, b: int) -> Pose | None:
        """Where the merge of all maps puts b in the frame of a; None when it keeps them apart."""
        first, second = self.result.maps[a], self.result.maps[b]
        if first.T_component_map is None or second.T_component_map is None:
            return None
        if first.component != second.component:
            return None
        return se2.compose(se2.inverse(first.T_component_map), second.T_component_map)

    def joined_pairs(self) -> list[tuple[int, int]]:
        """All pairs a < b that the merge puts into one component."""
        n = len(self.grids)
        return [(a, b) for a in range(n) for b in range(a + 1, n) if self.T_a_b(a, b) is not None]

    def error(self, b: int, T: Pose, T_right: Pose) -> tuple[float, float]:
        """How far two places of map b lie apart: metres at the centre of its known cells, and degrees."""
        centre = np.array(centre_of_known_cells(self.grids[b]) or (0.0, 0.0))
        metres = float(np.linalg.norm(se2.apply(T, centre) - se2.apply(T_right, centre)))
        return metres, abs(math.degrees(se2.wrap(float(T[2] - T_right[2]))))

    def is_right(self, a: int, b: int, T_a_b: Pose) -> bool:
        """Whether the pose is the merge's own, within the tolerance of the acceptance rule."""
        T = self.T_a_b(a, b)
        return T is not None and ACCEPTED.admits(*self.error(b, T_a_b, T), self.grids[b].resolution, 0.0)

    def register(self, a: int, b: int) -> list[_core._Mode]:
        """The refined modes of T_a_b, most likely first."""
        return _core.register(self.local[a], self.local[b], "{}")[1]

    def perceive(self, a: int, b: int, poses: Pose, classes: str) -> Perceived:
        """Both perception models over the pool `poses` of T_a_b; classes of Psi: "all" or "occupied"."""
        config = json.dumps({"perception": {"classes": classes}})
        return cast(Perceived, _core.perceive(self.local[a], self.local[b], poses.tolist(), config))


def prepare(grid: OccupancyGrid) -> _core.LocalMap:
    """The map as the core sees it, with all options at their defaults."""
    return _core.LocalMap(grid.name, grid.data, grid.resolution, grid.origin, "{}")


def bundled_maps() -> list[OccupancyGrid]:
    """The ten maps that come with the package."""
    return [read_map(path) for path in sorted(bundled("maze10").glob("*.yaml"))]


def study(maps: Sequence[OccupancyGrid] | None = None, seed: int = 1) -> Study:
    """Prepares and merges the maps (None: the bundled ones).

    Raises MapmeldError when no two of them belong together: there would be nothing to show.
    """
    grids = tuple(bundled_maps() if maps is None else maps)
    result = merge(grids, particles=PARTICLES, seed=seed)
    made = Study(grids, tuple(prepare(grid) for grid in grids), result, seed)
    if not made.joined_pairs():
        raise MapmeldError("figures: no two of the maps belong together; give maps that overlap")
    return made
