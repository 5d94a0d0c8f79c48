"""Figure 2: one update of the virtual robot whose next motion has two modes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2
from mapmeld.figures import drawing
from mapmeld.figures.study import PARTICLES, Pose, Study, prepare
from mapmeld.grid import OccupancyGrid
from mapmeld.merging import merge
from mapmeld.palette import RGB
from mapmeld.report_raster import Layer

SCENES = (("06_r6", "09_r9", "07_r7"), ("02_r2", "04_r4", "07_r7"), ("01_r1", "06_r6", "07_r7"))
"""Bundled maps: those merged so far, in order, and the next one. The next shares few walls with them, so that
two places fit it nearly as well; few triples of these maps are as undecided."""


_APART_M, _APART_DEG = 0.5, 10.0
"""Modes closer than this are one place."""


@dataclass(frozen=True, eq=False)
class UpdateFigure:
    """An update. All poses are in the frame of the first map of `before`.

    before: maps merged so far, in order, and trajectory: (n, 3), their origins, the last of which is where
    the virtual robot stands. merged: m_(t-1). z: the next map. modes: (2, 3), its likeliest place and the
    next one that lies elsewhere, with covariance (2, 3, 3), share of the likelihood mass of all modes,
    log_likelihood in nats, and right: which of them the merge of all maps agrees with (None: neither).
    samples: the particles' poses, by mode; elsewhere: how many particles went to yet other modes.
    """

    before: tuple[int, ...]
    trajectory: Pose
    merged: OccupancyGrid
    z: int
    modes: Pose
    covariance: NDArray[np.float64]
    share: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]
    right: int | None
    samples: tuple[Pose, Pose]
    elsewhere: int


def compute_update(study: Study) -> UpdateFigure | None:
    """The update that leaves the more doubt, with the right place in front if possible: one of SCENES, where
    these maps are given, or of the pair of maps with the most of it. None when no particle has any doubt."""
    names = [grid.name for grid in study.grids]
    scenes = []
    for scene in SCENES:
        if all(name in names for name in scene):
            *before, z = (names.index(name) for name in scene)
            scenes.append((tuple(before), z))
    if (pair := _most_doubtful_pair(study)) is not None:
        scenes.append(((pair[0],), pair[1]))
    updates = [u for before, z in scenes if (u := _update(study, before, z)) is not None]
    return max(updates, key=lambda u: (u.right == 0, float(u.share[1])), default=None)


def _update(study: Study, before: tuple[int, ...], z: int) -> UpdateFigure | None:
    result = merge(
        [study.grids[i] for i in before],
        particles=PARTICLES,
        seed=study.seed,
        order=range(len(before)),
    )
    placed = [m.T_component_map for m in result.maps if m.component == 0]
    if result.merged is None or len(placed) < len(before):
        return None
    modes = _core.register(prepare(result.merged), study.local[z], "{}")[1]
    if not modes:
        return None
    mass = _shares([m["log_odds"] for m in modes])
    two = _two(study, z, [np.array(m["T_a_b"]) for m in modes], mass)
    if two is None:
        return None
    chosen = list(two)
    rng = np.random.default_rng(study.seed)
    drawn = rng.choice(len(modes), size=PARTICLES, p=mass)
    T = np.array([modes[k]["T_a_b"] for k in chosen])
    covariance = np.array([modes[k]["covariance"] for k in chosen])
    counts = [int((drawn == k).sum()) for k in chosen]
    if min(counts) == 0:
        return None
    T_right = study.T_a_b(before[0], z)
    right = [k for k in range(2) if T_right is not None and study.is_right(before[0], z, T[k])]
    return UpdateFigure(
        before=before,
        trajectory=np.array(placed),
        merged=result.merged,
        z=z,
        modes=T,
        covariance=covariance,
        share=mass[chosen],
        log_likelihood=np.array([modes[k]["log_likelihood"] for k in chosen]),
        right=right[0] if right else None,
        samples=(_draw(rng, T[0], covariance[0], counts[0]), _draw(rng, T[1], covariance[1], counts[1])),
        elsewhere=PARTICLES - sum(counts),
    )


def _draw(rng: np.random.Generator, T: Pose, covariance: NDArray[np.float64], n: int) -> Pose:
    """Samples of the mode's Gaussian, which lives in the tangent space at T: T * exp(noise)."""
    noise = rng.multivariate_normal(np.zeros(3), covariance, size=n)
    return np.array([se2.compose(T, step) for step in noise]).reshape(-1, 3)


