"""Small pictures of two maps as they fit best alone, to be judged by eye."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mapmeld import se2
from mapmeld.one_place import is_one_place
from mapmeld.report_page.hypotheses import Shape, corners
from mapmeld.report_page.links import Bond, is_as_placed
from mapmeld.report_page.pairs import PairRow
from mapmeld.report_page.story import Story
from mapmeld.report_page.views import Box, placed

MOST = 12
_MOST_LINKS = 6
_WORTH = 0.05
"""Best fits within a component that lie otherwise than it does are drawn from this probability on."""

_RIVAL = 0.5
"""Second best fits are drawn that reach this share of the best one's log-likelihood."""


@dataclass(frozen=True)
class Match:
    """A pair as one of its modes has it, in the frame of the first map. what: of which kind it is, in words;
    words: the verdict."""

    a: str
    b: str
    what: str
    words: str
    status: str
    shapes: list[Shape]
    box: Box


def matches(story: Story, rows: list[PairRow], bonds: list[Bond]) -> list[Match]:
    """Weakest links first, then the most probable pairs that are not joined so, the likeliest first."""
    row_of = {(r.a, r.b): r for r in rows}
    pair_of = {(p["a"], p["b"]): p for p in story.found["pairs"]}
    weakest = sorted((b.weakest for b in bonds if b.weakest is not None), key=lambda link: link.probability)
    out = []
    for link in weakest[:_MOST_LINKS]:
        key = (link.a, link.b)
        out.append(_match(pair_of[key], pair_of[key]["T_a_b"], "a weakest link", row_of[key], story))
    part = {m["name"]: m["component"] for m in story.found["maps"]}
    status = {m["name"]: m["status"] for m in story.found["maps"]}
    loose = []
    for p in story.found["pairs"]:
        if p["T_a_b"] is None:
            continue
        apart = part[p["a"]] != part[p["b"]]
        if apart or (p["probability"] >= _WORTH and not is_as_placed(p, story)):
            loose.append((p, apart))
    loose.sort(key=lambda found: -found[0]["probability"])
    for p, apart in loose[:MOST]:
        row = row_of[(p["a"], p["b"])]
        what = "not joined" if apart else "they lie otherwise than this in the merged map"
        out.append(_match(p, p["T_a_b"], what, row, story))
        second = p["runner_up"]
        if "ambiguous" not in (status[p["a"]], status[p["b"]]) or second is None:
            continue
        rivals = (second["log_likelihood"] or 0.0) > _RIVAL * (p["log_likelihood"] or 0.0)
        if rivals and not is_one_place(second["T_a_b"], p["T_a_b"], story.centres[p["b"]]):
            out.append(_match(p, second["T_a_b"], "not joined; the second best fit", row, story, True))
    return out


def _match(
    pair: Mapping[str, Any], T_a_b: Any, what: str, row: PairRow, story: Story, is_second: bool = False
) -> Match:
    a, b = pair["a"], pair["b"]
    poses = {a: np.zeros(3), b: np.array(T_a_b, dtype=np.float64)}
    points = np.concatenate([se2.apply(T, corners(story.grids[n])) for n, T in poses.items()])
    low, high = points.min(axis=0), points.max(axis=0)
    shift = np.array([-low[0], -low[1], 0.0])
    shapes = [
        Shape(story.index[n], placed(T + shift, story.grids[n].origin), False) for n, T in poses.items()
    ]
    shared = "" if row.shared is None else f", {row.shared:.1f} m of wall in common as they fit best"
    words = f"{row.status}: {row.why}; probability {row.probability:.3f} for these two alone{shared}"
    if is_second:
        words = f"less likely than the best fit of these two by {row.over_runner_up or 0.0:.1f} nats"
    box = (0.0, 0.0, float(high[0] - low[0]), float(high[1] - low[1]))
    return Match(a, b, what, words, row.status, shapes, box)
