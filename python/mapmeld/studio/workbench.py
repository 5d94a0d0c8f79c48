"""What is on the bench, and what a person can do with it. It knows nothing of the web."""

from __future__ import annotations

import dataclasses
import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.estimate import checked_pose
from mapmeld.grid import OccupancyGrid
from mapmeld.known import Known, Point, SamePoints
from mapmeld.known_cells import known_centre
from mapmeld.map_file import MapFile
from mapmeld.map_yaml import one_line
from mapmeld.result import MergeResult
from mapmeld.studio import hypotheses, layout, pinning, showing
from mapmeld.studio.contradictions import contradictions
from mapmeld.studio.desk import Desk, History, Solving
from mapmeld.studio.layout import Pose, as_pose
from mapmeld.studio.saving import Busy, saved_result, write
from mapmeld.studio.snapping import neighbours
from mapmeld.studio.solving import solved

_Told = TypeVar("_Told")


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
        self._centres = {n: known_centre(g) for n, g in self.grids.items()}
        self.output = output
        self.changed: Callable[[], object] = lambda: None
        self._force = force
        self._files = files or {}
        self._given = dict(config)
        self._config = effective_config(config)
        known.check_names(list(self.grids))
        poses: dict[str, Pose] = layout.unsolved(self.grids, self.boxes)
        poses |= {n: p.T_world_map for n, p in known.priors.items()} | dict(known.pins)
        self._history = History(Desk(poses, known, laid=poses))
        self._lock = threading.RLock()
        self._solving: Solving | None = None
        self._cancel = threading.Event()
        self._problem: str | None = None
        self._solves = 0
        self._looks = 0
        self._saved: MergeResult | None = None
        self._arrangements: tuple[Desk, list[dict[str, Any]]] | None = None
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
            is_saved = desk.result is not None and self._saved is desk.result and not desk.moved
            # The state is asked for ten times a second; where maps lie changes seldom.
            if self._arrangements is None or self._arrangements[0] is not desk:
                self._arrangements = (desk, showing.arrangements(desk, self._centres))
            told = self._arrangements[1]
        shown = showing.state(list(self.grids), desk, solving, problem, is_saved, (undo, redo), self.output)
        return {"look": look, **shown, "hypotheses": told}

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
        base, decoy = neighbours(names, desk, self.grids, self.boxes)
        found = None
        if base:
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
            "onto": layout.most_shared(names[0], base, poses, self.grids, self.boxes),
        }

    def choose(self, k: int) -> str:
        """Takes the k-th hypothesis, from 0, for true, see hypotheses.chosen; tells what that says. Raises
        MapmeldError where that is nothing."""
        return self._tell(f"choose hypothesis {k + 1}", lambda d: hypotheses.chosen(k, d, self._centres))

    # What becomes known.

    def pin(self, name: str, sigma: Sequence[float] | None = None) -> str | None:
        """Pins a map where it lies; with sigma (metres, metres, radians) softly. A pin says where a map lies
        to other pins, so the first one pins the map below as well, whose name it tells. Raises MapmeldError
        for a map that neither lies on another one nor was moved."""
        self._check(name)
        return self._tell(f"pin {name}", lambda d: pinning.pinned(name, sigma, d, self.grids, self.boxes))

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
            self._end(
                Desk(poses, known, result, known, self._solves, against, "solve", poses, desk.frame), None
            )

    def cancel(self) -> None:
        """Ends a solve at its next piece of work."""
        self._cancel.set()

    def save(self) -> list[str]:
        """Writes what `mapmeld merge --report` writes, and session.json, all or nothing; names of the files.

        Raises Busy while a solve runs, and when something became known or was moved since the last one;
        MapmeldError when the folder cannot be written to.
        """
        with self._lock:
            desk = self._history.now
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it, then save")
            result = saved_result(desk)
        files = write(self.output, self._force, result, list(self.grids.values()), self._given, desk)
        with self._lock:
            self._saved = result
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

        return solved(self._session, known, progress, self._centres, self._config, self._files)

    def _end(self, desk: Desk | None, problem: str | None) -> None:
        with self._lock:
            self._solving, self._problem = None, problem
            if desk is not None:
                self._history.push(desk)
        self.changed()

    def _know(self, did: str, **changes: Any) -> None:
        self._do(did, lambda d: dataclasses.replace(d, known=dataclasses.replace(d.known, **changes)))

    def _do(self, did: str, change: Callable[[Desk], Desk]) -> None:
        self._tell(did, lambda d: (change(d), None))

    def _tell(self, did: str, change: Callable[[Desk], tuple[Desk, _Told]]) -> _Told:
        with self._lock:
            if self._solving is not None:
                raise Busy("a solve is running; wait for it or cancel it")
            desk, told = change(self._history.now)
            self._problem = None
            self._history.push(dataclasses.replace(desk, did=did))
        self.changed()
        return told

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
