"""Small pictures of grids: palette PNGs as data addresses, for a page that needs no other file."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld.grid import OccupancyGrid
from mapmeld.palette import RGB, map_colour

OCCUPIED_FROM, FREE_BELOW = 65, 25
CLEAR = (0, 0, 0, 0)

RGBA = tuple[int, int, int, int]


@dataclass(frozen=True)
class Picture:
    """A picture of a grid. address: data:image/png, row 0 at the top. width, height: metres; its lower left
    corner is the grid's."""

    address: str
    width: float
    height: float


def colour_bytes(colour: RGB, alpha: float = 1.0) -> RGBA:
    """A colour for a palette."""
    r, g, b = (round(255 * c) for c in colour)
    return r, g, b, round(255 * alpha)


def classes(grid: OccupancyGrid, most: int) -> tuple[NDArray[np.uint8], float]:
    """0 unknown, 1 free, 2 occupied, with at most `most` pixels a side; and the pixel's side in metres.

    Several cells on one pixel: a wall among them wins, so that walls of one cell stay visible.
    """
    cells = np.zeros(grid.data.shape, dtype=np.uint8)
    cells[(grid.data >= 0) & (grid.data <= FREE_BELOW)] = 1
    cells[grid.data >= OCCUPIED_FROM] = 2
    return shrunk(cells, most), grid.resolution * shrink(grid, most)


def shrink(grid: OccupancyGrid, most: int) -> int:
    """How many cells, a side, share a pixel."""
    return max(1, math.ceil(max(grid.width, grid.height) / most))


def shrunk(cells: NDArray[np.uint8], most: int) -> NDArray[np.uint8]:
    """The largest value of each block of cells, with at most `most` blocks a side."""
    k = max(1, math.ceil(max(cells.shape) / most))
    if k == 1:
        return cells
    height, width = (math.ceil(side / k) for side in cells.shape)
    padded = np.zeros((height * k, width * k), dtype=np.uint8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(height, k, width, k).max(axis=(1, 3)))


def picture(cells: NDArray[np.uint8], pixel: float, palette: list[RGBA]) -> Picture:
    """cells: indices into the palette, row 0 at the lowest y. pixel: its side in metres."""
    from PIL import Image

    height, width = cells.shape
    image = Image.frombytes("P", (width, height), np.ascontiguousarray(cells[::-1]).tobytes())
    image.putpalette([channel for colour in palette for channel in colour[:3]])
    content = io.BytesIO()
    image.save(
        content,
        format="PNG",
        transparency=bytes(colour[3] for colour in palette),
        bits=next(b for b in (1, 2, 4, 8) if len(palette) <= 1 << b),
        compress_level=9,
    )
    address = "data:image/png;base64," + base64.b64encode(content.getvalue()).decode("ascii")
    return Picture(address, width * pixel, height * pixel)


def of_map(grid: OccupancyGrid, index: int, most: int) -> Picture:
    """A map in its colour: walls full, free floor so faint that many maps on each other stay bright."""
    cells, pixel = classes(grid, most)
    colour = map_colour(index)
    return picture(cells, pixel, [CLEAR, colour_bytes(colour, 0.07), colour_bytes(colour)])
