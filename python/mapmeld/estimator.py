"""The incremental merge: maps that come, change and go, and where their robots are at any time."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, holding, linking, robots
from mapmeld.admission import admitted
from mapmeld.config import effective_config
from mapmeld.covariances import covariances_in_frames
from mapmeld.drawing import Drawing
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Estimate, EstimatedComponent, Prior, checked_pose
from mapmeld.frames import Frames, Group, Held, steady
from mapmeld.grid import OccupancyGrid
from mapmeld.holding import Hold
from mapmeld.known_cells import KnownCells, known_cells
from mapmeld.map_yaml import one_line
from mapmeld.merging import Progress, result_of
from mapmeld.result import MergeResult


@dataclass
class _Known:
    """What an estimator was told: maps in the order in which their robots came, priors and pins.

    gone: robots that were removed since the last estimate began; one of that name that came later is another.
    """

    grids: dict[str, OccupancyGrid] = field(default_factory=dict)
    priors: dict[str, Prior] = field(default_factory=dict)
    pins: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    gone: set[str] = field(default_factory=set)

    def taken(self) -> _Known:
        """A copy, after which nobody is gone."""
        gone, self.gone = self.gone, set()
        return _Known(dict(self.grids), dict(self.priors), dict(self.pins), gone)


class Estimator:
    """Merges the maps of robots again and again while they grow.

        estimator = Estimator()
        estimator.update(grid)              # a new or changed map, known by grid.name
        estimate = estimator.estimate()

    config: options, nested by stage and partial; see default_config. hold: how firmly an estimate holds on to
        what the one before said.

    Only pairs with a changed map are registered again. Every method may be called from any thread: what comes
    while an estimate runs counts for the next one. See docs/estimator.md.
    """

    def __init__(self, config: Mapping[str, Any] | None = None, hold: Hold | None = None) -> None:
        self._config = effective_config(config or {})
        self._hold = hold if hold is not None else Hold()
        if not isinstance(self._hold, Hold):
            raise MapmeldError(f"hold: takes a Hold, got a {type(hold).__name__}")
        self._session = _core.Session(json.dumps(self._config))
        self._known = _Known()
        self._changing = threading.Lock()
        self._turn = threading.Lock()
        # What only the estimate whose turn it is touches.
        self._told: dict[str, OccupancyGrid] = {}
        self._cells: dict[str, KnownCells] = {}
        self._frames = Frames()
        self._held: list[Held] = []
        self._by_prior: set[str] = set()
        self._placements: dict[str, int] = {}
        self._covariances: dict[str, NDArray[np.float64]] = {}
        self._drawings: dict[int, Drawing] = {}

    def update(self, grid: OccupancyGrid) -> None:
        """Takes a robot's map, new or changed; the robot is known by the map's name.

        The map is kept and nothing is computed; one that is as it was changes nothing. Raises MapmeldError
        for a map without a name.
        """
        if not isinstance(grid, OccupancyGrid):
            raise MapmeldError(f"update: takes an OccupancyGrid, got a {type(grid).__name__}")
        if not grid.name:
            raise MapmeldError("update: the map has no name; name it after its robot")
        with self._changing:
            if not _is_same(self._known.grids.get(grid.name), grid):
                self._known.grids[grid.name] = grid

    def remove(self, name: str) -> None:
        """Forgets a robot, its prior and its pin. Raises MapmeldError when there is no map of that name."""
        with self._changing:
            if name not in self._known.grids:
                raise MapmeldError(one_line(f"remove: no robot is called {name!r}"))
            del self._known.grids[name]
            self._known.gone.add(name)
            self._known.priors.pop(name, None)
            self._known.pins.pop(name, None)

    def set_prior(self, name: str, prior: Prior | None) -> None:
        """What is known of a robot's pose, which may be told before its first map; None forgets it."""
        if not (prior is None or isinstance(prior, Prior)):
            raise MapmeldError(
                one_line(f"set_prior: takes a Prior for {name!r}, got a {type(prior).__name__}")
            )
        with self._changing:
            if prior is None:
                self._known.priors.pop(name, None)
            else:
                self._known.priors[name] = prior

    def pin(self, name: str, T_world_map: Sequence[float]) -> None:
        """Puts a robot's map at (x, y, theta), metres and radians, exactly and whatever the walls say.

        It may be told before the robot's first map, and stands above a prior. Raises MapmeldError for
        anything but three finite numbers.
        """
        pose = checked_pose(T_world_map, f"pin of {name!r}: T_world_map")
        with self._changing:
            self._known.pins[name] = pose

    def unpin(self, name: str) -> None:
        """Lets a robot go; its prior counts again. Raises MapmeldError when it is not pinned."""
        with self._changing:
            if name not in self._known.pins:
                raise MapmeldError(one_line(f"unpin: {name!r} is not pinned"))
            del self._known.pins[name]

    def estimate(self, progress: Progress | None = None, maps_are_done: bool = False) -> Estimate:
        """Where all robots are, told from what is known when this begins.

        progress: called between pieces of work, on the calling thread; what it raises ends the estimate. The
        pairs that were registered until then are kept, and what is held stays as it was. An estimate waits
        for one that runs in another thread.

        maps_are_done: no map will grow for now. New links need no more than a merge asks for then; while
        maps grow they must be clearer, see Hold.
        """
        with self._turn:
            started = time.perf_counter()
            with self._changing:
                known = self._known.taken()
            self._forget(known.gone)
            self._tell_session(known.grids)
            if not known.grids:
                self._held, self._by_prior, self._placements, self._drawings = [], set(), {}, {}
                return Estimate((), (), None, 0, time.perf_counter() - started)
            result, registered = self._merge(known, progress, started)
            held, against, unclear = self._follow(result, known, progress, maps_are_done)
            self._count(held)
            self._held = held
            # What is held by walls is no less held when the merge leaves it to its prior.
            self._by_prior = {m.name for m in result.maps if m.status == "prior" and m.name not in against}
            components = tuple(self._component(h, known.grids) for h in held)
            self._drawings = {h.frame: self._drawings[h.frame] for h in held}
            centres = {n: c.centre for n, c in self._cells.items()}
            self._covariances = covariances_in_frames(result, held, self._covariances)
            of_robot = tuple(
                robots.tell(
                    m,
                    held,
                    against,
                    unclear,
                    known.pins,
                    result,
                    centres,
                    self._covariances.get(m.name),
                    self._placements.get(m.name, 0),
                )
                for m in robots.seen_from_anchors(result, held)
            )
            return Estimate(of_robot, components, result, registered, time.perf_counter() - started)

    def _forget(self, gone: Set[str]) -> None:
        for name in gone & self._told.keys():
            self._session.remove(name)
            del self._told[name], self._cells[name]
        self._placements = {n: k for n, k in self._placements.items() if n not in gone}
        self._covariances = {n: c for n, c in self._covariances.items() if n not in gone}
        self._by_prior -= gone
        left = [(h, {n: T for n, T in h.poses.items() if n not in gone}) for h in self._held]
        self._held = [Held(h.frame, h.anchor, h.is_world, poses) for h, poses in left if poses]

    def _tell_session(self, grids: Mapping[str, OccupancyGrid]) -> None:
        for name, grid in grids.items():
            if self._told.get(name) is not grid:
                self._session.update(name, grid.data, grid.resolution, grid.origin)
                self._told[name] = grid
                self._cells[name] = known_cells(grid)

    def _merge(self, known: _Known, progress: Progress | None, started: float) -> tuple[MergeResult, int]:
        """The merge of the maps as they are, its components in the frames of those that are held."""
        arrival = list(known.grids)
        # As Frames.follow chooses between anchors.
        first = sorted(
            (h for h in self._held if h.anchor in h.poses),
            key=lambda h: (not h.is_world, -len(h.poses), arrival.index(h.anchor)),
        )
        anchors = [h.anchor for h in first]
        references = [*anchors, *(n for n in arrival if n not in anchors)]
        found = self._session.merge(references, _priors(known), progress)
        centres = {n: c.centre for n, c in self._cells.items()}
        seconds = {**found["seconds"], "merge": time.perf_counter() - started}
        result = result_of(found, self._session.names(), self._config, seconds, centres)
        return result, found["registered_pairs"]

    def _follow(
        self, result: MergeResult, known: _Known, progress: Progress | None, maps_are_done: bool
    ) -> tuple[list[Held], dict[str, float], dict[str, float]]:
        """What is held from now on; the robots that it holds where the merge does not, and those that it does
        not place where the merge does, each with the probability of that place."""
        priors = _priors(known)
        centres = {n: c.centre for n, c in self._cells.items()}

        def ask(base: holding.Poses, moved: holding.Poses, places: Sequence[Any]) -> holding.Answer:
            question = (_listed(base), _listed(moved), [p.tolist() for p in places])
            return self._session.weigh([question], priors, progress)[0]

        groups = _groups(result)
        free = self._by_prior | holding.repinned(self._held, groups, known.pins, centres)
        units = holding.units(self._held, groups, free, centres, self._hold, ask)
        against = {n: p for u in units for n, p in u.against.items()}
        sure = {name for name, *_ in priors}
        enough = self._config["evidence"]["min_probability"]
        least = enough if maps_are_done else max(enough, self._hold.join)
        groups, unclear = admitted(groups, units, sure, known.pins, centres, self._hold, least, ask)
        joined = linking.joined(groups, units, known.pins, centres, self._hold)
        world_is_given = bool(known.priors or known.pins)
        followed = self._frames.follow(joined, self._held, list(known.grids), world_is_given)
        covariances = {m.name: m.covariance for m in result.maps if m.covariance is not None}
        held = steady(followed, self._held, self._cells, covariances, known.pins, self._hold.refine_cells)
        return sorted(held, key=lambda h: (-len(h.poses), not h.is_world, min(h.poses))), against, unclear

    def _count(self, held: Sequence[Held]) -> None:
        """Counts who is put somewhere else by more than noise."""
        before = {n: (h.frame, T) for h in self._held for n, T in h.poses.items()}
        counts = {}
        for h in held:
            for name, T in h.poses.items():
                count = self._placements.get(name, 0)
                old = before.get(name)
                if old is None:
                    count += name != h.anchor
                elif old[0] != h.frame or not self._hold.is_same_place(old[1], T, self._cells[name].centre):
                    count += 1
                counts[name] = count
        self._placements = counts

    def _component(self, held: Held, grids: Mapping[str, OccupancyGrid]) -> EstimatedComponent:
        """The component with its fused map, which is another one only when a map or a pose has changed."""
        placed = [(grids[n], held.poses[n].tolist()) for n in grids if n in held.poses]
        drawing = self._drawings.get(held.frame)
        if drawing is None or not drawing.shows(placed):
            drawing = self._drawings[held.frame] = Drawing(placed, self._config)
        return EstimatedComponent(tuple(sorted(held.poses)), held.anchor, held.is_world, drawing)


def _is_same(old: OccupancyGrid | None, new: OccupancyGrid) -> bool:
    return (
        old is not None
        and old.resolution == new.resolution
        and old.origin == new.origin
        and np.array_equal(old.data, new.data)
    )


def _priors(known: _Known) -> list[tuple[str, list[float], list[float] | None]]:
    """Priors of the robots that have maps; a pin stands above a prior."""
    told: list[tuple[str, list[float], list[float] | None]] = []
    for name in known.grids:
        if name in known.pins:
            told.append((name, list(known.pins[name]), None))
        elif name in known.priors:
            told.append((name, list(known.priors[name].T_world_map), list(known.priors[name].sigma)))
    return told


def _listed(poses: holding.Poses) -> list[tuple[str, list[float]]]:
    return [(n, T.tolist()) for n, T in poses.items()]


def _groups(result: MergeResult) -> list[Group]:
    """The components of a merge in the order in which they were merged, without blank maps: these have no
    pose."""
    poses = {m.name: m.T_component_map for m in result.maps if m.T_component_map is not None}
    return [
        Group({n: poses[n] for n in c.order}, c.in_world)
        for c in result.components
        if all(n in poses for n in c.order)
    ]
