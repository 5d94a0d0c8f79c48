"""Figure 3: candidate poses of one pair of maps, and what Psi, gamma and the walls say about each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.figures import drawing
from mapmeld.figures.corner_pairs import CornerPair, corner_pairs, distinct
from mapmeld.figures.study import Pose, Study
from mapmeld.metrics import centre_of_known_cells
from mapmeld.report_raster import Layer

POSES = 11
_APART_M, _APART_RAD = 0.5, math.radians(10)
"""Poses closer than this look the same in print; one of them is enough."""


@dataclass(frozen=True, eq=False)
class Pool:
    """Psi~, gamma~ and their normalised product, an entry a pose; each sums to one."""

    psi: NDArray[np.float64]
    gamma: NDArray[np.float64]
    product: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseStudy:
    """The poses of T_a_b that similar corners of maps a and b propose, judged as one pool.

    right: index of the pose at which the merge of all maps puts b. all_classes: the paper's model; occupied:
    Psi over occupied cells only, the default of that model; walls: (n,), log-likelihood ratio of the oriented
    walls, nats, the default model.
    """

    a: int
    b: int
    pairs: tuple[CornerPair, ...]
    right: int
    all_classes: Pool
    occupied: Pool
    walls: NDArray[np.float64]

    @property
    def poses(self) -> Pose:
        """All T_a_b, shape (n, 3)."""
        return np.array([pair.T_a_b for pair in self.pairs])

    def picks(self, values: NDArray[np.float64]) -> bool:
        """Whether the right pose has the highest value."""
        return int(np.argmax(values)) == self.right


@dataclass(frozen=True, eq=False)
class PoseFigure:
    """The pair that is drawn, and the same study of every pair whose corners propose the right pose."""

    shown: PoseStudy
    studies: tuple[PoseStudy, ...]

    def tally(self) -> dict[str, int]:
        """By model: of how many pairs the right pose has the highest value."""
        return {
            "psi_all": sum(s.picks(s.all_classes.psi) for s in self.studies),
            "gamma": sum(s.picks(s.all_classes.gamma) for s in self.studies),
            "product_all": sum(s.picks(s.all_classes.product) for s in self.studies),
            "psi_occupied": sum(s.picks(s.occupied.psi) for s in self.studies),
            "product_occupied": sum(s.picks(s.occupied.product) for s in self.studies),
            "walls": sum(s.picks(s.walls) for s in self.studies),
        }


def compute_poses(study: Study) -> PoseFigure:
    """Studies all pairs and chooses the one to show: where the paper's product is right while neither of its
    factors is, and of such pairs (or, without one, of all) that with the most walls in common.

    Raises MapmeldError when no pair's corners propose the pose at which the merge puts the maps.
    """
    found = [s for a, b in study.joined_pairs() if (s := study_pair(study, a, b)) is not None]
    if not found:
        raise MapmeldError("figures: no two maps have similar corners at the same place; figure 3 needs some")

    def worth(s: PoseStudy) -> tuple[bool, bool, float]:
        pool = s.all_classes
        is_product_right = s.picks(pool.product)
        is_factor_right = s.picks(pool.psi) or s.picks(pool.gamma)
        return is_product_right and not is_factor_right, is_product_right, float(s.walls[s.right])

    return PoseFigure(max(found, key=worth), tuple(found))


def study_pair(study: Study, a: int, b: int) -> PoseStudy | None:
    """The right pose, and the first others that differ, in the core's order (the most visible corners first),
    POSES in all; None when no pair of corners proposes the right pose."""
    T_right = study.T_a_b(a, b)
    assert T_right is not None
    pairs = corner_pairs(study.local[a], study.local[b])
    near = [i for i, pair in enumerate(pairs) if study.is_right(a, b, pair.T_a_b)]
    if not near:
        return None
    best = min(near, key=lambda i: study.error(b, pairs[i].T_a_b, T_right))
    centre = np.array(centre_of_known_cells(study.grids[b]))
    # The right one goes first, so that what repeats it is dropped, and not it; then back to the core's order.
    queue = [pairs[best], *(pair for i, pair in enumerate(pairs) if i != best)]
    kept = distinct(queue, centre, _APART_M, _APART_RAD)[:POSES]
    chosen = sorted((queue[i] for i in kept), key=pairs.index)
    poses = np.array([pair.T_a_b for pair in chosen])
    everything = study.perceive(a, b, poses, "all")
    occupied = study.perceive(a, b, poses, "occupied")
    return PoseStudy(
        a=a,
        b=b,
        pairs=tuple(chosen),
        right=chosen.index(pairs[best]),
        all_classes=_pool(everything),
        occupied=_pool(occupied),
        walls=np.array([walls["log_likelihood"] for walls in everything["walls"]]),
    )


def _pool(perceived: Any) -> Pool:
    return Pool(perceived["psi_normalised"], perceived["gamma_normalised"], perceived["product"])


def draw_poses(study: Study, data: PoseFigure) -> Any:
    """Panels of the poses and the merged picture above, bars of the models below."""
    s = data.shown
    figure = drawing.new_figure(11.0, 6.5, _caption(data))
    rows = figure.add_gridspec(2, 1, height_ratios=[2.05, 1.0])
    panels = rows[0].subgridspec(2, 6)
    axes = [figure.add_subplot(panels[i // 6, i % 6]) for i in range(12)]
    for unused in axes[len(s.pairs) : -1]:
        unused.remove()
    winner = int(np.argmax(s.all_classes.product))
    views = [_draw_pose(axes[i], study, s, i) for i in range(len(s.pairs))]
    views.append(_draw_merged(axes[-1], study, s, winner))
    side = 1.03 * max(max(v[1] - v[0], v[3] - v[2]) for v in views)
    for i, view in enumerate(views[:-1]):
        mark = ", highest product" if i == winner else ""
        drawing.dress(axes[i], drawing.square(view, side), f"pose {i + 1}{mark}", ticks=False, points=9)
        if i == winner:
            axes[i].title.set_fontweight("bold")
            for spine in axes[i].spines.values():
                spine.set(color=_WIN, linewidth=3)
    title = f"merged at pose {winner + 1}"
    drawing.dress(axes[-1], drawing.square(views[-1], side), title, ticks=False, points=9)
    both = "dark: all classes, light: occupied only"
    bars = [
        (r"$\tilde\Psi$", both, [s.all_classes.psi, s.occupied.psi]),
        (r"$\tilde\gamma$", "the same for both", [s.all_classes.gamma]),
        (r"$\tilde\Psi\,\tilde\gamma$, normalised", both, [s.all_classes.product, s.occupied.product]),
        ("oriented walls (our default)", "log-likelihood ratio, nats", [s.walls]),
    ]
    cells = rows[1].subgridspec(1, len(bars))
    for k, (title, note, series) in enumerate(bars):
        _draw_bars(figure.add_subplot(cells[k]), s, title, note, series)
    return figure


_WIN = "#0072b2"
_SHADES = (("0.35", "#0072b2"), ("0.75", "#56b4e9"))
"""Bars of the first and the second model: the rest, and the highest."""


def _draw_pose(axes: Any, study: Study, s: PoseStudy, i: int) -> drawing.View:
    pair = s.pairs[i]
    corners_a = study.local[s.a].corners()["vertex"]
    corners_b = se2.apply(pair.T_a_b, study.local[s.b].corners()["vertex"])
    layers = [
        Layer(study.grids[s.a], np.zeros(3), drawing.FIRST),
        Layer(study.grids[s.b], pair.T_a_b, drawing.SECOND),
    ]
    view = drawing.draw_maps(axes, layers, pixels=190)
    axes.plot(
        *corners_a.T, "o", markersize=3.6, color=drawing.FIRST, markeredgecolor="white", markeredgewidth=0.5
    )
    axes.plot(
        *corners_b.T, "s", markersize=3.4, color=drawing.SECOND, markeredgecolor="white", markeredgewidth=0.5
    )
    axes.plot(
        *corners_a[pair.corner_a],
        "o",
        markersize=13,
        markerfacecolor="none",
        color="black",
        markeredgewidth=1.6,
    )
    return view


def _draw_merged(axes: Any, study: Study, s: PoseStudy, winner: int) -> drawing.View:
    ink = (0.1, 0.1, 0.1)
    T_a_b = s.pairs[winner].T_a_b
    layers = [Layer(study.grids[s.a], np.zeros(3), ink), Layer(study.grids[s.b], T_a_b, ink)]
    return drawing.draw_maps(axes, layers, pixels=190)


def _draw_bars(axes: Any, s: PoseStudy, title: str, note: str, series: list[NDArray[np.float64]]) -> None:
    x = np.arange(1, len(s.pairs) + 1)
    width = 0.8 / len(series)
    for k, values in enumerate(series):
        rest, best = _SHADES[k]
        colours = [best if i == int(np.argmax(values)) else rest for i in range(len(values))]
        axes.bar(x + (k - (len(series) - 1) / 2) * width, values, width, color=colours)
    axes.axhline(0, color="0.5", linewidth=0.6)
    axes.set_title(title, fontsize=10, color=drawing.INK, pad=17)
    style = {"fontsize": 7.5, "color": "0.35", "transform": axes.transAxes}
    axes.text(0.5, 1.03, note, ha="center", va="bottom", **style)
    axes.set_xticks(x)
    axes.tick_params(labelsize=7.5, colors=drawing.INK, length=2)
    axes.set_xlabel("pose", fontsize=8, color=drawing.INK, labelpad=1)
    axes.get_xticklabels()[s.right].set(fontweight="bold", color="white", bbox=_BADGE)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


_BADGE = {"boxstyle": "round,pad=0.25", "facecolor": _WIN, "edgecolor": "none"}


def _caption(data: PoseFigure) -> str:
    s, n, t = data.shown, len(data.studies), data.tally()
    verdict = {True: "names the right pose", False: "names a wrong pose"}
    product, psi, gamma = (
        verdict[s.picks(values)] for values in (s.all_classes.product, s.all_classes.psi, s.all_classes.gamma)
    )
    return (
        f"Fig. 3. Maps {s.a} (blue) and {s.b} (vermilion) laid together at {len(s.pairs)} poses, each "
        "proposed by one pair of similar corners (circled; dots and squares: all corners of the two maps), "
        r"not refined. Number on blue: the right pose; blue bars: the highest. Dark: $\tilde\Psi$ over all "
        r"classes, as printed in the paper; light: over occupied cells, our setting of that model. "
        rf"$\gamma=-D$. Here the paper's product {product}, $\tilde\Psi$ alone {psi}, $\tilde\gamma$ alone "
        f"{gamma}; the pair was chosen to show such a case, if there is one. It is not the rule: of the {n} "
        f"pairs of maps whose corners propose the right pose, among {POSES} poses each, the product ranks it "
        rf"first in {t['product_all']} (occupied only: {t['product_occupied']}), $\tilde\Psi$ alone in "
        rf"{t['psi_all']} ({t['psi_occupied']}), $\tilde\gamma$ alone in {t['gamma']}: where maps share "
        "much, even well aligned walls lie beside the other map's free cells and raise D. The oriented "
        f"walls, by which a merge judges unless told otherwise, rank it first in {t['walls']}."
    )
