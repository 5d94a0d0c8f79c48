"""Small cases with truth, and results that miss it by known amounts."""

from __future__ import annotations

import math
from typing import Any

from mapmeld import se2

BLANK = object()
"""Stands for a map that the merge did not place."""


def make_truth(
    frames: dict[str, list[float]], shares: dict[tuple[str, str], float], **extra: Any
) -> dict[str, Any]:
    """A truth of exact frames; pairs that `shares` does not name share nothing, known area like walls."""
    names = list(frames)
    pairs = []
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            share = shares.get((a, b), 0.0)
            T = se2.compose(se2.inverse(frames[a]), frames[b])
            pairs.append({"a": a, "b": b, "T_a_b": T.tolist(), "overlap": share, "overlap_occupied": share})
    maps = [{"name": n, "T_world_map": list(T)} for n, T in frames.items()]
    return {"resolution": 0.05, "maps": maps, "pairs": pairs, **extra}


def make_result(
    truth: dict[str, Any],
    moved: dict[str, Any] | None = None,
    components: dict[str, int] | None = None,
    gauge: dict[int, list[float]] | None = None,
) -> dict[str, Any]:
    """A result that agrees with the truth's frames, but for `moved`: name -> error in the map's own frame."""
    maps = []
    for item in truth["maps"]:
        name = item["name"]
        component = (components or {}).get(name, 0)
        error = (moved or {}).get(name, [0.0, 0.0, 0.0])
        T = None
        if error is not BLANK:
            T_component_world = (gauge or {}).get(component, [0.0, 0.0, 0.0])
            T = se2.compose(se2.compose(T_component_world, item["T_world_map"]), error).tolist()
        maps.append({"name": name, "component": component, "T_component_map": T, "status": "x"})
    return {"maps": maps, "pairs": [], "hypotheses": []}


def about(centre: tuple[float, float], degrees: float) -> list[float]:
    """The rotation about a point, as a transform."""
    x, y = centre
    turn = [0.0, 0.0, math.radians(degrees)]
    return se2.compose(se2.compose([x, y, 0.0], turn), [-x, -y, 0.0]).tolist()


def row(evaluation: Any, name: str) -> Any:
    return next(m for m in evaluation.maps if m.name == name)


FRAMES = {"a": [1.0, 2.0, 0.3], "b": [-4.0, 7.0, 2.9], "c": [12.0, -3.0, -1.1], "d": [0.5, 0.2, -3.0]}
CENTRES = {"a": (3.0, 1.0), "b": (-20.0, 35.0), "c": (0.0, 8.0), "d": (5.0, 5.0)}
CHAIN = {("a", "b"): 0.4, ("b", "c"): 0.3, ("c", "d"): 0.2}


def two(**pair: Any) -> dict[str, Any]:
    """Truth of maps a and b, which share half; `pair` overrides fields of their pair."""
    truth = make_truth({n: FRAMES[n] for n in "ab"}, {("a", "b"): 0.5})
    truth["pairs"][0].update(pair)
    return truth
