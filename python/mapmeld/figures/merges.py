"""Figure 4: merges of more and more maps, with the order in which the virtual robot visits them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from mapmeld.figures import drawing
from mapmeld.figures.study import PARTICLES, Pose, Study
from mapmeld.merging import merge
from mapmeld.palette import map_colour
from mapmeld.report_raster import Layer
from mapmeld.result import MergeResult

SIZES = (3, 5, 6, 10)
"""Numbers of maps, as in the paper."""


@dataclass(frozen=True, eq=False)
class Merged:
    """A merge of the first `maps` maps. order: indices of the largest component's maps in merge order.
    trajectory: (n, 3), their origins, in that order, in the frame of the first of them."""

    maps: int
    result: MergeResult
    order: tuple[int, ...]
    trajectory: Pose


def compute_merges(study: Study, sizes: tuple[int, ...] = SIZES) -> list[Merged]:
    """Merges the first 3, 5, 6 and 10 maps, order unknown; all maps when there are fewer."""
    total = len(study.grids)
    chosen = [n for n in sizes if n <= total] or [total]
    return [_merged(study, n) for n in chosen]


def _merged(study: Study, n: int) -> Merged:
    is_all = n == len(study.grids)
    result = study.result if is_all else merge(study.grids[:n], particles=PARTICLES, seed=study.seed)
    names = [m.name for m in result.maps]
    order = tuple(names.index(name) for name in result.order)
    trajectory = np.array([result.maps[i].T_component_map for i in order])
    return Merged(n, result, order, trajectory)


def draw_merges(study: Study, data: list[Merged]) -> Any:
    """A panel a merge."""
    columns = min(2, len(data))
    rows = -(-len(data) // columns)
    figure = drawing.new_figure(5.3 * columns, 4.9 * rows, _caption(data))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in panels[len(data) :]:
        unused.remove()
    for axes, merged in zip(panels, data, strict=False):
        _draw_merge(axes, study, merged)
    return figure


def _draw_merge(axes: Any, study: Study, data: Merged) -> None:
    layers = [
        Layer(study.grids[i], T, map_colour(i)) for i, T in zip(data.order, data.trajectory, strict=True)
    ]
    view = drawing.draw_maps(axes, layers, pixels=400, floor=data.result.merged)
    view = drawing.around(view, data.trajectory[:, :2], 0.9)
    for start, end in pairwise(data.trajectory):
        axes.plot(*np.stack([start, end])[:, :2].T, color="0.2", linewidth=0.9, zorder=6)
        middle = start + 0.55 * (end - start)
        drawing.draw_arrow(axes, start, middle, "0.2", linewidth=0.1, mutation_scale=11)
    for i, T in zip(data.order, data.trajectory, strict=True):
        drawing.draw_index(axes, T[0], T[1], str(i), map_colour(i))
    sequence = " \N{RIGHTWARDS ARROW} ".join(str(i) for i in data.order)
    drawing.dress(axes, view, f"{data.maps} maps: {sequence}")


def _caption(data: list[Merged]) -> str:
    numbers = [str(d.maps) for d in data]
    listed = ", ".join(numbers[:-1]) + " and " + numbers[-1] if len(numbers) > 1 else numbers[0]
    apart = sum(d.maps - len(d.order) for d in data)
    left_out = f" {apart} maps that do not fit are left out." if apart else ""
    return (
        f"Fig. 4. Merges of {listed} maps, order unknown, {PARTICLES} particles. Walls in each map's colour "
        "(where maps share a wall their colours alternate), floor in grey; the number of a map stands at the "
        "origin of its local frame, which may lie outside of it. Thin line: the trajectory of the virtual "
        "robot from origin to origin, in the merge order that the title gives. Each panel is in the frame of "
        f"its first map.{left_out}"
    )
