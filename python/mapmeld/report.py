"""report.png: each map in its own colour at its place, as in the paper's figure 4."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mapmeld.grid import OccupancyGrid
from mapmeld.palette import map_colour
from mapmeld.report_raster import Layer, paint
from mapmeld.result import MergeResult

_DPI = 110
_WIDTH = 8.0
"""Of the picture, inches."""
_ARROW = " \N{RIGHTWARDS ARROW} "
_MOST_PANELS = 13
"""Components that get a panel; the rest are named in the legend only."""
_FAR = 0.25
"""An origin farther outside its component than this share of the component's size is not walked to: its
number stays at the edge, with an arrow towards it."""
_PIXELS, _SMALL_PIXELS = 450, 200
"""Longest side of a panel's picture. Less than the screen shows, so that walls of one cell stay visible."""
_MOST_KNOWN = 8
"""Lines about what was known; the rest is in result.json."""
_INK = "0.15"


@dataclass(frozen=True, eq=False)
class _Panel:
    """A component to draw. members: indices of its maps in merge order; origins: (n, 2), where their local
    frames begin; near: which of these lie in the view (left, right, bottom, top); pad: room that an index
    takes, all in metres."""

    component: int
    merged: OccupancyGrid
    members: list[int]
    origins: np.ndarray[Any, np.dtype[np.float64]]
    near: list[bool]
    view: tuple[float, float, float, float]
    pad: float
    is_large: bool


def draw_report(path: str | Path, result: MergeResult, maps: Sequence[OccupancyGrid]) -> None:
    """Draws the picture of a merge into a PNG file.

    maps: those that were merged, in the same order. A panel a component, axes in metres of its frame: free
    floor in grey, walls in each map's colour, and the map's index (its position in `maps`, from 0) at the
    origin of its local frame; an index with an arrow stands at the panel's edge, its origin farther out.
    The titles tell the merge order. Raises OSError when the file cannot be written.
    """
    # Matplotlib takes longer to import than many a merge; pyplot would look for a screen besides.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = _panels(result)
    figure = Figure(figsize=_size(panels, result), dpi=_DPI)
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.12)
    FigureCanvasAgg(figure)
    for axes, panel in zip(_axes(figure, panels), panels, strict=True):
        _draw_panel(axes, panel, result, maps)
    if not panels:
        figure.text(0.5, 0.6, "No map holds a known cell.", ha="center", fontsize=13, color=_INK)
    _draw_legend(figure, result)
    figure.savefig(path, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 3})


def _panels(result: MergeResult) -> list[_Panel]:
    index = {m.name: i for i, m in enumerate(result.maps)}
    shown = [k for k, c in enumerate(result.components) if c.merged is not None][:_MOST_PANELS]
    panels = []
    for k in shown:
        component = result.components[k]
        assert component.merged is not None
        members = [index[name] for name in component.order]
        poses = [result.maps[i].T_component_map for i in members]
        origins = np.array([T[:2] for T in poses if T is not None])
        is_large = len(shown) == 1 or (k == 0 and len(members) > 1)
        panels.append(_panel(k, component.merged, members, origins, is_large))
    return panels


def _panel(
    k: int,
    merged: OccupancyGrid,
    members: list[int],
    origins: np.ndarray[Any, np.dtype[np.float64]],
    is_large: bool,
) -> _Panel:
    low = np.array(merged.origin[:2])
    high = low + np.array([merged.width, merged.height]) * merged.resolution
    size = float((high - low).max())
    inside = ((origins >= low - _FAR * size) & (origins <= high + _FAR * size)).all(axis=1)
    near: list[bool] = np.asarray(inside).tolist()
    pad = (0.035 if is_large else 0.07) * size
    for point in origins[near]:
        low, high = np.minimum(low, point - pad), np.maximum(high, point + pad)
    view = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    return _Panel(k, merged, members, origins, near, view, pad, is_large)


def _size(panels: list[_Panel], result: MergeResult) -> tuple[float, float]:
    """Width and height in inches: a lone panel's shape decides, within reason."""
    height = 0.8 * _WIDTH
    if len(panels) == 1:
        left, right, bottom, top = panels[0].view
        height = min(max((_WIDTH - 0.8) * (top - bottom) / (right - left), 2.5), 11.0) + 0.8
    elif panels and not panels[0].is_large:
        height = _WIDTH * math.ceil(len(panels) / _columns(len(panels))) / _columns(len(panels))
    elif not panels:
        height = 2.0
    return _WIDTH, height + 0.19 * math.ceil(len(result.maps) / _legend_columns(result)) + 0.2 + 0.16 * len(
        _known_lines(result)
    )


def _columns(panels: int) -> int:
    return math.ceil(math.sqrt(panels))


