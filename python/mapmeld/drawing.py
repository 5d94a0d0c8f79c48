"""A fused map that is drawn when somebody wants it."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

from mapmeld.errors import MapmeldError
from mapmeld.fusing import fuse
from mapmeld.grid import OccupancyGrid

Placed = Sequence[tuple[OccupancyGrid, Sequence[float]]]
"""Maps and T_frame_map."""


class Drawing:
    """The fused map of maps at their poses, drawn at the first look and kept; any thread may look.

    placed: maps and T_frame_map, metres and radians. config: options, as in fuse.
    """

    def __init__(self, placed: Placed, config: Mapping[str, Any]) -> None:
        self._placed = placed
        self._config = config
        self._drawing = threading.Lock()
        self._drawn: tuple[OccupancyGrid | None, str | None] | None = None

    def shows(self, placed: Placed) -> bool:
        """Whether it is of just these maps at these poses."""
        return len(self._placed) == len(placed) and all(
            a[0] is b[0] and a[1] == b[1] for a, b in zip(self._placed, placed, strict=True)
        )

    @property
    def merged(self) -> OccupancyGrid | None:
        """The fused map; None when it cannot be drawn."""
        return self._look()[0]

    @property
    def problem(self) -> str | None:
        """Why it cannot be drawn and what to do, None when it can: maps may lie too far apart for one map."""
        return self._look()[1]

    def _look(self) -> tuple[OccupancyGrid | None, str | None]:
        with self._drawing:
            if self._drawn is None:
                try:
                    self._drawn = fuse(self._placed, config=self._config), None
                except MapmeldError as problem:
                    self._drawn = None, str(problem)
            return self._drawn
