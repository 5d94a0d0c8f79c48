"""From scans to a map: log-odds ray tracing directly in the map's own frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

_LOG_ODDS_HIT = 0.9
_LOG_ODDS_MISS = -0.4
_LOG_ODDS_LIMIT = 5.0
_OCCUPIED_ABOVE = 0.6
_FREE_BELOW = -0.7


def trace_map(
    poses: NDArray[np.float64],
    ranges: NDArray[np.float64],
    angles: NDArray[np.float64],
    max_range: float,
    resolution: float,
    *,
    name: str,
    axes_yaw: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
    margin: float = 0.5,
) -> OccupancyGrid:
    """Draws one robot's occupancy grid, with the classes free, occupied and unknown.

    In a scan a cell counts once: as hit if any beam ends in it, else as missed if any beam crosses it.

    poses: shape (scans, 3), T_map_robot as (x, y, theta) in metres and radians.
    ranges: shape (scans, beams), metres; inf clears its way up to max_range, NaN says nothing.
    angles: shape (beams,), beam directions relative to the heading, radians.
    resolution: cell side in metres.
    axes_yaw: yaw of the grid's axes in the map frame, radians.
    offset: shift of the cell lattice in cells, 0 to 1 in each direction.
    margin: unknown border around the known area in metres.

    Raises MapmeldError if the scans show nothing.
    """
    poses = _turned(poses, axes_yaw)
    hit = np.isfinite(ranges)
    lengths = np.where(np.isinf(ranges), max_range, ranges)
    directions = poses[:, 2:3] + angles[None, :]
    units = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    ends = poses[:, None, :2] + lengths[..., None] * units
    everything = np.concatenate([poses[:, :2], ends[np.isfinite(lengths)]])
    low = everything.min(axis=0) - margin - resolution * (1.0 + np.array(offset))
    high = everything.max(axis=0) + margin + resolution
    width, height = (int(v) for v in np.ceil((high - low) / resolution))

    log_odds = np.zeros(height * width)
    starts = (poses[:, :2] - low) / resolution
    ends = (ends - low) / resolution
    for start, end, was_hit, known in zip(starts, ends, hit, np.isfinite(lengths), strict=True):
        _update(log_odds, width, start, end[known], was_hit[known])
    grid = log_odds.reshape(height, width)
    data = np.full(grid.shape, UNKNOWN, dtype=np.int8)
    data[grid < _FREE_BELOW] = FREE
    data[grid > _OCCUPIED_ABOVE] = OCCUPIED
    rows, cols = np.nonzero(data != UNKNOWN)
    if not len(rows):
        raise MapmeldError(f"map {name!r}: the scans show nothing; raise path_length or max_range")
    border = round(margin / resolution)
    row0, col0 = max(0, int(rows.min()) - border), max(0, int(cols.min()) - border)
    data = data[row0 : int(rows.max()) + border + 1, col0 : int(cols.max()) + border + 1]
    corner = se2.apply((0.0, 0.0, axes_yaw), low + resolution * np.array([col0, row0]))
    return OccupancyGrid(data, resolution, (float(corner[0]), float(corner[1]), axes_yaw), name)


def _turned(poses: NDArray[np.float64], axes_yaw: float) -> NDArray[np.float64]:
    """The poses in the grid's axes, with the map's origin."""
    points = se2.apply((0.0, 0.0, -axes_yaw), poses[:, :2])
    return np.column_stack([points, poses[:, 2] - axes_yaw])


def _update(
    log_odds: NDArray[np.float64],
    width: int,
    start: NDArray[np.float64],
    ends: NDArray[np.float64],
    hit: NDArray[np.bool_],
) -> None:
    """Adds one scan; start, shape (2,), and ends, shape (n, 2), in cells."""
    if not len(ends):
        return
    delta = ends - start
    # One sample for each cell along the longer axis, from the robot's cell to the one before the end.
    counts = np.maximum(np.abs(np.floor(ends) - np.floor(start)).max(axis=1), 1.0)
    samples = counts.astype(np.intp)
    beam = np.repeat(np.arange(len(ends)), samples)
    step = np.arange(len(beam)) - np.repeat(np.cumsum(samples) - samples, samples)
    along = step / counts[beam]
    cols = (start[0] + along * delta[beam, 0]).astype(np.intp)
    rows = (start[1] + along * delta[beam, 1]).astype(np.intp)
    missed = rows * width + cols
    hits = ends[hit].astype(np.intp)
    hits = hits[:, 1] * width + hits[:, 0]
    # Fancy indexing writes a repeated cell once, which is the rule that a scan counts once for a cell.
    with_hit = np.minimum(log_odds[hits] + _LOG_ODDS_HIT, _LOG_ODDS_LIMIT)
    log_odds[missed] = np.maximum(log_odds[missed] + _LOG_ODDS_MISS, -_LOG_ODDS_LIMIT)
    log_odds[hits] = with_hit
