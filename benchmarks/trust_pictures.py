"""A picture of each pair that failed: where the maps belong, and where they were put."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

import mapmeld
import trust_cases
import trust_failures
from mapmeld import se2
from mapmeld.grid import FREE, UNKNOWN
from mapmeld.palette import map_colour
from mapmeld.report_raster import Layer, Raster, paint

_PIXELS = 600
_IDENTITY = np.zeros(3)

Drawn = tuple[int, dict[str, Any], mapmeld.OccupancyGrid, mapmeld.OccupancyGrid]
"""Number, row and maps of a failed pair."""


def draw_all(
    rows: Sequence[dict[str, Any]], find: Callable[[str], Path | None], folder: Path
) -> tuple[int, int]:
    """One PNG a failed pair, of its first failing seed, and one of all where they belong (all.png), numbered
    as in the table of failures; how many were drawn, and of how many pairs a map was not found."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = []
    failures = trust_failures.distinct(rows)
    for number, row in enumerate(failures, start=1):
        grids = []
        for key in ("a", "b"):
            home = find(row[f"case_{key}"])
            path = None if home is None else home / f"{row[key]}.yaml"
            if path is not None and path.is_file():
                grids.append(trust_cases.grid(path, key))
        if len(grids) == 2:
            name = "_".join((row["case_a"], row["a"], row["case_b"], row["b"]))
            name = f"{number:03d}_" + re.sub(r"[^A-Za-z0-9_]+", "-", name) + ".png"
            _draw(row, grids[0], grids[1], folder / name)
            drawn.append((number, row, grids[0], grids[1]))
    belonging = [d for d in drawn if d[1]["T_true"] is not None]
    if belonging:
        _draw_sheet(belonging, folder / "all.png")
    return len(drawn), len(failures) - len(drawn)


def _draw_sheet(drawn: Sequence[Drawn], path: Path) -> None:
    """All pairs where they belong, small, on one sheet."""
    across = 7
    down = math.ceil(len(drawn) / across)
    figure = Figure(figsize=(2.0 * across, 2.2 * down), dpi=80)
    figure.set_layout_engine("constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for axes in panels:
        axes.axis("off")
    for axes, (number, row, a, b) in zip(panels, drawn, strict=False):
        raster = _raster(a, b, np.array(row["T_true"]))
        axes.imshow(raster.rgb, origin="lower", extent=raster.extent, interpolation="nearest")
        axes.set_title(f"{number}: {row['family']} {100 * row['walls']:.0f} %", fontsize=8)
    figure.savefig(path, format="png", metadata={"Software": None})


def _draw(row: dict[str, Any], a: mapmeld.OccupancyGrid, b: mapmeld.OccupancyGrid, path: Path) -> None:
    figure = Figure(figsize=(13.0, 7.0), dpi=90)
    figure.set_layout_engine("constrained")
    FigureCanvasAgg(figure)
    joined = row["T_found"] is not None
    right = f"found: off by {_off(row)}" if joined else "refused; its best mode"
    panels = (("truth", row["T_true"]), (right, row["T_found"] if joined else row["T_mode"]))
    for axes, (title, T) in zip(figure.subplots(1, 2), panels, strict=True):
        axes.set_title(title if T is not None else f"{title}: none", fontsize=10)
        if T is not None:
            raster = _raster(a, b, np.array(T))
            axes.imshow(raster.rgb, origin="lower", extent=raster.extent, interpolation="nearest")
            axes.set_aspect("equal")
        else:
            axes.axis("off")
    verdict = "wrong" if row["wrong"] else "refused" if not joined else "not right"
    figure.suptitle(
        f"{row['case_a']}/{row['a']} (blue) with {row['case_b']}/{row['b']} (red), "
        f"seed {row['seed']}: {verdict}\n"
        f"walls in common {row['walls']:.2f}, best mode of probability "
        f"{row['mode_probability'] or 0:.3f}, "
        f"{'right' if row['mode_right'] else 'not right'}",
        fontsize=10,
    )
    figure.savefig(path, format="png", metadata={"Software": None})


def _off(row: dict[str, Any]) -> str:
    if row["error_m"] is None:
        return "different buildings"
    return f"{row['error_m']:.2f} m, {row['error_deg']:.1f} deg"


def _raster(a: mapmeld.OccupancyGrid, b: mapmeld.OccupancyGrid, T_a_b: NDArray[np.float64]) -> Raster:
    """Both maps' walls in their colours, over the floor that either shows, in the frame of a."""
    places = [(a, _IDENTITY), (b, T_a_b)]
    floors, edges = [], []
    for g, T in places:
        rows, cols = np.nonzero(g.data != UNKNOWN)
        edges.append(se2.apply(T, g.cell_centers(rows, cols)))
        rows, cols = np.nonzero((g.data >= 0) & (g.data <= 25))
        floors.append(se2.apply(T, g.cell_centers(rows, cols)))
    known = np.vstack(edges)
    low, high = known.min(axis=0) - 0.5, known.max(axis=0) + 0.5
    cell = max(a.resolution, b.resolution, float((high - low).max()) / _PIXELS)
    width, height = (int(v) for v in np.ceil((high - low) / cell))
    floor = np.full((height, width), UNKNOWN, dtype=np.int8)
    cells = ((np.vstack(floors) - low) / cell).astype(int)
    floor[cells[:, 1], cells[:, 0]] = FREE
    merged = mapmeld.OccupancyGrid(floor, cell, (float(low[0]), float(low[1]), 0.0), "both")
    layers = [Layer(g, T, map_colour(k)) for k, (g, T) in enumerate(places)]
    return paint(merged, layers, _PIXELS)
