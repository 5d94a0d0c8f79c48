"""Whether two poses of a map are one place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2

ONE_PLACE = _core.SAME_WORLD
"""Metres at the middle of a map's known cells, and radians, within which its poses are one place to a
merge."""

Pose = NDArray[np.float64]
"""(x, y, theta), metres and radians."""


def apart(a: Pose, b: Pose, at: Sequence[float]) -> tuple[float, float]:
    """Metres at a point of the map, and radians, between two poses of it."""
    (xa, ya, ta), (xb, yb, tb), (x, y) = map(float, a), map(float, b), map(float, at)
    c, s = math.cos(ta) - math.cos(tb), math.sin(ta) - math.sin(tb)
    return math.hypot(xa - xb + c * x - s * y, ya - yb + s * x + c * y), abs(se2.wrap(ta - tb))


def is_one_place(a: Pose, b: Pose, centre: Sequence[float]) -> bool:
    """Whether two poses of a map are one place to a merge. centre: of its known cells."""
    metres, radians = apart(a, b, centre)
    return metres <= ONE_PLACE[0] and radians <= ONE_PLACE[1]
