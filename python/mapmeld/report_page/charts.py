"""Curves and bars as SVG text in the page's own colours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

_WIDTH, _HEIGHT = 720, 190
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 12, 34
_MOST_DOTS = 20_000
_LEAST_WEIGHT = 1e-6
"""Lighter particles are drawn at the lower edge."""


def n_eff_chart(steps: Sequence[Mapping[str, Any]]) -> Markup:
    """The effective sample size over the steps; a ring where particles were resampled."""
    most = max(len(s["weights"]) for s in steps)
    values = [float(s["effective_sample_size"]) for s in steps]
    points = [(_across(k, len(steps)), _up(v / most)) for k, v in enumerate(values)]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    marks = "".join(
        f'<circle class="{"ring" if s["resampled"] else "dot"}" cx="{x:.1f}" cy="{y:.1f}" r="3.5">'
        f"<title>step {k + 1}: N_eff {v:.1f}{', resampled' if s['resampled'] else ''}</title></circle>"
        for k, (s, (x, y), v) in enumerate(zip(steps, points, values, strict=True))
    )
    scale = [(0.0, "0"), (0.5, f"{most / 2:g}"), (1.0, f"{most}")]
    body = f'<polyline class="line" points="{line}"/>{marks}'
    return _frame(body, scale, len(steps), "N_eff", "Effective sample size over the steps")


def weights_chart(steps: Sequence[Mapping[str, Any]]) -> Markup:
    """The weight of every particle over the steps, before resampling, on a logarithmic scale."""
    decades = -math.log10(_LEAST_WEIGHT)
    room = (_WIDTH - _LEFT - _RIGHT) / max(len(steps), 1) * 0.5
    most = max(1, _MOST_DOTS // len(steps))
    marks = []
    for k, s in enumerate(steps):
        weights = sorted(s["weights"], reverse=True)
        shown = weights[:: max(1, math.ceil(len(weights) / most))]
        for i, w in enumerate(shown):
            x = _across(k, len(steps)) + room * (i / max(len(shown) - 1, 1) - 0.5)
            y = _up(1 + math.log10(max(w, _LEAST_WEIGHT)) / decades)
            marks.append(f"M{x:.1f} {y:.1f}h0")
    scale = [(1 - d / decades, "1" if d == 0 else f"1e-{d}") for d in range(0, round(decades) + 1, 2)]
    body = f'<path class="dots" d="{"".join(marks)}"/>'
    return _frame(body, scale, len(steps), "weight", "Weight of every particle over the steps")


def seconds_chart(seconds: Mapping[str, float]) -> Markup:
    """A bar a stage."""
    stages = [
        (name, float(s)) for name, s in seconds.items() if name not in ("merge", "total") and s is not None
    ]
    most = max((s for _, s in stages), default=0.0) or 1.0
    bars = []
    for k, (name, s) in enumerate(stages):
        y = 22 * k
        bars.append(
            f'<text x="84" y="{y + 14}" text-anchor="end">{Markup.escape(name)}</text>'
            f'<rect class="bar" x="92" y="{y + 3}" width="{max(480 * s / most, 1):.1f}" height="14"/>'
            f'<text x="{98 + 480 * s / most:.1f}" y="{y + 14}">{s:.3f} s</text>'
        )
    height = max(22 * len(stages), 22)
    return Markup(
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="Seconds of each stage">'
        f"{''.join(bars)}</svg>"
    )


def _across(k: int, steps: int) -> float:
    """Where step k stands."""
    return _LEFT + (_WIDTH - _LEFT - _RIGHT) * (k + 0.5) / steps


def _up(share: float) -> float:
    return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (1 - share)


def _frame(body: str, scale: Sequence[tuple[float, str]], steps: int, name: str, title: str) -> Markup:
    lines = "".join(
        f'<path class="grid" d="M{_LEFT} {_up(at):.1f}H{_WIDTH - _RIGHT}"/>'
        f'<text x="{_LEFT - 6}" y="{_up(at) + 4:.1f}" text-anchor="end">{label}</text>'
        for at, label in scale
    )
    every = max(1, math.ceil(steps / 20))
    ticks = "".join(
        f'<text x="{_across(k, steps):.1f}" y="{_HEIGHT - 18}" text-anchor="middle">{k + 1}</text>'
        for k in range(0, steps, every)
    )
    return Markup(
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{title}">'
        f'{lines}{ticks}{body}<text x="{_WIDTH / 2}" y="{_HEIGHT - 3}" text-anchor="middle">step</text>'
        f'<text transform="translate(12 {_HEIGHT / 2}) rotate(-90)" text-anchor="middle">{name}</text>'
        "</svg>"
    )
