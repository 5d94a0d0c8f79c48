"""Fuses the newest maps at the poses that are held, and says what has to be published."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mapmeld import Estimate, OccupancyGrid, fuse
from mapmeld.errors import MapmeldError
from mapmeld.grid import UNKNOWN
from mapmeld_ros.components import Named
from mapmeld_ros.extent import grown

# Maps that come within this time of each other become one merged map.
_GATHER_SECONDS = 0.03


class MergedMaps:
    """The merged map of every component. Each covers what it covered before, see extent."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        self._config = config
        # By the component's frame: the cells of one frame are offset by whole cells from each other.
        self._published: dict[str, OccupancyGrid] = {}
        self._numbers: dict[str, int] = {}
        self.problems: dict[str, str] = {}
        """Frames of components whose merged map could not be made in the last call, and why; what was made
        before stays."""

    def changed(
        self, estimate: Estimate, names: Sequence[Named], grids: Mapping[str, OccupancyGrid]
    ) -> list[tuple[Named, OccupancyGrid]]:
        """The merged maps that differ from those of the last call, or have another number.

        names: of the estimate's components. grids: the robots' newest maps, those that joined first in front.
        """
        poses = {r.name: r.T_world_map for r in estimate.robots if r.T_world_map is not None}
        current: dict[str, OccupancyGrid] = {}
        changed = []
        problems = {}
        for component, named in zip(estimate.components, names, strict=True):
            members = set(component.names)
            placed = [(g, poses[n]) for n, g in grids.items() if n in members and n in poses]
            if not any((g.data != UNKNOWN).any() for g, _ in placed):
                # The robots of it have left, or have lost all their cells, since the estimate.
                continue
            earlier = self._published.get(named.frame)
            try:
                merged = grown(fuse(placed, config=self._config), earlier)
            except MapmeldError as error:
                problems[named.frame] = str(error)
                if earlier is None:
                    continue
                merged = earlier
            if earlier is None or self._numbers[named.frame] != named.number or not is_same(merged, earlier):
                changed.append((named, merged))
            current[named.frame] = merged
        self._numbers = {named.frame: named.number for named in names if named.frame in current}
        self._published = current
        self.problems = problems
        return changed

    def by_frame(self) -> dict[str, OccupancyGrid]:
        """The newest merged maps."""
        return dict(self._published)


class MergeWorker:
    """Calls `merge` on a thread of its own when something has changed, at most `rate()` times a second."""

    def __init__(
        self, rate: Callable[[], float], merge: Callable[[], None], on_error: Callable[[Exception], None]
    ) -> None:
        self._rate, self._merge, self._on_error = rate, merge, on_error
        self._changed = threading.Event()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="merging", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def request(self) -> None:
        """Something has changed."""
        self._changed.set()

    def stop(self) -> None:
        self._stopping.set()
        self._changed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        started = 0.0
        while True:
            self._changed.wait()
            left = started + 1.0 / self._rate() - time.monotonic()
            if self._stopping.wait(max(left, _GATHER_SECONDS)):
                return
            self._changed.clear()
            started = time.monotonic()
            try:
                self._merge()
            except Exception as error:  # one bad merge must not end all later ones
                self._on_error(error)


def is_same(a: OccupancyGrid, b: OccupancyGrid) -> bool:
    """Whether two grids have the same cells at the same place."""
    return (
        a.resolution == b.resolution
        and a.origin == b.origin
        and a.data.shape == b.data.shape
        and a.data.tobytes() == b.data.tobytes()
    )
