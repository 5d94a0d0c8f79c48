"""The occupancy grid: what one robot knows of the world, in a frame of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapmeld.errors import MapmeldError

UNKNOWN = -1
"""Cell value of a cell that nobody has seen."""
FREE = 0
"""Cell value of a cell that is surely free."""
OCCUPIED = 100
"""Cell value of a cell that is surely occupied."""
_MOST_ORIGIN_M = 1e8
"""How far an origin may lie from its map frame, metres: beyond it, cells of a few centimetres get lost in the
rounding of their coordinates. The core has the same bound."""
_MOST_RESOLUTION_M = 10.0
"""Largest side of a cell, metres. The core has the same bound."""


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A 2D occupancy grid as nav_msgs/OccupancyGrid defines it.

    data: shape (height, width), int8, values -1 (unknown) or 0 to 100 (occupancy in percent).
        Row 0 is the row of the lowest y in the grid's own axes, so data[row, col] is the cell whose lower
        left corner lies at (col * resolution, row * resolution) from the origin. The array is copied and
        made read-only.
    resolution: side of a cell in metres.
    origin: (x, y, theta) in metres and radians: the pose of the lower left corner of cell (0, 0) in the
        map frame. Map coordinates everywhere mean this frame.
    name: what results call this map; a map read from a file has the file's stem.

    Raises MapmeldError for an array of another shape or range, for a resolution or origin that is not finite
    or not positive, and for an origin farther than 1e8 m from the map frame.
    """

    data: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    name: str = ""

    def __init__(
        self,
        data: ArrayLike,
        resolution: float,
        origin: tuple[float, float, float] | list[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        name: str = "",
    ) -> None:
        label = f"map {name!r}" if name else "map"
        array = np.asarray(data)
        if array.ndim != 2:
            raise MapmeldError(f"{label}: data must have two dimensions (height, width), got {array.ndim}")
        if array.size == 0:
            raise MapmeldError(f"{label}: data has no cells (shape {array.shape})")
        if array.dtype.kind not in "iu":
            raise MapmeldError(
                f"{label}: data must hold integers (-1 unknown, 0 to 100 percent), got dtype {array.dtype}"
            )
        if int(array.min()) < -1 or int(array.max()) > 100:
            raise MapmeldError(
                f"{label}: data must lie in -1..100, found {int(array.min())}..{int(array.max())}"
            )
        resolution = float(resolution)
        if not math.isfinite(resolution) or resolution <= 0:
            raise MapmeldError(f"{label}: resolution must be a positive number of metres, got {resolution}")
        if resolution > _MOST_RESOLUTION_M:
            raise MapmeldError(
                f"{label}: resolution must be at most {_MOST_RESOLUTION_M:g} m a cell, got {resolution}; "
                "is it in metres?"
            )
        pose = tuple(float(v) for v in origin)
        if len(pose) != 3 or not all(math.isfinite(v) for v in pose):
            raise MapmeldError(f"{label}: origin must be three finite numbers (x, y, theta), got {pose}")
        if max(abs(pose[0]), abs(pose[1])) > _MOST_ORIGIN_M:
            raise MapmeldError(
                f"{label}: origin must lie within {_MOST_ORIGIN_M:g} m of the map frame, got {pose}; "
                "move the frame"
            )
        cells = np.array(array, dtype=np.int8, order="C", copy=True)
        cells.setflags(write=False)
        object.__setattr__(self, "data", cells)
        object.__setattr__(self, "resolution", resolution)
        object.__setattr__(self, "origin", pose)
        object.__setattr__(self, "name", name)

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.data.shape[0])

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.data.shape[1])

    def cell_centers(self, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> NDArray[np.float64]:
        """Map coordinates in metres, shape (n, 2), of the centres of the cells (rows, cols)."""
        x, y, theta = self.origin
        u = (np.asarray(cols) + 0.5) * self.resolution
        v = (np.asarray(rows) + 0.5) * self.resolution
        c, s = math.cos(theta), math.sin(theta)
        return np.stack([x + c * u - s * v, y + s * u + c * v], axis=-1)

    def __repr__(self) -> str:
        return (
            f"OccupancyGrid({self.name!r}, {self.width} x {self.height} cells of {self.resolution:g} m, "
            f"origin {self.origin})"
        )
