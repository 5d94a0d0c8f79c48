"""A floor plan under construction: floors, walls with doors, furniture; rasterised when it is complete."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapmeld.errors import ConfigError
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Rectangle = tuple[float, float, float, float]
"""(x_min, y_min, x_max, y_max) in world metres."""
Door = tuple[float, float]
"""(centre along the wall, width) in metres."""
Size = tuple[float, float]
"""(width, height) of a world in metres."""


@dataclass
class Floorplan:
    """Axis-aligned floors and solid boxes in the world frame, in metres.

    thickness: of walls; a wall is centred on the line it is given by.
    """

    thickness: float
    floors: list[Rectangle] = field(default_factory=list)
    solids: list[Rectangle] = field(default_factory=list)

    def floor(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Ground that robots can drive on, where no solid stands."""
        self.floors.append((min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))

    def solid(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A solid box: furniture, a pillar."""
        self.solids.append((min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))

    def wall_x(self, y: float, x0: float, x1: float, doors: Iterable[Door] = ()) -> None:
        """A wall along x from x0 to x1 at height y, open at the doors."""
        half = self.thickness / 2
        for start, end in _pieces(x0, x1, half, doors):
            self.solid(start, y - half, end, y + half)

    def wall_y(self, x: float, y0: float, y1: float, doors: Iterable[Door] = ()) -> None:
        """A wall along y from y0 to y1 at x, open at the doors."""
        half = self.thickness / 2
        for start, end in _pieces(y0, y1, half, doors):
            self.solid(x - half, start, x + half, end)

    def room(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A floor with closed walls on all four sides."""
        self.floor(x0, y0, x1, y1)
        for y in (y0, y1):
            self.wall_x(y, x0, x1)
        for x in (x0, x1):
            self.wall_y(x, y0, y1)

    def turned_copy(self, x: float, y: float) -> Floorplan:
        """The plan turned by 180 degrees about (x, y)."""
        turned = Floorplan(self.thickness)
        turned.floors = [(2 * x - c, 2 * y - d, 2 * x - a, 2 * y - b) for a, b, c, d in self.floors]
        turned.solids = [(2 * x - c, 2 * y - d, 2 * x - a, 2 * y - b) for a, b, c, d in self.solids]
        return turned

    def transposed(self) -> Floorplan:
        """The plan with x and y exchanged."""
        other = Floorplan(self.thickness)
        other.floors = [(b, a, d, c) for a, b, c, d in self.floors]
        other.solids = [(b, a, d, c) for a, b, c, d in self.solids]
        return other

    def add(self, other: Floorplan, dx: float = 0.0, dy: float = 0.0) -> None:
        """Adds another plan, moved by (dx, dy)."""
        self.floors += [(a + dx, b + dy, c + dx, d + dy) for a, b, c, d in other.floors]
        self.solids += [(a + dx, b + dy, c + dx, d + dy) for a, b, c, d in other.solids]

    def rasterise(self, resolution: float, name: str) -> OccupancyGrid:
        """The plan as a grid in the world frame: solids occupied, floors free, the rest unknown.

        resolution: cell side in metres; edges are rounded to it.
        """
        boxes = np.array(self.floors + self.solids)
        low = np.floor(boxes[:, :2].min(axis=0) / resolution) - 1
        high = np.ceil(boxes[:, 2:].max(axis=0) / resolution) + 1
        width, height = (int(v) for v in high - low)
        data = np.full((height, width), UNKNOWN, dtype=np.int8)
        for rectangles, value in ((self.floors, FREE), (self.solids, OCCUPIED)):
            for rectangle in rectangles:
                _fill(data, np.array(rectangle) / resolution - np.tile(low, 2), value)
        return OccupancyGrid(data, resolution, (low[0] * resolution, low[1] * resolution, 0.0), name)


def chosen_size(size: Size | None, default: Size, least: Size, what: str) -> Size:
    """The size asked for, or the default. Raises ConfigError for one that is too small for `what`."""
    if size is None:
        return default
    if size[0] < least[0] or size[1] < least[1]:
        raise ConfigError(f"size: {what} needs at least {least[0]:g} x {least[1]:g} m, got {size}")
    return size


def _fill(data: NDArray[np.int8], box: NDArray[np.float64], value: int) -> None:
    """Sets the cells of a box given in cell units; a box thinner than a cell still fills one."""
    c0, r0, c1, r1 = (math.floor(v + 0.5) for v in box)
    data[r0 : max(r1, r0 + 1), c0 : max(c1, c0 + 1)] = value


def _pieces(start: float, end: float, half: float, doors: Iterable[Door]) -> list[tuple[float, float]]:
    """The solid stretches of a wall; its ends reach half a thickness further, so that corners close."""
    pieces = []
    at = start - half
    for centre, width in sorted(doors):
        if centre - width / 2 > at:
            pieces.append((at, centre - width / 2))
        at = max(at, centre + width / 2)
    if end + half > at:
        pieces.append((at, end + half))
    return pieces