def _shares(log_odds: list[float]) -> NDArray[np.float64]:
    mass = np.exp(np.array(log_odds) - max(log_odds))
    return np.asarray(mass / mass.sum(), dtype=np.float64)


def _two(study: Study, z: int, modes: list[Pose], share: NDArray[np.float64]) -> tuple[int, int] | None:
    """The likeliest mode, and the likeliest of those that lie somewhere else; None when all lie together, as
    on bent maps."""
    first, *others = np.argsort(-share, kind="stable").tolist()
    for k in others:
        metres, degrees = study.error(z, modes[k], modes[first])
        if metres > _APART_M or degrees > _APART_DEG:
            return first, k
    return None


def _most_doubtful_pair(study: Study) -> tuple[int, int] | None:
    """Of the pairs whose likeliest mode is right, that whose runner-up has the largest share."""
    names = [m.name for m in study.result.maps]
    best: tuple[float, int, int] | None = None
    for pair in study.result.pairs:
        a, b = names.index(pair.a), names.index(pair.b)
        if not pair.modes or study.T_a_b(a, b) is None:
            continue
        share = _shares([m.log_odds for m in pair.modes])
        two = _two(study, b, [m.T_a_b for m in pair.modes], share)
        if two is not None and study.is_right(a, b, pair.modes[two[0]].T_a_b):
            doubt = float(share[two[1]])
            if best is None or doubt > best[0]:
                best = (doubt, a, b)
    return None if best is None else best[1:]


_INCHES = 3.1
"""Side of an upper panel."""
_MODE: tuple[RGB, RGB] = (drawing.FIRST, drawing.SECOND)


def draw_update(study: Study, data: UpdateFigure) -> Any:
    """Merged map, next map and modes, map after the update; below: the next map alone, the samples."""
    figure = drawing.new_figure(11.0, 6.8, _caption(data))
    panels = figure.subplots(2, 3, height_ratios=[1.6, 1.0])
    _draw_update(panels[0], study, data)
    _draw_reading(panels[1, 0], study, data)
    reach = 1.15 * max(
        float(np.abs(s - T)[:, :2].max()) for s, T in zip(data.samples, data.modes, strict=True)
    )
    for k in range(2):
        _draw_samples(panels[1, 1 + k], data, k, reach)
    return figure


def _draw_update(panels: Any, study: Study, data: UpdateFigure) -> None:
    z, trajectory = study.grids[data.z], data.trajectory
    before = [Layer(study.grids[i], T, drawing.GREY) for i, T in zip(data.before, trajectory, strict=True)]
    at_mode = [Layer(z, data.modes[k], _MODE[k]) for k in range(2)]
    drawing.draw_maps(panels[0], before, floor=data.merged)
    view = drawing.draw_maps(panels[1], [*before, *at_mode])
    drawing.draw_maps(panels[2], [*before, at_mode[0]])
    points = np.concatenate([trajectory, data.modes])[:, :2]
    left, right, bottom, top = drawing.around(view, points, 2.0)
    side = max(right - left, top - bottom)
    view = drawing.square((left, right, bottom, top), side)
    size = 0.06 * side
    legs = [*pairwise(trajectory), (trajectory[-1], data.modes[0])]
    ways = np.concatenate([drawing.along(a, b)[2:-2] for a, b in legs])

    last = data.before[-1]
    titles = (
        f"(a) merged map $m_{{t-1}}$, robot at the origin of {last}",
        f"(b) reading $z_t$ (map {data.z}) at its two modes",
        f"(c) after the update: $m_t$, jump from {last} to {data.z}",
    )
    for axes, title in zip(panels, titles, strict=True):
        drawing.dress(axes, view, title, points=9.5)
        axes.plot(*trajectory[:, :2].T, color="0.3", linewidth=1.0, linestyle=":", zorder=5)
        for i, T in list(zip(data.before, trajectory, strict=True))[:-1]:
            drawing.draw_index(axes, T[0], T[1], str(i), "0.3")
        colour = "0.1" if axes is not panels[2] else "0.6"
        drawing.draw_robot(axes, trajectory[-1], size, colour)
        drawing.draw_note(axes, trajectory[-1], str(last), "0.3", avoid=ways, inches=_INCHES)
    for k in range(2):
        # The area of the robot tells the share.
        scale = float(np.sqrt(data.share[k] / data.share.max()))
        drawing.draw_robot(panels[1], data.modes[k], 1.2 * size * scale, _MODE[k])
        note = f"mode {k + 1}: {100 * data.share[k]:.0f} %"
        drawing.draw_note(panels[1], data.modes[k], note, _MODE[k], avoid=ways, inches=_INCHES, edge=True)
    bend = {"connectionstyle": "arc3,rad=0.2", "shrinkA": 6, "shrinkB": 9}
    drawing.draw_arrow(panels[2], trajectory[-1], data.modes[0], "black", **bend)
    drawing.draw_robot(panels[2], data.modes[0], 1.2 * size, _MODE[0])
    drawing.draw_note(panels[2], data.modes[0], str(data.z), _MODE[0], avoid=ways, inches=_INCHES)


