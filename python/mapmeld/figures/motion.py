"""Figure 1: how a real robot moves, and how the virtual robot moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.figures import drawing
from mapmeld.figures.corner_pairs import corner_pairs
from mapmeld.figures.study import Pose, Study
from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.report_raster import Layer

ODOMETRY: tuple[float, float, float] = (2.2, 0.0, 0.35)
"""The odometry reading of (a): metres and radians in the robot's frame."""
SIGMA: tuple[float, float, float] = (0.22, 0.22, 0.12)
"""Its standard deviations: a tenth of the way, and 7 degrees."""
_SAMPLES = 150
_HEADINGS = 24
_INCHES = 5.0
"""Side of a panel."""
_SPACING = 0.2
"""Between the places that are tried as the real robot's, metres."""


@dataclass(frozen=True, eq=False)
class MotionFigure:
    """All poses in the frame of map a.

    start: the real robot; reading: its next pose by odometry; samples: (n, 3), next poses drawn from the
    Gaussian around that. proposals: (n, 3), where pairs of similar corners of a and b put the origin of b.
    modes: (m, 3), the local maxima of the likelihood, best first, with their log_likelihood in nats.
    """

    a: int
    b: int
    start: Pose
    reading: Pose
    samples: Pose
    proposals: Pose
    modes: Pose
    log_likelihood: NDArray[np.float64]


def compute_motion(study: Study, a: int, b: int) -> MotionFigure:
    """Both motion models on map a; b is the next local map."""
    start = _roomy_place(study, a)
    rng = np.random.default_rng(study.seed)
    noise = rng.normal(size=(_SAMPLES, 3)) * SIGMA
    reading = se2.compose(start, ODOMETRY)
    modes = study.register(a, b)
    return MotionFigure(
        a=a,
        b=b,
        start=start,
        reading=reading,
        samples=np.array([se2.compose(reading, n) for n in noise]),
        proposals=np.array([p.T_a_b for p in corner_pairs(study.local[a], study.local[b])]).reshape(-1, 3),
        modes=np.array([m["T_a_b"] for m in modes]).reshape(-1, 3),
        log_likelihood=np.array([m["log_likelihood"] for m in modes]),
    )


def _roomy_place(study: Study, a: int) -> Pose:
    """A pose on the free floor of map a from which the odometry's way keeps the farthest from all walls."""
    grid = study.grids[a]
    step = max(1, round(_SPACING / grid.resolution))
    data = grid.data[step // 2 :: step, step // 2 :: step]
    rows, cols = np.nonzero((data >= 0) & (data <= 25))
    free = grid.cell_centers(rows * step + step // 2, cols * step + step // 2)
    walls = study.local[a].boundary()["position"]
    clearance = np.zeros(data.shape)
    clearance[rows, cols] = [np.linalg.norm(walls - p, axis=1).min() for p in free]
    headings = np.arange(_HEADINGS) * 2 * math.pi / _HEADINGS
    shares = np.linspace(0, 1.2, 9)
    # Places along the way, for every start and heading: the odometry's arc, taken as its chord.
    way = shares[:, None] * ODOMETRY[0] * np.stack([np.cos(headings), np.sin(headings)])[:, None, :]
    x = free[:, 0, None, None] + way[0]
    y = free[:, 1, None, None] + way[1]
    inside = se2.apply(se2.inverse(grid.origin), np.stack([x, y], axis=-1)) / (grid.resolution * step)
    col = np.clip(inside[..., 0].astype(int), 0, data.shape[1] - 1)
    row = np.clip(inside[..., 1].astype(int), 0, data.shape[0] - 1)
    worst = clearance[row, col].min(axis=1)
    place, heading = np.unravel_index(int(np.argmax(worst)), worst.shape)
    return np.array([*free[place], headings[heading]])


def draw_motion(study: Study, data: MotionFigure) -> Any:
    """(a) and (b) side by side."""
    figure = drawing.new_figure(11.0, 5.6, _caption(data))
    left, right = figure.subplots(1, 2)
    _draw_real(left, study, data)
    _draw_virtual(right, study, data)
    return figure


def _draw_real(axes: Any, study: Study, data: MotionFigure) -> None:
    grid = study.grids[data.a]
    view = drawing.draw_maps(axes, [Layer(grid, np.zeros(3), drawing.GREY)])
    view = drawing.square(view, 1.04 * max(view[1] - view[0], view[3] - view[2]))
    drawing.dress(axes, view, "(a) real robot: one mode, around its odometry")
    _draw_samples(axes, data, 0.22)
    drawing.draw_arrow(axes, data.start, data.reading, "black")
    drawing.draw_robot(axes, data.start, 0.75, drawing.FIRST)
    avoid = np.concatenate([data.samples[:, :2], drawing.along(data.start, data.reading)])
    drawing.draw_note(axes, data.start, "robot", drawing.FIRST, avoid=avoid, inches=_INCHES)

    zoom = axes.inset_axes(_emptiest_corner(grid, view))
    reach = 1.12 * float(np.abs(data.samples[:, :2] - data.reading[:2]).max())
    x, y = data.reading[:2]
    zoom.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), aspect="equal", xticks=[], yticks=[])
    zoom.set_title("the samples, enlarged", fontsize=8, color=drawing.INK, pad=3)
    _draw_samples(zoom, data, 0.11)
    for spine in zoom.spines.values():
        spine.set_color("0.5")


