"""Where maps lie on the bench: parts that do not belong together side by side, so that none hides another."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.result import MergeResult

Pose = tuple[float, float, float]
Box = tuple[float, float, float, float]
"""Left, bottom, right, top, metres."""

_GAP = 2.0
"""Between parts, metres."""


def as_pose(T: Sequence[float] | NDArray[np.float64]) -> Pose:
    """Three plain numbers."""
    x, y, theta = (float(v) for v in T)
    return x, y, theta


def known_box(grid: OccupancyGrid) -> Box:
    """The box of a map's known cells in grid coordinates, metres from its lower left corner; the whole grid
    where nothing is known."""
    rows, cols = np.nonzero(grid.data >= 0)
    if not len(rows):
        return 0.0, 0.0, grid.width * grid.resolution, grid.height * grid.resolution
    r = grid.resolution
    return cols.min() * r, rows.min() * r, (cols.max() + 1) * r, (rows.max() + 1) * r


def box_of(poses: Mapping[str, Pose], grids: Mapping[str, OccupancyGrid], boxes: Mapping[str, Box]) -> Box:
    """The box of some maps' known cells on the bench."""
    corners = []
    for name, T in poses.items():
        left, bottom, right, top = boxes[name]
        square = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
        corners.append(se2.apply(se2.compose(T, grids[name].origin), square))
    every = np.concatenate(corners)
    (left, bottom), (right, top) = every.min(axis=0).tolist(), every.max(axis=0).tolist()
    return left, bottom, right, top


def most_shared(
    name: str,
    others: Mapping[str, Pose],
    poses: Mapping[str, Pose],
    grids: Mapping[str, OccupancyGrid],
    boxes: Mapping[str, Box],
) -> str | None:
    """Which of the others lies most under a map, by the boxes of their known cells; None: none does."""
    own = box_of({name: poses[name]}, grids, boxes)
    best, most = None, 0.0
    for n, T in others.items():
        box = box_of({n: T}, grids, boxes)
        width, height = min(own[2], box[2]) - max(own[0], box[0]), min(own[3], box[3]) - max(own[1], box[1])
        if width > 0 and height > 0 and width * height > most:
            best, most = n, width * height
    return best


def unsolved(grids: Mapping[str, OccupancyGrid], boxes: Mapping[str, Box]) -> dict[str, Pose]:
    """Every map as it is, in rows."""
    return _side_by_side([{n: (0.0, 0.0, 0.0)} for n in grids], grids, boxes, None)


def solved(
    result: MergeResult,
    before: Mapping[str, Pose],
    grids: Mapping[str, OccupancyGrid],
    boxes: Mapping[str, Box],
    is_first: bool,
) -> dict[str, Pose]:
    """The components of a result: that in the world of pins as it is, or else the first where its reference
    map was before; the others beside it, each in its own frame."""
    parts: list[dict[str, Pose]] = []
    fixed: dict[str, Pose] = {}
    for k, c in enumerate(result.components):
        placed = [m for m in result.maps if m.component == k]
        poses = {m.name: m.T_component_map for m in placed if m.T_component_map is not None}
        part = {n: as_pose(T) for n, T in poses.items()} or {m.name: (0.0, 0.0, 0.0) for m in placed}
        if c.in_world:
            fixed = part
        else:
            parts.append(part)
    if not fixed and parts:
        first = parts.pop(0)
        lead = next(iter(first))
        into = se2.compose(before[lead], se2.inverse(first[lead])) if not is_first else np.zeros(3)
        fixed = {n: as_pose(se2.compose(into, T)) for n, T in first.items()}
    return fixed | _side_by_side(parts, grids, boxes, box_of(fixed, grids, boxes) if fixed else None)


def _side_by_side(
    parts: Sequence[dict[str, Pose]],
    grids: Mapping[str, OccupancyGrid],
    boxes: Mapping[str, Box],
    taken: Box | None,
) -> dict[str, Pose]:
    """Parts in rows about as wide as high, right of what is taken."""
    out: dict[str, Pose] = {}
    sizes = [box_of(p, grids, boxes) for p in parts]
    area = sum((r - le + _GAP) * (t - b + _GAP) for le, b, r, t in sizes)
    x0, y = (0.0, 0.0) if taken is None else (taken[2] + _GAP, taken[3])
    width = max([1.4 * math.sqrt(area), *(r - le for le, _, r, _ in sizes)])
    x, row = x0, 0.0
    for part, (left, bottom, right, top) in zip(parts, sizes, strict=True):
        if x > x0 and x + right - left > x0 + width:
            x, y, row = x0, y - row - _GAP, 0.0
        shift = (x - left, y - top)
        out |= {n: (T[0] + shift[0], T[1] + shift[1], T[2]) for n, T in part.items()}
        x += right - left + _GAP
        row = max(row, top - bottom)
    return out
