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
from mapmeld.picture import INK, Box, Picture, text_width
from mapmeld.picture_axes import Axes
from mapmeld.report_raster import Layer, paint
from mapmeld.result import MergeResult

_WIDTH = 880
"""Of the picture, pixels."""
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
_LINE = 17
"""Height of a line of the legend, pixels."""
_TITLE = 16
"""Of a large panel's title, pixels."""
_MOST_TITLE = 4
"""Lines of it; of a longer order the beginning and the end are told."""
_SMALL_PRINT = 12


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
    panels = _panels(result)
    notes = [*_known_lines(result), *_explained(panels)]
    rows = math.ceil(len(result.maps) / _legend_columns(result))
    below = _LINE * (rows + len(notes)) + 24
    above = _height(panels, result)
    picture = Picture(_WIDTH, above + below)
    for panel, box in zip(panels, _boxes(panels, above), strict=True):
        _draw_panel(picture, box, panel, result, maps)
    if not panels:
        picture.text((_WIDTH / 2, above / 2), "No map holds a known cell.", 20, "mm")
    _draw_legend(picture, above + 8, result, notes)
    Path(path).write_bytes(picture.png())


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


def _height(panels: list[_Panel], result: MergeResult) -> int:
    """Of all panels together, pixels: a lone panel's shape decides, within reason."""
    if not panels:
        return 160
    if panels[0].is_large:
        left, right, bottom, top = panels[0].view
        small = len(panels) - 1
        height = (_main_width(small) - 90) * (top - bottom) / (right - left)
        if not small:
            title = _title(panels[0], result, _TITLE, _WIDTH - 20)
            return round(min(max(height, 275), 1200) + 1.3 * _TITLE * (len(title) - 1)) + 100
        # The small ones at its side take a fifth of the picture's width each, one below the other.
        return round(min(max(height + 100, 0.2 * _WIDTH * min(small, 4), 275), 0.9 * _WIDTH))
    columns = _columns(len(panels))
    return round(_WIDTH * math.ceil(len(panels) / columns) / columns)


def _columns(panels: int) -> int:
    return math.ceil(math.sqrt(panels))


def _side_columns(small: int) -> int:
    """Of so many small panels beside a large one."""
    return max(1, math.ceil(small / 4))


def _main_width(small: int) -> float:
    """Of a large panel beside so many small ones, pixels."""
    if not small:
        return float(_WIDTH)
    columns = _side_columns(small)
    share = 2.5 if columns == 1 else 1.6 * columns
    return _WIDTH * share / (share + columns)


def _boxes(panels: list[_Panel], height: int) -> list[Box]:
    """Where each panel goes: a first component of several maps to the left, large, the rest in a grid."""
    if not panels:
        return []
    is_large = panels[0].is_large
    small = len(panels) - is_large
    columns = _side_columns(small) if is_large else _columns(small)
    main = _main_width(small) if is_large else 0.0
    boxes = [(0.0, 0.0, main, float(height))] if is_large else []
    width, each = (_WIDTH - main) / columns, height / max(1, math.ceil(small / columns))
    for k in range(small):
        left, top = main + k % columns * width, k // columns * each
        boxes.append((left, top, left + width, top + each))
    return boxes


def _draw_panel(
    picture: Picture, box: Box, panel: _Panel, result: MergeResult, maps: Sequence[OccupancyGrid]
) -> None:
    size, title_size = (12, _TITLE) if panel.is_large else (10, 11)
    title = _title(panel, result, title_size, box[2] - box[0] - 20)
    top = box[1] + 10 + 1.3 * title_size * len(title)
    room = (70, 45) if panel.is_large else (38, 24)
    inner = (box[0] + room[0], top, box[2] - 14, box[3] - room[1])
    axes = Axes.within(panel.view, inner)
    layers = []
    for i in panel.members:
        T = result.maps[i].T_component_map
        assert T is not None
        layers.append(Layer(maps[i], T, map_colour(i)))
    raster = paint(panel.merged, layers, _PIXELS if panel.is_large else _SMALL_PIXELS)
    left, right, bottom, upper = raster.extent
    picture.raster(raster.rgb[::-1], (*axes.at(left, upper), *axes.at(right, bottom)))
    axes.frame(picture, size, 8 if panel.is_large else 4, ("x [m]", "y [m]") if panel.is_large else None)
    middle = (axes.box[0] + axes.box[2]) / 2
    for k, line in enumerate(title):
        picture.text((middle, box[1] + 8 + 1.3 * title_size * k), line, title_size, "ma")
    _draw_origins(picture, axes, panel, 14 if panel.is_large else 11)


