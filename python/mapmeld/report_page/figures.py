"""The report's pictures for papers: PNG and SVG files."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.errors import MapmeldError
from mapmeld.figures.drawing import INK, draw_index, dress, render
from mapmeld.map_yaml import one_line
from mapmeld.output import make_folder, replace_file
from mapmeld.palette import map_colour
from mapmeld.report_page.hypotheses import hypothesis_pictures
from mapmeld.report_page.raster import FREE_BELOW, OCCUPIED_FROM
from mapmeld.report_page.story import Layers, Story
from mapmeld.report_page.views import STRENGTHS, View, views
from mapmeld.report_raster import Layer, paint

KINDS = ("png", "svg")
_PIXELS, _SMALL_PIXELS = 900, 300
_WIDTH, _DPI = 6.0, 200
_ENLARGED = 10
"""Ellipses are drawn so many times their size: a few centimetres would not be seen."""

Drawn = list[tuple[str, bytes]]
"""Names of files and what goes into them."""


def check_folder(folder: Path) -> None:
    """Raises MapmeldError for a folder that cannot be made or written to, before there is work to lose."""
    place = folder.absolute()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        raise MapmeldError(one_line(f"--figures {folder}: {place} is no folder; choose another one"))
    if not os.access(place, os.W_OK | os.X_OK):
        raise MapmeldError(one_line(f"--figures {folder}: {place} is closed; choose another folder"))


def write_figures(folder: Path, story: Story) -> list[Path]:
    """Draws all pictures, then writes them; answers the files. Those of the same name are replaced."""
    return save_figures(folder, draw_figures(story))


def draw_figures(story: Story) -> Drawn:
    """Every picture as PNG and SVG."""
    return [(f"{name}.{kind}", render(f, kind)) for name, f in _figures(story) for kind in KINDS]


def save_figures(folder: Path, drawn: Drawn) -> list[Path]:
    """Writes drawn pictures into a folder, which is made when it is not there."""
    make_folder(folder)
    for name, content in drawn:
        replace_file(folder / name, content)
    return [folder / name for name, _ in drawn]


def _figures(story: Story) -> Iterator[tuple[str, Any]]:
    for view in views(story):
        stem = "map" if view.number == 0 else f"map_{view.number + 1}"
        layers = story.layers[view.number]
        assert layers is not None, "a view has a merged map"
        draw: dict[str, Callable[[Any], None]] = {
            "robots": partial(_robots, view=view, story=story),
            "merged": partial(_cells, layers=layers, strength=None),
            "provenance": partial(_provenance, view=view, layers=layers),
            "conflicts": partial(_cells, layers=layers, strength=view.strength),
            "uncertainty": partial(_uncertainty, view=view, layers=layers),
        }
        titles = {
            "conflicts": "walls in free floor: pale at its rim, orange over 2 cells deep, red over 5",
            "uncertainty": f"95 % ellipses, drawn {_ENLARGED} times their size",
        }
        for what, draw_it in draw.items():
            yield f"{stem}_{what}", _map_figure(view, draw_it, titles.get(what, ""))
    if any(h.shapes for h in hypothesis_pictures(story)):
        yield "hypotheses", _hypotheses(story)
    for k, c in enumerate(story.found["components"]):
        if c["steps"]:
            suffix = "" if k == 0 else f"_{k + 1}"
            yield f"n_eff{suffix}", _n_eff(c["steps"])
            yield f"weights{suffix}", _weights(c["steps"])
    yield "seconds", _seconds(story.found["seconds"])


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _map_figure(view: View, draw: Callable[[Any], None], title: str) -> Any:
    left, bottom, width, height = view.box
    figure = _figure(_WIDTH, min(max(_WIDTH * height / width, 2.0), 9.0))
    axes = figure.add_subplot()
    draw(axes)
    dress(axes, (left, left + width, bottom, bottom + height), title, points=9)
    axes.set_xlabel("x [m]", fontsize=9, color=INK)
    axes.set_ylabel("y [m]", fontsize=9, color=INK)
    return figure


def _robots(axes: Any, view: View, story: Story) -> None:
    layers = story.layers[view.number]
    assert layers is not None, "a view has a merged map"
    placed = [Layer(story.grids[m.name], story.pose(m.name), map_colour(m.index)) for m in view.members]
    raster = paint(layers.merged, placed, _PIXELS)
    axes.imshow(raster.rgb, origin="lower", extent=raster.extent, interpolation="nearest")
    _numbers(axes, view)


def _cells(axes: Any, layers: Layers, strength: NDArray[np.uint8] | None) -> None:
    """The merged map; conflicts by their strength, as single cells."""
    data = layers.merged.data
    rgb = np.ones((*data.shape, 3))
    rgb[(data >= 0) & (data <= FREE_BELOW)] = 0.93
    rgb[data >= OCCUPIED_FROM] = 0.1 if strength is None else 0.55
    if strength is not None:
        for level, colour in enumerate(STRENGTHS, start=1):
            rgb[strength == level] = np.array(colour[:3]) / 255
    _show(axes, layers, rgb)


def _provenance(axes: Any, view: View, layers: Layers) -> None:
    colours = np.array([map_colour(m.index) for m in view.members])
    rgb = np.ones((*layers.provenance.shape, 3))
    known = layers.provenance >= 0
    rgb[known] = colours[layers.provenance[known]]
    floor = known & (layers.merged.data <= FREE_BELOW)
    rgb[floor] = 1 - 0.35 * (1 - rgb[floor])
    _show(axes, layers, rgb)


def _show(axes: Any, layers: Layers, rgb: NDArray[np.float64]) -> None:
    g = layers.merged
    x, y, _ = g.origin
    extent = (x, x + g.width * g.resolution, y, y + g.height * g.resolution)
    axes.imshow(rgb, origin="lower", extent=extent, interpolation="nearest")


def _uncertainty(axes: Any, view: View, layers: Layers) -> None:
    """Ellipses of 95 % at the local origins, enlarged, and the way of the virtual robot."""
    from matplotlib.patches import Ellipse

    _cells(axes, layers, None)
    for (x, y), (u, w) in view.legs:
        arrow = {"arrowstyle": "->", "color": INK, "linewidth": 0.8, "linestyle": "--"}
        axes.annotate("", xy=(u, w), xytext=(x, y), arrowprops=arrow)
    for m in view.members:
        if m.ellipse is not None:
            e, colour = m.ellipse, map_colour(m.index)
            size = (2 * _ENLARGED * e.a, 2 * _ENLARGED * e.b)
            style: dict[str, Any] = {"facecolor": (*colour, 0.3), "edgecolor": colour, "zorder": 6}
            axes.add_patch(Ellipse((e.x, e.y), *size, angle=e.degrees, **style))
    _numbers(axes, view)


def _numbers(axes: Any, view: View) -> None:
    for m in view.members:
        draw_index(axes, m.x, m.y, str(m.index), map_colour(m.index), points=6)


def _hypotheses(story: Story) -> Any:
    pictures = [h for h in hypothesis_pictures(story) if h.shapes]
    columns = min(len(pictures), 3)
    rows = math.ceil(len(pictures) / columns)
    figure = _figure(2.4 * columns, 2.3 * rows)
    names = list(story.grids)
    for k, h in enumerate(pictures):
        axes = figure.add_subplot(rows, columns, k + 1)
        for s in h.shapes:
            grid = story.grids[names[s.index]]
            pale = h.rank > 1 and not s.moved
            _walls(axes, grid.data, grid.resolution, s.transform, map_colour(s.index), 0.35 if pale else 1.0)
        axes.set(xlim=(0, h.box[2]), ylim=(0, h.box[3]), aspect="equal")
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_title(f"{h.rank}: {h.probability:.3f}", fontsize=8, color=INK)
    return figure


def _walls(
    axes: Any, data: NDArray[np.int8], resolution: float, transform: str, colour: Any, alpha: float
) -> None:
    rows, cols = np.nonzero(data >= OCCUPIED_FROM)
    every = max(1, rows.size // 4000)
    u, v = (cols[::every] + 0.5) * resolution, (rows[::every] + 0.5) * resolution
    a, b, c, d, x, y = (float(t) for t in transform.removeprefix("matrix(").removesuffix(")").split())
    points = {"s": 0.15, "color": [colour], "alpha": alpha, "linewidths": 0, "rasterized": True}
    axes.scatter(a * u + c * v + x, b * u + d * v + y, **points)


def _curve(label: str) -> tuple[Any, Any]:
    figure = _figure(_WIDTH, 2.2)
    axes = figure.add_subplot()
    axes.set_xlabel("step", fontsize=9, color=INK)
    axes.set_ylabel(label, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    axes.xaxis.get_major_locator().set_params(integer=True)
    return figure, axes


def _n_eff(steps: Sequence[Mapping[str, Any]]) -> Any:
    figure, axes = _curve("effective sample size")
    across = range(1, len(steps) + 1)
    values = [s["effective_sample_size"] for s in steps]
    axes.plot(across, values, marker="o", markersize=3, color=map_colour(0))
    again = [(k, v) for k, v, s in zip(across, values, steps, strict=True) if s["resampled"]]
    if again:
        style = {"marker": "o", "facecolors": "none", "edgecolors": [map_colour(1)], "s": 40, "zorder": 3}
        axes.scatter(*zip(*again, strict=True), label="resampled", **style)
        axes.legend(fontsize=8, frameon=False)
    axes.set_ylim(0, 1.05 * max(len(s["weights"]) for s in steps))
    return figure


def _weights(steps: Sequence[Mapping[str, Any]]) -> Any:
    figure, axes = _curve("weight")
    for k, s in enumerate(steps):
        weights = np.maximum(np.sort(s["weights"])[::-1], 1e-6)
        across = k + 1 + np.linspace(-0.25, 0.25, len(weights))
        axes.scatter(across, weights, s=3, color=[map_colour(0)], linewidths=0)
    axes.set_yscale("log")
    axes.set_ylim(0.7e-6, 1.5)
    return figure


def _seconds(seconds: Mapping[str, float | None]) -> Any:
    stages = [(name, s) for name, s in seconds.items() if s is not None and name not in ("merge", "total")]
    figure = _figure(_WIDTH, 0.28 * len(stages) + 0.7)
    axes = figure.add_subplot()
    axes.barh([name for name, _ in stages], [s for _, s in stages], color=[map_colour(0)])
    axes.invert_yaxis()
    axes.set_xlabel("seconds", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    return figure