def _axes(figure: Any, panels: list[_Panel]) -> list[Any]:
    """Axes for each panel: large ones for a first component of several maps, the rest in a grid."""
    n = len(panels)
    if n == 0:
        return []
    if n == 1 or not panels[0].is_large:
        columns = _columns(n)
        flat = list(figure.subplots(math.ceil(n / columns), columns, squeeze=False).flat)
        for unused in flat[n:]:
            unused.remove()
        return flat[:n]
    columns = math.ceil((n - 1) / 4)
    rows = math.ceil((n - 1) / columns)
    main = 2.5 if columns == 1 else 1.6 * columns
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=[main, *[1] * columns])
    small = [figure.add_subplot(grid[i // columns, 1 + i % columns]) for i in range(n - 1)]
    return [figure.add_subplot(grid[:, 0]), *small]


def _draw_panel(axes: Any, panel: _Panel, result: MergeResult, maps: Sequence[OccupancyGrid]) -> None:
    layers = []
    for i in panel.members:
        T = result.maps[i].T_component_map
        assert T is not None
        layers.append(Layer(maps[i], T, map_colour(i)))
    raster = paint(panel.merged, layers, _PIXELS if panel.is_large else _SMALL_PIXELS)
    axes.imshow(raster.rgb, origin="lower", extent=raster.extent, interpolation="nearest")
    is_large = panel.is_large
    left, right, bottom, top = panel.view
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", facecolor="white")
    axes.tick_params(labelsize=8 if is_large else 7, colors=_INK)
    axes.locator_params(nbins=8 if is_large else 4)
    for spine in axes.spines.values():
        spine.set_color("0.7")
    if is_large:
        axes.set_xlabel("x [m]", fontsize=9, color=_INK)
        axes.set_ylabel("y [m]", fontsize=9, color=_INK)
    axes.set_title(_title(panel, result), fontsize=11 if is_large else 8, color=_INK)
    _draw_origins(axes, panel, 9 if is_large else 7)


def _title(panel: _Panel, result: MergeResult) -> str:
    if len(panel.members) == 1:
        text = f"map {panel.members[0]} alone"
    else:
        text = f"merge order {_ARROW.join(str(i) for i in panel.members)}"
    lines = textwrap.wrap(text, 66 if panel.is_large else 26)
    if len(result.components) > 1:
        lines.insert(0, f"component {panel.component}")
    return "\n".join(lines)


def _draw_origins(axes: Any, panel: _Panel, size: float) -> None:
    left, right, bottom, top = panel.view
    taken: list[tuple[float, float]] = []
    for i, (x, y), is_near in zip(panel.members, panel.origins.tolist(), panel.near, strict=True):
        shown = (x, y)
        if not is_near:
            inset = 2 * panel.pad
            shown = (min(max(x, left + inset), right - inset), min(max(y, bottom + inset), top - inset))
            while any(math.dist(shown, other) < 2 * panel.pad for other in taken):
                shown = (shown[0] + (panel.pad if x < left else -panel.pad), shown[1])
            taken.append(shown)
        if not is_near:
            angle = math.atan2(y - shown[1], x - shown[0])
            tip = (shown[0] + 1.9 * panel.pad * math.cos(angle), shown[1] + 1.9 * panel.pad * math.sin(angle))
            arrow = {"arrowstyle": "-|>", "color": map_colour(i), "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=tip, xytext=shown, arrowprops=arrow)
        rim = {
            "boxstyle": "circle,pad=0.25",
            "facecolor": "white",
            "edgecolor": map_colour(i),
            "linewidth": 0.2 * size,
        }
        axes.text(
            *shown,
            str(i),
            ha="center",
            va="center",
            fontsize=size,
            fontweight="bold",
            color=_INK,
            bbox=rim,
            zorder=5,
        )


def _known_lines(result: MergeResult) -> list[str]:
    """What was known beside the maps, as far as there is room."""
    lines = [] if result.known is None else result.known.lines()
    if len(lines) > _MOST_KNOWN:
        lines = [*lines[: _MOST_KNOWN - 1], f"and {len(lines) - _MOST_KNOWN + 1} more (result.json)"]
    return [textwrap.shorten(line, 110).replace("$", r"\$") for line in lines]


def _legend_columns(result: MergeResult) -> int:
    longest = max(len(_label(i, result)) for i in range(len(result.maps)))
    return max(1, min(5, 100 // (longest + 6)))


def _label(i: int, result: MergeResult) -> str:
    placed = result.maps[i]
    # A name may be of any length, and a "$" would start a formula.
    name = placed.name if len(placed.name) <= 50 else f"{placed.name[:47]}..."
    status = "" if placed.status == "merged" else f" ({placed.status})"
    return f"{i}  {name}{status}".replace("$", r"\$")


def _draw_legend(figure: Any, result: MergeResult) -> None:
    from matplotlib.patches import Patch

    handles = [
        Patch(
            facecolor="white" if placed.T_component_map is None else map_colour(i),
            edgecolor=map_colour(i),
            linewidth=2,
            label=_label(i, result),
        )
        for i, placed in enumerate(result.maps)
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=_legend_columns(result),
        fontsize=8,
        frameon=False,
        labelcolor=_INK,
        title="\n".join(_known_lines(result)) or None,
        title_fontsize=8,
    )
