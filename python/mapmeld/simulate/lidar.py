"""A planar lidar in a rasterised world: exact ray casting, then noise and lost returns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OCCUPIED, OccupancyGrid
from mapmeld.simulate.raster import dilate

_RADII = (0, 1, 2, 4, 8, 16, 32)
"""Half sides, in cells, of the free squares that a ray may cross in one step."""
_NUDGE = 1e-6
"""Step over a cell border, in cells; keeps a ray from standing on it."""
_ALONG_AXIS = 1e-6
"""Component of a unit direction below which it counts as zero."""
_RAYS_AT_ONCE = 1 << 15


class RayCaster:
    """Casts rays among the occupied cells of a world.

    Each step takes a ray to the border of the largest known free square around its cell, so ranges are exact
    for the rasterised world and long free stretches cost few steps. Unknown cells let rays pass.
    """

    def __init__(self, world: OccupancyGrid) -> None:
        occupied = world.data == OCCUPIED
        # reach[row, col]: 0 in an occupied cell, else r + 1 if all within Chebyshev distance r is unoccupied.
        reach = np.zeros(occupied.shape, dtype=np.uint8)
        grown, at = occupied, 0
        for radius in _RADII:
            grown, at = dilate(grown, radius, start=at), radius
            reach[~grown] = radius + 1
        self._reach = reach
        self._resolution = world.resolution
        self._T_grid_world = se2.inverse(world.origin)

    def ranges(
        self, points: NDArray[np.float64], directions: NDArray[np.float64], max_range: float
    ) -> NDArray[np.float64]:
        """Distance in metres from each point to the first occupied cell; inf where none is in range.

        points: shape (n, 2), world metres. directions: shape (n,), world radians.
        """
        start = se2.apply(self._T_grid_world, points) / self._resolution
        angles = directions + self._T_grid_world[2]
        result = np.empty(len(angles))
        for k in range(0, len(angles), _RAYS_AT_ONCE):
            part = slice(k, k + _RAYS_AT_ONCE)
            result[part] = self._cast(start[part], angles[part], max_range / self._resolution)
        return result * self._resolution

    def _cast(
        self, start: NDArray[np.float64], angles: NDArray[np.float64], limit: float
    ) -> NDArray[np.float64]:
        height, width = self._reach.shape
        result = np.full(len(angles), np.inf)
        ray = np.arange(len(angles))
        u0, v0 = start[:, 0], start[:, 1]
        du, dv = np.cos(angles), np.sin(angles)
        # A direction as good as along an axis is along it: its nudges would be lost in rounding, and the ray
        # would never get over a border. Within range that moves a ray by less than a thousandth of a cell.
        du[np.abs(du) < _ALONG_AXIS] = 0.0
        dv[np.abs(dv) < _ALONG_AXIS] = 0.0
        # Finite, and yet beyond range when multiplied by the smallest distance to a border there is.
        with np.errstate(divide="ignore"):
            iu = np.where(du != 0.0, 1.0 / du, 1e300)
            iv = np.where(dv != 0.0, 1.0 / dv, 1e300)
        t = np.zeros(len(angles))
        while len(ray):
            col = np.floor(u0 + t * du).astype(np.intp)
            row = np.floor(v0 + t * dv).astype(np.intp)
            alive = (t <= limit) & (col >= 0) & (col < width) & (row >= 0) & (row < height)
            reach = np.zeros(len(ray), dtype=np.intp)
            reach[alive] = self._reach[row[alive], col[alive]]
            hit = alive & (reach == 0)
            result[ray[hit]] = np.maximum(t[hit] - _NUDGE, 0.0)
            alive &= ~hit
            ray, u0, v0, du, dv, iu, iv, t, col, row, reach = (
                a[alive] for a in (ray, u0, v0, du, dv, iu, iv, t, col, row, reach)
            )
            # The free square spans [col - reach + 1, col + reach], likewise in rows.
            exit_u = (np.where(iu > 0, col + reach, col - reach + 1) - u0) * iu
            exit_v = (np.where(iv > 0, row + reach, row - reach + 1) - v0) * iv
            t = np.maximum(np.minimum(exit_u, exit_v), t) + _NUDGE
        return result


@dataclass(frozen=True)
class Lidar:
    """A planar lidar; units and meanings as in SimulateOptions."""

    beams: int
    field_of_view: float
    max_range: float
    range_noise: float
    dropout: float

    @property
    def angles(self) -> NDArray[np.float64]:
        """Beam directions relative to the heading, shape (beams,), radians."""
        half = self.field_of_view / 2
        # Over a full turn the first and the last beam would be the same.
        full = math.isclose(self.field_of_view, 2 * math.pi)
        return np.linspace(-half, half, self.beams, endpoint=not full)

    def scan(
        self, caster: RayCaster, poses: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Measured ranges in metres, shape (scans, beams): inf has no return in range, NaN was lost.

        poses: shape (scans, 3), T_world_robot as (x, y, theta).
        """
        shape = (len(poses), self.beams)
        points = np.repeat(poses[:, :2], self.beams, axis=0)
        directions = (poses[:, 2:3] + self.angles[None, :]).ravel()
        ranges = caster.ranges(points, directions, self.max_range).reshape(shape)
        ranges = np.maximum(ranges + rng.normal(0.0, self.range_noise, shape), 0.0)
        ranges[ranges > self.max_range] = np.inf
        ranges[rng.random(shape) < self.dropout] = np.nan
        return ranges
