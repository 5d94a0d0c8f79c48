"""What is on the bench, and what a person can do with it. It knows nothing of the web."""

from __future__ import annotations

import dataclasses
import json
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Prior, checked_pose
from mapmeld.grid import OccupancyGrid
from mapmeld.known import Known, Point, SamePoints, told
from mapmeld.known_cells import known_centre
from mapmeld.map_file import MapFile
from mapmeld.map_yaml import one_line
from mapmeld.merging import result_of
from mapmeld.output import OutputFolder, write_merged_maps, write_report, write_result, write_session
from mapmeld.result import MergeResult
from mapmeld.session_file import Session
from mapmeld.studio import layout, showing
from mapmeld.studio.contradictions import contradictions
from mapmeld.studio.desk import Desk, History, Solving
from mapmeld.studio.layout import Pose, as_pose

SOFT_SIGMA = (0.3, 0.3, 0.1)
"""Standard deviations of a soft pin: metres, metres, radians."""


class Busy(MapmeldError):
    """Something else must end first."""


class _Cancelled(Exception):
    pass


class Workbench:
    """Maps on a bench: moved, snapped, pinned, forbidden, solved, saved, with undo.

    Every method may be called from any thread; what changes the bench while a solve runs raises Busy.

    changed: called, from whatever thread, when there is something new to look at. files: where the maps are
        from, by their names.
    """

    def __init__(
        self,
        grids: Sequence[OccupancyGrid],
        config: Mapping[str, Any],
        known: Known,
        output: Path,
        *,
        force: bool = False,
        files: Mapping[str, MapFile] | None = None,
    ) -> None:
        self.grids = {g.name: g for g in grids}
        self.boxes = {n: layout.known_box(g) for n, g in self.grids.items()}
        self.output = output
        self.changed: Callable[[], object] = lambda: None
        self._force = force
        self._files = files or {}
        self._given = dict(config)
        self._config = effective_config(config)
        known.check_names(list(self.grids))
        poses: dict[str, Pose] = layout.unsolved(self.grids, self.boxes)
        poses |= {n: p.T_world_map for n, p in known.priors.items()} | dict(known.pins)
        self._history = History(Desk(poses, known))
        self._lock = threading.RLock()
        self._solving: Solving | None = None
        self._cancel = threading.Event()
        self._problem: str | None = None
        self._solves = 0
        self._looks = 0
        self._saved: MergeResult | None = None
        self._session = _core.Session(json.dumps(self._config))
        # Of its own, so that a snap need not wait for a solve.
        self._snapper = _core.Session(json.dumps(self._config))
        for session in (self._session, self._snapper):
            for n, g in self.grids.items():
                session.update(n, g.data, g.resolution, g.origin)

    # What there is to see.

    @property
    def desk(self) -> Desk:
        """The bench as it is."""
        with self._lock:
            return self._history.now

    def state(self) -> dict[str, Any]:
        """All that the page shows, as plain JSON."""
        with self._lock:
            desk, solving, problem = self._history.now, self._solving, self._problem
            undo, redo = self._history.undo, self._history.redo
            # Answers and news may overtake each other on their way: the page goes by the later look.
            self._looks += 1
            look = self._looks
            is_saved = desk.result is not None and self._saved is desk.result
        shown = showing.state(list(self.grids), desk, solving, problem, is_saved, (undo, redo), self.output)
        return {"look": look, **shown}

    def pairs(self, name: str) -> list[dict[str, Any]]:
        """What the map and each other one say of each other alone, the most probable first."""
        self._check(name)
        desk = self.desk
        return showing.pairs(name, list(self.grids), desk)

    def conflicts(self, component: int) -> NDArray[np.bool_]:
        """Where maps of a component contradict each other, on the grid of its merged map."""
        result = self.desk.result
        layer = None
        if result is not None and 0 <= component < len(result.components):
            layer = result.components[component].conflicts
        if layer is None:
            raise MapmeldError(f"conflicts: there are none of a component {component}")
        return layer

    # What moves maps.

    def move(self, poses: Mapping[str, Sequence[float]]) -> None:
        """Puts maps elsewhere: T_bench_map of some of them."""
        checked = {n: checked_pose(T, f"pose of {n!r}") for n, T in poses.items()}
        for name in checked:
            self._check(name)
        what = next(iter(checked)) if len(checked) == 1 else f"{len(checked)} maps"
        self._do(f"move {what}", lambda d: dataclasses.replace(d, poses={**d.poses, **checked}))

    def snap(self, names: Sequence[str]) -> dict[str, Any]:
        """Lets some maps, in the places that they have to each other, go near the others, and tells where
        they came to rest and what that is worth. Raises MapmeldError where no walls meet."""
        for name in names:
            self._check(name)
        desk = self.desk
        moved = {n: desk.poses[n] for n in names}
        near = layout.box_of(moved, self.grids, self.boxes) if moved else None
        base: dict[str, Pose] = {}
        for n, T in desk.poses.items():
            if n in moved or near is None or any(desk.known.is_forbidden(n, m) for m in moved):
                continue
            if _touch(near, layout.box_of({n: T}, self.grids, self.boxes)):
                base[n] = T
        found = None
        if base:
            pairs = () if desk.result is None else desk.result.pairs
            across = [p for p in pairs if (p.a in base and p.b in moved) or (p.b in base and p.a in moved)]
            decoy = max([0.0, *(p.decoy_log_likelihood or 0.0 for p in across)])
            placed = (list(base.items()), list(moved.items()))
            found = self._snapper.snap(*placed, (0.0, 0.0, 0.0), decoy)
        what = names[0] if len(names) == 1 else f"{len(names)} maps"
        if found is None:
            raise MapmeldError(
                one_line(
                    f"snap: no walls of {what} meet walls of other maps here; put it nearer to its place"
                )
            )
        shift = found["T_base_moved"]
        poses = {n: as_pose(se2.compose(shift, own)) for n, own in moved.items()}
        self._do(f"snap {what}", lambda d: dataclasses.replace(d, poses={**d.poses, **poses}))
        return {
            "poses": {n: list(own) for n, own in poses.items()},
            "probability": found["probability"],
            "log_likelihood": found["log_likelihood"],
            "agreement": found["agreement"],
            "shared_length": found["shared_length"],
            "onto": self._most_shared(names[0], base, poses),
        }

    def choose(self, k: int) -> None:
        """Takes the k-th hypothesis, from 0, for true: the maps that it places elsewhere than the result
        tells get soft pins there, the map that it begins with a hard one."""
        desk = self.desk
        if desk.result is None or not 0 <= k < len(desk.result.hypotheses):
            raise MapmeldError(f"choose: there is no hypothesis {k}; solve first")
        chosen: dict[int, dict[str, Pose]] = {}
        for m in desk.result.hypotheses[k].maps:
            chosen.setdefault(m.component, {})[m.name] = as_pose(m.T_component_map)
        poses: dict[str, Pose] = dict(desk.poses)
        pins, priors = dict(desk.known.pins), dict(desk.known.priors)
        components = {m.name: m.component for m in desk.result.maps}
        for members in chosen.values():
            lead = next(iter(members))
            into = se2.compose(desk.poses[lead], se2.inverse(members[lead]))
            for n, T in members.items():
                pose = as_pose(se2.compose(into, T))
                centre = known_centre(self.grids[n])
                off = math.dist(se2.apply(pose, np.array(centre)), se2.apply(desk.poses[n], np.array(centre)))
                if (components[n] != components[lead] or off > 0.5) and n not in pins:
                    pins.setdefault(lead, desk.poses[lead])
                    priors[n] = Prior(pose, SOFT_SIGMA)
                    poses[n] = pose
        known = dataclasses.replace(desk.known, pins=pins, priors=priors)
        did = f"choose hypothesis {k + 1}"
        self._do(did, lambda d: dataclasses.replace(d, poses=poses, known=known))

    # What becomes known.

    def pin(self, name: str, sigma: Sequence[float] | None = None) -> str | None:
        """Pins a map where it lies; with sigma (metres, metres, radians) softly. A pin says where a map lies
        to other pins, so the first one pins the map below as well, whose name it tells."""
        self._check(name)
        desk = self.desk
        pins, priors = dict(desk.known.pins), dict(desk.known.priors)
        pins.pop(name, None)
        priors.pop(name, None)
        also = None
        if not pins and not priors and len(self.grids) > 1:
            others = {n: T for n, T in desk.poses.items() if n != name}
            also = self._most_shared(name, others, desk.poses) or self._first_other(name)
            pins[also] = desk.poses[also]
        if sigma is None:
            pins[name] = desk.poses[name]
        else:
            priors[name] = Prior(desk.poses[name], sigma)
        self._know(f"pin {name}", pins=pins, priors=priors)
        return also

    def unpin(self, name: str) -> None:
        """Lets a map go."""
        self._check(name)
        known = self.desk.known
        pins = {n: T for n, T in known.pins.items() if n != name}
        priors = {n: p for n, p in known.priors.items() if n != name}
        self._know(f"unpin {name}", pins=pins, priors=priors)

    def forbid(self, a: str, b: str) -> None:
        """Says that two maps do not match."""
        self._check(a)
        self._check(b)
        self._know(f"forbid {a} and {b}", forbidden=(*self.desk.known.forbidden, (a, b)))

    def allow(self, a: str, b: str) -> None:
        """Takes that back."""
        kept = tuple(p for p in self.desk.known.forbidden if set(p) != {a, b})
        self._know(f"allow {a} and {b}", forbidden=kept)

    def same_points(self, a: str, b: str, points: Sequence[tuple[Point, Point]]) -> None:
        """Says that points of a are points of b, both in map coordinates, and puts b where they meet."""
        self._check(a)
        self._check(b)
        clicked = SamePoints(a, b, tuple(points))
        desk = self.desk
        kept = tuple(s for s in desk.known.same_points if {s.a, s.b} != {a, b})
        known = dataclasses.replace(desk.known, same_points=(*kept, clicked))
        heading = se2.wrap(desk.poses[b][2] - desk.poses[a][2])
        pose = as_pose(se2.compose(desk.poses[a], clicked.T_a_b(heading)))
        did = f"points of {a} and {b}"
        self._do(did, lambda d: dataclasses.replace(d, known=known, poses={**d.poses, b: pose}))

    def forget_points(self, a: str, b: str) -> None:
        """Takes points back."""
        kept = tuple(s for s in self.desk.known.same_points if {s.a, s.b} != {a, b})
        self._know(f"forget points of {a} and {b}", same_points=kept)

    def undo(self) -> None:
        """One step back, a solve included."""
        self._step(-1)

    def redo(self) -> None:
        """One step forward again."""
        self._step(1)

    # What takes longer.

    def solve(self) -> None:
        """Merges with all that is known, on the calling thread. Raises Busy while another one runs; a solve
        that is cancelled, or fails, leaves the bench as it was."""
        with self._lock:
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it")
            self._solving, self._problem = Solving(), None
            self._cancel.clear()
            known = self._history.now.known
        self.changed()
        try:
            result = self._merge(known)
        except _Cancelled:
            self._end(None, "cancelled; all is as it was before")
        except BaseException as error:
            self._end(None, f"the solve failed: {error}")
            if not isinstance(error, Exception):
                raise
        else:
            desk = self.desk
            poses = layout.solved(result, desk.poses, self.grids, self.boxes, desk.result is None)
            self._solves += 1
            against = contradictions(result, self.grids)
            self._end(Desk(poses, known, result, known, self._solves, against, "solve"), None)

    def cancel(self) -> None:
        """Ends a solve at its next piece of work."""
        self._cancel.set()

    def save(self) -> list[str]:
        """Writes what `mapmeld merge` writes, and session.json, all or nothing; names of the files.

        Raises Busy while a solve runs or when something became known since the last one, MapmeldError when
        the folder cannot be written to.
        """
        with self._lock:
            desk = self._history.now
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it, then save")
            if desk.result is None or desk.solved != desk.known:
                raise Busy("something has changed since the last solve; solve again, then save")
        grids = list(self.grids.values())
        with OutputFolder(self.output, force=self._force) as out:
            write_merged_maps(out.staged, desk.result)
            write_report(out.staged, desk.result, grids)
            write_result(out.staged, desk.result, out.folder)
            write_session(out.staged, Session.of(grids, self._given, desk.known))
            files = sorted(p.name for p in out.staged.iterdir())
            out.commit()
        with self._lock:
            self._saved = desk.result
        self.changed()
        return files

    def _merge(self, known: Known) -> MergeResult:
        last = 0.0

        def progress(stage: str, done: int, total: int) -> None:
            nonlocal last
            if self._cancel.is_set():
                raise _Cancelled
            with self._lock:
                self._solving = Solving(stage, done, total)
            # Ten times a second is enough for eyes.
            if time.monotonic() - last > 0.1:
                last = time.monotonic()
                self.changed()

        started = time.perf_counter()
        found = self._session.merge([], known.core_priors(), progress, known.relations(), known.forbidden)
        seconds = {**found["seconds"], "merge": time.perf_counter() - started}
        centres = {n: known_centre(g) for n, g in self.grids.items()}
        result = told(result_of(found, self._session.names(), self._config, seconds, centres), known)
        maps = (dataclasses.replace(m, file=self._files.get(m.name)) for m in result.maps)
        return dataclasses.replace(result, maps=tuple(maps))

    def _end(self, desk: Desk | None, problem: str | None) -> None:
        with self._lock:
            self._solving, self._problem = None, problem
            if desk is not None:
                self._history.push(desk)
        self.changed()

    def _know(self, did: str, **changes: Any) -> None:
        self._do(did, lambda d: dataclasses.replace(d, known=dataclasses.replace(d.known, **changes)))

    def _do(self, did: str, change: Callable[[Desk], Desk]) -> None:
        with self._lock:
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it")
            self._problem = None
            self._history.push(dataclasses.replace(change(self._history.now), did=did))
        self.changed()

    def _step(self, by: int) -> None:
        with self._lock:
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it")
            self._history.step(by)
            self._problem = None
        self.changed()

    def _check(self, name: str) -> None:
        if name not in self.grids:
            raise MapmeldError(one_line(f"no map is called {name!r}"))

    def _most_shared(self, name: str, others: Mapping[str, Pose], poses: Mapping[str, Pose]) -> str | None:
        """Which of the others lies most under a map, by the boxes of their known cells; None: none does."""
        own = layout.box_of({name: poses[name]}, self.grids, self.boxes)
        best, most = None, 0.0
        for n, T in others.items():
            box = layout.box_of({n: T}, self.grids, self.boxes)
            width, height = (
                min(own[2], box[2]) - max(own[0], box[0]),
                min(own[3], box[3]) - max(own[1], box[1]),
            )
            if width > 0 and height > 0 and width * height > most:
                best, most = n, width * height
        return best

    def _first_other(self, name: str) -> str:
        result = self.desk.result
        order = [] if result is None else [c.reference for c in result.components]
        return next(n for n in [*order, *self.grids] if n != name)


def _touch(a: layout.Box, b: layout.Box) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]