def _title(panel: _Panel, result: MergeResult, size: int, width: float) -> list[str]:
    if len(panel.members) == 1:
        text = f"map {panel.members[0]} alone"
    else:
        text = f"merge order {_ARROW.join(str(i) for i in panel.members)}"
    lines = textwrap.wrap(text, max(12, int(width / text_width("0", size))))
    if len(lines) > _MOST_TITLE:
        lines = [*lines[: _MOST_TITLE - 2], "...", lines[-1]]
    if len(result.components) > 1:
        lines.insert(0, f"component {panel.component}")
    return lines


def _draw_origins(picture: Picture, axes: Axes, panel: _Panel, size: int) -> None:
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
            angle = math.atan2(y - shown[1], x - shown[0])
            tip = (shown[0] + 1.9 * panel.pad * math.cos(angle), shown[1] + 1.9 * panel.pad * math.sin(angle))
            # Not in the map's colour, which its walls have.
            picture.arrow(axes.at(*shown), axes.at(*tip), INK, 0.7 * size)
        # The middles of pixels: a disc between two would be blurred.
        column, row = (round(v) for v in axes.at(*shown))
        picture.disc((column, row), 0.62 * size + 0.25 * text_width(str(i), size), map_colour(i), 0.22 * size)
        picture.text((column, row), str(i), size, "mm", bold=True)


def _known_lines(result: MergeResult) -> list[str]:
    """What was known beside the maps, as far as there is room."""
    lines = [] if result.known is None else result.known.lines()
    if len(lines) > _MOST_KNOWN:
        lines = [*lines[: _MOST_KNOWN - 1], f"and {len(lines) - _MOST_KNOWN + 1} more (result.json)"]
    return [textwrap.shorten(line, 110) for line in lines]


def _explained(panels: list[_Panel]) -> list[str]:
    """What a stranger cannot know of the panels."""
    lines = []
    if panels:
        frames = "circles: origins of the maps' frames; grey: free floor"
        lines.append(f"{frames}; walls of several maps have their colours by turns")
    if not all(near for panel in panels for near in panel.near):
        lines.append("an arrow leads from a number at the edge to its map's origin, which lies farther out")
    return lines


def _legend_columns(result: MergeResult) -> int:
    longest = max(text_width(_label(i, result), _SMALL_PRINT) for i in range(len(result.maps)))
    return max(1, min(5, int((_WIDTH - 20) // (longest + 55))))


def _label(i: int, result: MergeResult) -> str:
    placed = result.maps[i]
    # A name may be of any length.
    name = placed.name if len(placed.name) <= 50 else f"{placed.name[:47]}..."
    return f"{i}  {name}" + ("" if placed.status == "merged" else f" ({placed.status})")


def _draw_legend(picture: Picture, top: int, result: MergeResult, notes: list[str]) -> None:
    """Notes, and the colour, index and name of each map, column by column."""
    for k, line in enumerate(notes):
        picture.text((_WIDTH / 2, top + _LINE * k), line, _SMALL_PRINT, "ma")
    top += _LINE * len(notes)
    columns = _legend_columns(result)
    rows = math.ceil(len(result.maps) / columns)
    widths = [
        max(text_width(_label(i, result), _SMALL_PRINT) for i in range(k, min(k + rows, len(result.maps))))
        + 55
        for k in range(0, len(result.maps), rows)
    ]
    left = (_WIDTH - sum(widths)) / 2
    for column, width in enumerate(widths):
        for row, i in enumerate(range(column * rows, min((column + 1) * rows, len(result.maps)))):
            y = top + _LINE * row
            is_placed = result.maps[i].T_component_map is not None
            fill = map_colour(i) if is_placed else (1.0, 1.0, 1.0)
            picture.rectangle((left + 8, y + 3, left + 32, y + 12), fill, map_colour(i))
            picture.text((left + 40, y + _LINE / 2), _label(i, result), _SMALL_PRINT, "lm")
        left += width
