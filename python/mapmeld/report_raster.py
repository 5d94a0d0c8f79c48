"""The picture of one component: every map's walls in its colour, at its place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.palette import RGB

_OCCUPIED_FROM, _FREE_BELOW = 65, 25
_GROUND = 0.93
"""Grey of free floor."""


@dataclass(frozen=True)
class Layer:
    """A map to draw: where it lies, and in which colour."""

    grid: OccupancyGrid
    T_component_map: NDArray[np.float64]
    colour: RGB


@dataclass(frozen=True, eq=False)
class Raster:
    """A picture and where it lies. rgb: uint8 (height, width, 3), row 0 at the lowest y. extent: left, right,
    bottom, top in metres of the component's frame."""

    rgb: NDArray[np.uint8]
    extent: tuple[float, float, float, float]


def paint(merged: OccupancyGrid, layers: Sequence[Layer], pixels: int) -> Raster:
    """Floor of the merged map in grey, and over it the walls of the layers; at most `pixels` a side.

    Where walls of several maps fall on one pixel, their colours alternate from pixel to pixel, so that none
    hides another.
    """
    x, y, _ = merged.origin
    width_m, height_m = merged.width * merged.resolution, merged.height * merged.resolution
    pitch = max(merged.resolution, max(width_m, height_m) / pixels)
    width, height = math.ceil(width_m / pitch), math.ceil(height_m / pitch)

    rgb = np.full((height, width, 3), 255, dtype=np.uint8)
    rows = np.minimum(((np.arange(height) + 0.5) * pitch / merged.resolution).astype(int), merged.height - 1)
    cols = np.minimum(((np.arange(width) + 0.5) * pitch / merged.resolution).astype(int), merged.width - 1)
    cells = merged.data[np.ix_(rows, cols)]
    rgb[(cells >= 0) & (cells <= _FREE_BELOW)] = round(255 * _GROUND)

    flat = rgb.reshape(-1, 3)
    walls = [_wall_pixels(layer, (x, y), pitch, (height, width)) for layer in layers]
    sharers = np.zeros(height * width, dtype=np.uint8)
    for touched in walls:
        sharers[touched] += 1
    turn = np.add.outer(np.arange(height), np.arange(width)).ravel()
    taken = np.zeros_like(sharers)
    for layer, touched in zip(layers, walls, strict=True):
        mine = touched[turn[touched] % sharers[touched] == taken[touched]]
        flat[mine] = np.round(np.array(layer.colour) * 255).astype(np.uint8)
        taken[touched] += 1
    return Raster(rgb, (x, x + width * pitch, y, y + height * pitch))


def _wall_pixels(
    layer: Layer, corner: tuple[float, float], pitch: float, shape: tuple[int, int]
) -> NDArray[np.intp]:
    """Indices of the pixels, each once, that the occupied cells of a layer touch."""
    grid = layer.grid
    # np.nonzero of two dimensions takes five times as long.
    rows, cols = np.divmod(np.flatnonzero(grid.data >= _OCCUPIED_FROM), grid.width)
    # Carried forward, not looked up: a wall of one cell must not fall between two pixels. Several points a
    # cell, because a turned cell of a pixel's size reaches into more than one.
    k = math.ceil(1.5 * grid.resolution / pitch)
    steps = (np.arange(k) + 0.5) / k
    u = (cols[:, None, None] + steps[None, :, None]) * grid.resolution
    v = (rows[:, None, None] + steps[None, None, :]) * grid.resolution
    points = np.stack(np.broadcast_arrays(u, v), axis=-1).reshape(-1, 2)
    placed = se2.apply(se2.compose(layer.T_component_map, grid.origin), points)
    col = np.floor((placed[:, 0] - corner[0]) / pitch).astype(int)
    row = np.floor((placed[:, 1] - corner[1]) / pitch).astype(int)
    inside = (col >= 0) & (row >= 0) & (col < shape[1]) & (row < shape[0])
    hit = np.zeros(shape[0] * shape[1], dtype=bool)
    hit[row[inside] * shape[1] + col[inside]] = True
    return np.flatnonzero(hit)