def _draw_samples(axes: Any, data: MotionFigure, size: float) -> None:
    from matplotlib.patches import Ellipse

    for pose in data.samples:
        drawing.draw_robot(axes, pose, size, drawing.SECOND, alpha=0.6, linewidth=0.2)
    x, y, theta = (float(v) for v in data.reading)
    style = {"facecolor": "none", "edgecolor": "black", "linewidth": 1.2, "linestyle": "--", "zorder": 7}
    for k in (1, 2):
        size = 2 * k
        axes.add_patch(Ellipse((x, y), size * SIGMA[0], size * SIGMA[1], angle=math.degrees(theta), **style))


def _emptiest_corner(grid: OccupancyGrid, view: drawing.View) -> tuple[float, float, float, float]:
    """Where an inset hides the least of the map: left, bottom, width, height as shares of the panel."""
    rows, cols = np.nonzero(grid.data != UNKNOWN)
    low = np.array([view[0], view[2]])
    size = np.array([view[1] - view[0], view[3] - view[2]])
    points = (grid.cell_centers(rows, cols) - low) / size
    side = 0.3
    corners = [(x, y) for y in (0.02, 0.93 - side) for x in (0.98 - side, 0.02)]
    hidden = [int(((points >= c) & (points <= np.add(c, side))).all(axis=1).sum()) for c in corners]
    x, y = corners[int(np.argmin(hidden))]
    return (x, y, side, side)


def _draw_virtual(axes: Any, study: Study, data: MotionFigure) -> None:
    view = drawing.draw_maps(axes, [Layer(study.grids[data.a], np.zeros(3), drawing.GREY)])
    points = np.concatenate([data.proposals, data.modes, np.zeros((1, 3))])[:, :2]
    left, right, bottom, top = drawing.around(view, points, 1.3)
    side = max(right - left, top - bottom)
    n = len(data.proposals)
    title = f"(b) virtual robot: {n} modes, one per pair of similar corners"
    drawing.dress(axes, drawing.square((left, right, bottom, top), side), title)
    for pose in data.proposals:
        drawing.draw_robot(axes, pose, 0.034 * side, drawing.SECOND, linewidth=0.4)
    for pose in data.modes:
        style = {"linewidth": 1.1, "zorder": 7}
        drawing.draw_robot(axes, pose, 0.045 * side, "none", "black", **style)
    best, origin = data.modes[0], np.zeros(3)
    drawing.draw_arrow(axes, origin, best, drawing.FIRST, shrinkA=8, shrinkB=10)
    drawing.draw_robot(axes, origin, 0.05 * side, drawing.FIRST)
    ring = {"markerfacecolor": "none", "color": drawing.FIRST, "markeredgewidth": 2.0, "zorder": 9}
    axes.plot(*best[:2], "o", markersize=20, **ring)
    # Without what lies under the two labelled robots themselves.
    others = [p for p in points if min(np.hypot(*p), np.hypot(*(p - best[:2]))) > 0.03 * side]
    avoid = np.array([*others, *drawing.along(origin, best)[2:-2]])
    for pose, text in ((best, "likeliest"), (origin, f"origin of map {data.a}")):
        drawing.draw_note(axes, pose, text, drawing.FIRST, avoid=avoid, inches=_INCHES)


def _caption(data: MotionFigure) -> str:
    second = f"; the next best: {data.log_likelihood[1]:.0f}" if len(data.modes) > 1 else ""
    return (
        f"Fig. 1. Motion models in the frame of map {data.a} (grey). (a) A real robot's next pose: "
        f"{_SAMPLES} samples of the Gaussian around one odometry reading of {ODOMETRY[0]:g} m and "
        f"{math.degrees(ODOMETRY[2]):.0f} degrees (standard deviations {SIGMA[0]:g} m and "
        f"{math.degrees(SIGMA[2]):.0f} degrees; dashed: one and two of them). (b) The virtual robot's next "
        f"pose, which is the origin of map {data.b}: each of the {len(data.proposals)} pairs of similar "
        "corners of the two maps proposes one in closed form (vermilion). Outlined: the local maxima of the "
        f"likelihood to which the candidates of all sources lead, the {len(data.modes)} best. Circled: the "
        f"likeliest ({data.log_likelihood[0]:.0f} nats against unrelated maps{second})."
    )
