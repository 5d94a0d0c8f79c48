"""What the figures share: colours, maps, robots, captions, files."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.figures.study import Pose
from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.palette import RGB, map_colour
from mapmeld.report_raster import Layer, paint

INK = "0.15"
"""Text and outlines."""
FIRST, SECOND = map_colour(0), map_colour(1)
"""The two colours (blue, vermilion) of figures that tell two things apart."""
GREY: RGB = (0.45, 0.45, 0.45)
"""Walls that are background."""

_DPI = 130
_FREE_UP_TO = 25
_CAPTION_POINTS, _NOTE_POINTS = 9.0, 8.5
_FORMULA = re.compile(r"\$[^$]*\$")
View = tuple[float, float, float, float]
"""Left, right, bottom, top, metres."""


def new_figure(width: float, height: float, caption: str) -> Any:
    """An empty figure, inches, with its caption (formulas between $) below the room left to the panels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    text = _wrapped(caption, width - 0.4)
    room = ((text.count("\n") + 1) * 1.32 * _CAPTION_POINTS + 10) / 72
    share, top = room / (height + room), 0.06 / (height + room)
    layout = ConstrainedLayoutEngine(rect=(0.005, share, 0.99, 1 - share - top))
    figure = Figure(figsize=(width, height + room), dpi=_DPI, layout=layout)
    FigureCanvasAgg(figure)
    figure.text(
        0.2 / width,
        share - 2 / 72 / (height + room),
        text,
        va="top",
        fontsize=_CAPTION_POINTS,
        color=INK,
        linespacing=1.32,
    )
    return figure


def _settle(figure: Any) -> None:
    """Lays the panels out once and for all, at places rounded far below a pixel: the solver of the layout
    leaves rounding errors that differ from run to run, and SVG files name things after them."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if not isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
        return
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        axes.set_position(np.round(axes.get_position(original=True).bounds, 6))


def _wrapped(caption: str, width: float) -> str:
    """The caption in lines of at most `width` inches."""
    # A formula counts as one letter: to the wrapping it is one, of the alphabet's private part.
    formulas = _FORMULA.findall(caption)
    parts = _FORMULA.split(caption)
    hidden = parts[0] + "".join(chr(0xE000 + i) + part for i, part in enumerate(parts[1:]))
    # A letter of this font is half as wide as high, on average.
    text = textwrap.fill(hidden, int(width * 72 / (0.54 * _CAPTION_POINTS)))
    for i, formula in enumerate(formulas):
        text = text.replace(chr(0xE000 + i), formula)
    return text


def render(figure: Any, kind: str) -> bytes:
    """The figure as a "png" or "svg", the same bytes for the same data."""
    import matplotlib

    _settle(figure)
    buffer = io.BytesIO()
    if kind == "svg":
        with matplotlib.rc_context({"svg.hashsalt": "mapmeld"}):
            figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    else:
        figure.savefig(buffer, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 6})
    return buffer.getvalue()


def draw_maps(
    axes: Any, layers: Sequence[Layer], pixels: int = 320, floor: OccupancyGrid | None = None
) -> View:
    """Draws placed maps: their floor in grey, each one's walls in its colour. Answers what they cover.

    floor: the map whose free cells are the floor; None: those of all layers.
    """
    raster = paint(_floor(layers) if floor is None else floor, layers, pixels)
    axes.imshow(raster.rgb, origin="lower", extent=raster.extent, interpolation="nearest", zorder=0)
    axes.set(aspect="equal", facecolor="white")
    return raster.extent


def dress(axes: Any, view: View, title: str, *, ticks: bool = True, points: float = 10) -> None:
    """Limits, title and quiet frame of a panel whose axes are metres."""
    axes.set(xlim=view[:2], ylim=view[2:])
    axes.set_title(title, fontsize=points, color=INK)
    for spine in axes.spines.values():
        spine.set_color("0.7")
    if ticks:
        axes.tick_params(labelsize=8, colors=INK, length=3)
        axes.set_xlabel("x [m]", fontsize=8, color=INK, labelpad=1)
        axes.set_ylabel("y [m]", fontsize=8, color=INK, labelpad=1)
        axes.locator_params(nbins=6)
    else:
        axes.set(xticks=[], yticks=[])


def around(view: View, points: NDArray[np.float64], pad: float) -> View:
    """The view, widened so that the points (n, 2) lie inside by `pad` metres."""
    low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
    return (
        min(view[0], float(low[0])),
        max(view[1], float(high[0])),
        min(view[2], float(low[1])),
        max(view[3], float(high[1])),
    )


def square(view: View, side: float) -> View:
    """A square of `side` metres about the middle of the view."""
    x, y = (view[0] + view[1]) / 2, (view[2] + view[3]) / 2
    return (x - side / 2, x + side / 2, y - side / 2, y + side / 2)


def draw_robot(axes: Any, pose: Pose, size: float, face: Any, edge: Any = "white", **style: Any) -> None:
    """A robot at (x, y), its nose towards theta, about `size` metres long."""
    from matplotlib.patches import Polygon

    outline = size * np.array([[0.6, 0.0], [-0.4, 0.36], [-0.2, 0.0], [-0.4, -0.36]])
    style = {"linewidth": 0.8, "zorder": 6, **style}
    axes.add_patch(Polygon(se2.apply(pose, outline), facecolor=face, edgecolor=edge, **style))


def draw_index(axes: Any, x: float, y: float, text: str, colour: Any, points: float = 8) -> None:
    """A number in a ring, as figure 4 of the paper marks local origins."""
    rim = {"boxstyle": "circle,pad=0.22", "facecolor": "white", "edgecolor": colour, "linewidth": 1.6}
    axes.text(
        x,
        y,
        text,
        ha="center",
        va="center",
        fontsize=points,
        fontweight="bold",
        color=INK,
        bbox=rim,
        zorder=8,
    )


def draw_arrow(
    axes: Any, start: NDArray[np.float64], end: NDArray[np.float64], colour: Any, **style: Any
) -> None:
    """An arrow between two points."""
    arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.8, "mutation_scale": 14, **style}
    axes.annotate("", xy=(end[0], end[1]), xytext=(start[0], start[1]), arrowprops=arrow, zorder=7)


def draw_note(
    axes: Any,
    at: NDArray[np.float64],
    text: str,
    colour: Any,
    *,
    avoid: NDArray[np.float64],
    inches: float,
    edge: bool = False,
) -> None:
    """A short text beside a point: below, above or to a side, where the points `avoid` (n, 2) and the panel's
    edge leave the most room. The panel, about `inches` wide and high, must have its limits."""
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    point = max(right - left, top - bottom) / (72 * inches)
    # Half the width and height of the text in its box, and the room that the robot at the point takes.
    half = np.array([0.36 * _NOTE_POINTS * len(text) + 4, 0.6 * _NOTE_POINTS + 4]) * point
    beside = half + 10 * point
    best, most = np.array(at[:2]), -np.inf
    for direction in ((0, -1), (0, 1), (1, 0), (-1, 0)):
        middle = np.array(at[:2]) + beside * direction
        to_points = (np.abs(avoid[:, :2] - middle) - half).max(axis=1).min()
        to_edges = min((middle - half - (left, bottom)).min(), ((right, top) - middle - half).min())
        room = min(to_points, to_edges, 12 * point)
        if room > most + 1e-9:
            best, most = middle, room
    style = {
        "boxstyle": "round,pad=0.15",
        "facecolor": "white",
        "edgecolor": colour if edge else "none",
        "linewidth": 0.8,
        "alpha": 0.9,
    }
    axes.text(
        best[0],
        best[1],
        text,
        ha="center",
        va="center",
        fontsize=_NOTE_POINTS,
        fontweight="bold",
        color=colour,
        bbox=style,
        zorder=9,
    )


def along(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points on the way from start to end, for draw_note to avoid: shape (n, 2)."""
    shares = np.linspace(0, 1, 30)[:, None]
    return np.asarray(start[:2] + shares * (end[:2] - start[:2]), dtype=np.float64)