def _draw_reading(axes: Any, study: Study, data: UpdateFigure) -> None:
    view = drawing.draw_maps(axes, [Layer(study.grids[data.z], np.zeros(3), (0.1, 0.1, 0.1))])
    view = drawing.around(view, np.zeros((1, 2)), 0.8)
    drawing.dress(axes, view, f"(d) $z_t$ alone: local map {data.z} and the origin of its frame", points=9.5)
    drawing.draw_robot(axes, np.zeros(3), 0.07 * (view[1] - view[0]), "0.1")


def _draw_samples(axes: Any, data: UpdateFigure, k: int, reach: float) -> None:
    """The samples of a mode, in centimetres about it."""
    offset = 100 * (data.samples[k][:, :2] - data.modes[k, :2])
    limit = 100 * reach
    for (x, y), theta in zip(offset, data.samples[k][:, 2], strict=True):
        drawing.draw_robot(axes, np.array([x, y, theta]), 0.07 * limit, _MODE[k], alpha=0.75, linewidth=0.3)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    title = f"({'ef'[k]}) {len(offset)} of {PARTICLES} samples fall to mode {k + 1}"
    axes.set_title(title, fontsize=9.5, color=_MODE[k])
    axes.tick_params(labelsize=8, colors=drawing.INK, length=3)
    axes.set_xlabel("x from the mode [cm]", fontsize=8, color=drawing.INK, labelpad=1)
    axes.set_ylabel("y from the mode [cm]", fontsize=8, color=drawing.INK, labelpad=1)
    axes.locator_params(nbins=5)
    for spine in axes.spines.values():
        spine.set_color("0.7")


def _caption(data: UpdateFigure) -> str:
    merged = " and ".join(str(i) for i in data.before)
    agreement = {
        0: "The merge of all maps agrees with mode 1",
        1: "The merge of all maps agrees with mode 2, against the odds here",
        None: "The merge of all maps agrees with neither mode",
    }[data.right]
    first, second = data.log_likelihood
    return (
        f"Fig. 2. One update of the virtual robot. (a) The map merged from {merged}; the robot stands at the "
        f"origin of local map {data.before[-1]}. (b) The next local map, {data.z}, at its two likeliest "
        "poses; the robots there are as large as the modes' shares of the likelihood mass. (c) The map after "
        f"the update by mode 1, and the robot's jump to the origin of map {data.z}. (d) The reading itself. "
        f"(e, f) {PARTICLES} samples of the proposal: a mode in proportion to its share, a pose from its "
        f"Gaussian ({data.elsewhere} fall to lesser modes). {agreement}. With {first:.0f} and {second:.0f} "
        "nats against unrelated maps (oriented walls), these maps alone leave the answer open; the scene was "
        "chosen for that. Left to itself, a merge first takes up maps that tell more."
    )
