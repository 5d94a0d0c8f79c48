"""The picture of `mapmeld inspect`: what the merge sees in one map."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np

from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.map_features import MapFeatures

_DPI = 110
_FREE_UP_TO, _OCCUPIED_FROM = 25, 65
_FREE, _OCCUPIED, _UNKNOWN = (255, 255, 255), (30, 30, 30), (205, 205, 205)
_LINE, _NORMAL, _INNER, _OUTER = "#0072b2", "#999999", "#d55e00", "#009e73"
_MOST_NORMALS = 600
_MOST_ANGLES = 30
"""Corners, best first, whose angle is written beside them; more would hide the map."""


def render_inspection(grid: OccupancyGrid, seen: MapFeatures) -> bytes:
    """A PNG, axes in metres of the map frame: classes of cells, normals of some boundary points, lines, and
    corners with their arms and the opening angle as a sector on the side of free space (inner corners of a
    room in one colour, outer ones in another)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = _view(grid)
    aspect = float((high[1] - low[1]) / (high[0] - low[0]))
    figure = Figure(figsize=(8.0, min(max(7.2 * aspect, 2.5), 11.0) + 1.1), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw_cells(axes, grid, seen)
    _draw_walls(axes, seen)
    _draw_corners(axes, seen, 0.03 * float((high - low).max()))
    axes.set(
        xlim=(low[0], high[0]),
        ylim=(low[1], high[1]),
        aspect="equal",
        facecolor=str(_UNKNOWN[0] / 255),
        xlabel="x [m]",
        ylabel="y [m]",
    )
    axes.tick_params(labelsize=8)
    name = seen.name.replace("$", r"\$")
    counts = f"{len(seen.boundary.position)} boundary points, {len(seen.lines.start)} lines, "
    axes.set_title(f"{name}: {counts}{len(seen.corners.vertex)} corners", fontsize=10, pad=8)
    _draw_legend(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    return buffer.getvalue()


def _view(grid: OccupancyGrid) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Lowest and highest x and y to show, metres: those of the known cells and a margin, or of all cells."""
    rows, cols = np.nonzero(grid.data != UNKNOWN)
    if rows.size == 0:
        rows, cols = np.array([0, 0, grid.height - 1, grid.height - 1]), np.array([0, grid.width - 1] * 2)
    points = grid.cell_centers(rows, cols)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * (high - low).max() + 2 * grid.resolution
    return low - margin, high + margin


def _draw_cells(axes: Any, grid: OccupancyGrid, seen: MapFeatures) -> None:
    from matplotlib.transforms import Affine2D

    rgb = np.full((*grid.data.shape, 3), _UNKNOWN, dtype=np.uint8)
    rgb[(grid.data >= 0) & (grid.data <= _FREE_UP_TO)] = _FREE
    rgb[grid.data >= _OCCUPIED_FROM] = _OCCUPIED
    x, y, theta = grid.origin
    placed = Affine2D().rotate(theta).translate(x, y) + axes.transData
    extent = (0, seen.extent[0], 0, seen.extent[1])
    axes.imshow(rgb, origin="lower", extent=extent, transform=placed, interpolation="nearest")


def _draw_walls(axes: Any, seen: MapFeatures) -> None:
    from matplotlib.collections import LineCollection

    step = max(1, math.ceil(len(seen.boundary.position) / _MOST_NORMALS))
    foot = seen.boundary.position[::step]
    tip = foot + seen.boundary.normal[::step] * 4 * seen.resolution
    axes.add_collection(LineCollection(list(np.stack([foot, tip], axis=1)), colors=_NORMAL, linewidths=0.5))
    ends = np.stack([seen.lines.start, seen.lines.end], axis=1)
    axes.add_collection(LineCollection(list(ends), colors=_LINE, linewidths=1.6))


def _draw_corners(axes: Any, seen: MapFeatures, largest: float) -> None:
    from matplotlib.patches import Wedge

    c = seen.corners
    for i, (vertex, opening) in enumerate(zip(c.vertex, c.opening.tolist(), strict=True)):
        colour = _INNER if opening < math.pi else _OUTER
        radius = min(largest, 0.7 * float(c.lengths[i].min()))
        start = math.atan2(c.arm0[i, 1], c.arm0[i, 0])
        axes.add_patch(
            Wedge(
                vertex,
                radius,
                math.degrees(start),
                math.degrees(start + opening),
                facecolor=(*_rgb(colour), 0.35),
                edgecolor=colour,
                linewidth=0.8,
                zorder=4,
            )
        )
        for arm, length in zip((c.arm0[i], c.arm1[i]), c.lengths[i].tolist(), strict=True):
            end = vertex + arm * min(length, 2 * largest)
            axes.plot([vertex[0], end[0]], [vertex[1], end[1]], color=colour, linewidth=2.2, zorder=5)
        if i < _MOST_ANGLES:
            middle = start + opening / 2
            text = vertex + (radius + 0.5 * largest) * np.array([math.cos(middle), math.sin(middle)])
            axes.text(
                *text,
                f"{math.degrees(opening):.0f}\N{DEGREE SIGN}",
                fontsize=7,
                ha="center",
                va="center",
                color=colour,
                zorder=6,
                clip_on=True,
            )


def _rgb(colour: str) -> tuple[float, float, float]:
    r, g, b = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b


def _draw_legend(figure: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def patch(colour: tuple[int, int, int], label: str) -> Patch:
        r, g, b = (v / 255 for v in colour)
        return Patch(facecolor=(r, g, b), edgecolor="0.5", label=label)

    handles = [
        patch(_FREE, "free"),
        patch(_OCCUPIED, "occupied"),
        patch(_UNKNOWN, "unknown"),
        Line2D([], [], color=_NORMAL, linewidth=1, label="wall normals"),
        Line2D([], [], color=_LINE, linewidth=2, label="lines"),
        Patch(facecolor=_INNER, label="inner corners"),
        Patch(facecolor=_OUTER, label="outer corners"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=8, frameon=False)
