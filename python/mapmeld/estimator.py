"""The incremental merge: maps that come, change and go, and where their robots are at any time."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from mapmeld import _core
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Estimate, EstimatedComponent, RobotEstimate
from mapmeld.grid import OccupancyGrid
from mapmeld.holding import Frames, Group, Held
from mapmeld.map_yaml import one_line
from mapmeld.merging import Progress, result_of
from mapmeld.result import MergeResult, PlacedMap


class Estimator:
    """Merges the maps of robots again and again while they grow.

        estimator = Estimator()
        estimator.update(grid)              # a new or changed map, known by grid.name
        estimate = estimator.estimate()

    config: options, nested by stage and partial; see default_config.

    Only pairs with a changed map are registered again. Every method may be called from any thread: what comes
    while an estimate runs counts for the next one.
    """

    def __init__(self, config: Mapping[str, Any] | None = None) -> None:
        self._config = effective_config(config or {})
        self._session = _core.Session(json.dumps(self._config))
        self._known = threading.Lock()
        self._turn = threading.Lock()
        self._grids: dict[str, OccupancyGrid] = {}
        self._seen: dict[str, OccupancyGrid] = {}
        self._frames = Frames()
        self._held: list[Held] = []
        self._drawn: dict[int, tuple[Any, OccupancyGrid]] = {}

    def update(self, grid: OccupancyGrid) -> None:
        """Takes a robot's map, new or changed; the robot is known by the map's name.

        The map is kept and nothing is computed. Raises MapmeldError for a map without a name.
        """
        if not isinstance(grid, OccupancyGrid):
            raise MapmeldError(f"update: takes an OccupancyGrid, got a {type(grid).__name__}")
        if not grid.name:
            raise MapmeldError("update: the map has no name; name it after its robot")
        with self._known:
            if not _is_same(self._grids.get(grid.name), grid):
                self._grids[grid.name] = grid

    def remove(self, name: str) -> None:
        """Forgets a robot. Raises MapmeldError when there is none of that name."""
        with self._known:
            if name not in self._grids:
                raise MapmeldError(one_line(f"remove: no robot is called {name!r}"))
            del self._grids[name]

    def estimate(self, progress: Progress | None = None) -> Estimate:
        """Where all robots are, told from the maps as they are when this begins.

        progress: called between pieces of work, on the calling thread; what it raises ends the estimate. The
        pairs that were registered until then are kept, and what is held stays as it was. An estimate waits
        for one that runs in another thread.
        """
        with self._turn:
            started = time.perf_counter()
            with self._known:
                grids = dict(self._grids)
            if not grids:
                self._held = []
                return Estimate((), (), None, 0, time.perf_counter() - started)
            self._tell_session(grids)
            found = self._session.merge(progress)
            names = self._session.names()
            seconds = {**found["seconds"], "merge": time.perf_counter() - started}
            result = result_of(found, names, self._config, seconds)
            self._held = self._frames.follow(_groups(result), self._held, list(grids), False)
            self._held.sort(key=lambda h: (-len(h.poses), not h.is_world, min(h.poses)))
            components = tuple(self._component(h, grids) for h in self._held)
            robots = tuple(self._robot(m) for m in sorted(result.maps, key=lambda m: m.name))
            seconds_taken = time.perf_counter() - started
            return Estimate(robots, components, result, found["registered_pairs"], seconds_taken)

    def _tell_session(self, grids: Mapping[str, OccupancyGrid]) -> None:
        for name in self._seen.keys() - grids.keys():
            self._session.remove(name)
            del self._seen[name]
        for name, grid in grids.items():
            if self._seen.get(name) is not grid:
                self._session.update(name, grid.data, grid.resolution, grid.origin)
                self._seen[name] = grid

    def _component(self, held: Held, grids: Mapping[str, OccupancyGrid]) -> EstimatedComponent:
        names = tuple(n for n in grids if n in held.poses)
        fused = self._session.fuse("merged", [(n, held.poses[n].tolist()) for n in names])
        merged = OccupancyGrid(fused["data"], fused["resolution"], fused["origin"], "merged")
        return EstimatedComponent(tuple(sorted(names)), held.anchor, held.is_world, merged)

    def _robot(self, placed: PlacedMap) -> RobotEstimate:
        k = next((k for k, h in enumerate(self._held) if placed.name in h.poses), None)
        pose = None if k is None else self._held[k].poses[placed.name]
        return RobotEstimate(
            placed.name, k, pose, placed.covariance, placed.probability, placed.status, placed.reason, None, 0
        )


def _is_same(old: OccupancyGrid | None, new: OccupancyGrid) -> bool:
    return (
        old is not None
        and old.resolution == new.resolution
        and old.origin == new.origin
        and np.array_equal(old.data, new.data)
    )


def _groups(result: MergeResult) -> list[Group]:
    """The components of a merge, without blank maps."""
    groups: dict[int, dict[str, Any]] = {}
    for m in result.maps:
        if m.T_component_map is not None:
            groups.setdefault(m.component, {})[m.name] = m.T_component_map
    return [Group(poses) for _, poses in sorted(groups.items())]
