"""development.png: how the estimates of a replay developed over the bags' time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mapmeld.palette import map_colour
from mapmeld.replay import Moment

_DPI = 110
_PROBABILITY = "probability"
_PANELS = (_PROBABILITY, "x, m", "y, m", "theta, degrees")


@dataclass
class _Piece:
    """A span of time in which a robot's frame stays. is_merged: it lies there with others."""

    is_merged: bool
    times: list[float] = field(default_factory=list)
    values: dict[str, list[float]] = field(default_factory=lambda: {label: [] for label in _PANELS})


def draw_development(path: str | Path, moments: Sequence[Moment], end: float) -> None:
    """Draws the picture of a replay into a PNG file.

    end: seconds of the bags' time at which they end. A colour a robot: its probability and, while it is
    merged with others, T_world_map, each from one estimate to the next; a line breaks where the frame
    changes. The probability of an ambiguous robot is a thin line; one that shares nothing with others has
    none. Raises OSError when the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(8.0, 8.0), dpi=_DPI)
    figure.set_layout_engine("constrained")
    FigureCanvasAgg(figure)
    panels: Any = figure.subplots(len(_PANELS), 1, sharex=True)
    handles = []
    for index, name in enumerate(sorted({r.name for m in moments for r in m.robots})):
        colour = map_colour(index)
        handles.append(Line2D([], [], color=colour, linewidth=2.2, label=name.replace("$", r"\$")))
        for piece in _pieces(moments, name, end):
            for axes, label in zip(panels, _PANELS, strict=True):
                if piece.is_merged or label == _PROBABILITY:
                    width = 2.2 if piece.is_merged else 0.9
                    axes.plot(
                        piece.times,
                        piece.values[label],
                        drawstyle="steps-post",
                        color=colour,
                        linewidth=width,
                    )
    for axes, label in zip(panels, _PANELS, strict=True):
        axes.set_ylabel(label)
        axes.grid(color="0.9")
    panels[0].set_ylim(-0.03, 1.03)
    panels[-1].set_xlabel("seconds from the start")
    panels[-1].set_xlim(0.0, max(end, 1e-3))
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 5), frameon=False)
    figure.savefig(path, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 3})


def _pieces(moments: Sequence[Moment], name: str, end: float) -> list[_Piece]:
    """The spans of a robot, without those in which it shares nothing with others."""
    pieces: list[_Piece] = []
    before: tuple[str, bool] | None = None
    for m, after in zip(moments, [*[m.since_start for m in moments[1:]], end], strict=True):
        robot = next((r for r in m.robots if r.name == name), None)
        if robot is None or robot.component is None or robot.T_world_map is None:
            before = None
            continue
        component = m.components[robot.component]
        is_merged = len(component.names) > 1
        if not is_merged and robot.status != "ambiguous":
            before = None
            continue
        if before != (component.anchor, is_merged):
            before = component.anchor, is_merged
            pieces.append(_Piece(is_merged))
        x, y, theta = robot.T_world_map.tolist()
        piece = pieces[-1]
        piece.times += [m.since_start, after]
        for label, value in zip(_PANELS, (robot.probability, x, y, math.degrees(theta)), strict=True):
            piece.values[label] += [value, value]
    return pieces