def _floor(layers: Sequence[Layer]) -> OccupancyGrid:
    """A grid as large as all known cells of the layers, free where one of them is free, else unknown."""
    resolution = min(layer.grid.resolution for layer in layers)
    known, free = [], []
    for layer in layers:
        data = layer.grid.data
        known.append(_placed(layer, data != UNKNOWN, 1))
        free.append(_placed(layer, (data >= 0) & (data <= _FREE_UP_TO), 2))
    points = np.concatenate(known)
    low = points.min(axis=0) - 2 * resolution
    width, height = np.ceil((points.max(axis=0) + 2 * resolution - low) / resolution).astype(int)
    data = np.full((height, width), UNKNOWN, dtype=np.int8)
    col, row = np.floor((np.concatenate(free) - low) / resolution).astype(int).T
    data[row, col] = 0
    return OccupancyGrid(data, resolution, (float(low[0]), float(low[1]), 0.0), "floor")


def _placed(layer: Layer, chosen: NDArray[np.bool_], steps: int) -> NDArray[np.float64]:
    """steps x steps points in each of the chosen cells, in the frame of the picture."""
    grid = layer.grid
    rows, cols = np.nonzero(chosen)
    part = (np.arange(steps) + 0.5) / steps
    u = np.broadcast_to(cols[:, None, None] + part[None, :, None], (rows.size, steps, steps))
    v = np.broadcast_to(rows[:, None, None] + part[None, None, :], (rows.size, steps, steps))
    points = np.stack([u, v], axis=-1).reshape(-1, 2) * grid.resolution
    return se2.apply(se2.compose(layer.T_component_map, grid.origin), points)
