"""The bench at one time, and the times before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.known import Known
from mapmeld.result import MergeResult
from mapmeld.studio.layout import Pose

# Metres and radians; far less than anybody moves a map by.
_STILL = 1e-6

_MOST = 100
"""Steps that can be undone. Each solve among them keeps its merged maps."""


@dataclass(frozen=True)
class Desk:
    """The bench at one time. poses: T_bench_map of every map; laid: the same as the last solve, or the start,
    laid them out. result: of the last solve, which knew `solved` and has the number `solve`; contradicting:
    share of each map's cells that contradict others there. did: what led here, for the undo button.
    frame: another number where the bench got another frame.
    """

    poses: Mapping[str, Pose]
    known: Known = field(default_factory=Known)
    result: MergeResult | None = None
    solved: Known | None = None
    solve: int = 0
    contradicting: Mapping[str, float] = field(default_factory=dict)
    did: str = ""
    laid: Mapping[str, Pose] = field(default_factory=dict)
    frame: int = 0

    @property
    def moved(self) -> list[str]:
        """Maps that were moved since they were laid out; none where all were moved together."""
        first = next(iter(self.poses))
        if not any(self.was_moved(n, first) for n in self.poses):
            return []
        return [n for n, T in self.poses.items() if not np.allclose(T, self.laid[n], atol=_STILL)]

    def was_moved(self, a: str, b: str) -> bool:
        """Whether two maps lie otherwise to each other than they were laid out."""
        now, then = (se2.compose(se2.inverse(at[a]), at[b]) for at in (self.poses, self.laid))
        turn = abs(se2.wrap(now[2] - then[2]))
        return not (np.allclose(now[:2], then[:2], atol=_STILL) and turn < _STILL)


@dataclass(frozen=True)
class Solving:
    """A solve that runs. stage, done, total: as a merge's progress tells them."""

    stage: str = "prepare"
    done: int = 0
    total: int = 0


class History:
    """A desk, those before it and those that were undone."""

    def __init__(self, first: Desk) -> None:
        self._desks = [first]
        self._at = 0

    @property
    def now(self) -> Desk:
        """The desk as it is."""
        return self._desks[self._at]

    @property
    def undo(self) -> str | None:
        """What the last step did; None when there is none."""
        return self.now.did if self._at > 0 else None

    @property
    def redo(self) -> str | None:
        """What the step did that was undone last; None when there is none."""
        return self._desks[self._at + 1].did if self._at + 1 < len(self._desks) else None

    def push(self, desk: Desk) -> None:
        """A further step; what was undone is forgotten."""
        self._desks = [*self._desks[: self._at + 1], desk][-_MOST:]
        self._at = len(self._desks) - 1

    def step(self, by: int) -> None:
        """Goes back (-1) or forward (1) again. Raises MapmeldError when there is no such step."""
        if not 0 <= self._at + by < len(self._desks):
            raise MapmeldError("nothing to undo" if by < 0 else "nothing to redo")
        self._at += by
