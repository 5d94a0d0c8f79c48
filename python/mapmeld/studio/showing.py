"""What the page is shown of the bench, as plain JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapmeld import se2
from mapmeld.result import MergeResult
from mapmeld.studio import hypotheses
from mapmeld.studio.desk import Desk, Solving
from mapmeld.studio.layout import as_pose


def state(
    names: Sequence[str],
    desk: Desk,
    solving: Solving | None,
    problem: str | None,
    is_saved: bool,
    steps: tuple[str | None, str | None],
    output: Path,
) -> dict[str, Any]:
    """All but the pairs and the arrangements. steps: what undo and redo would undo and do again."""
    placed = {} if desk.result is None else {m.name: m for m in desk.result.maps}
    return {
        "maps": [
            {
                "name": n,
                "pose": list(desk.poses[n]),
                "component": placed[n].component if n in placed else None,
                "status": placed[n].status if n in placed else None,
                "probability": placed[n].probability if n in placed else None,
                "reason": placed[n].reason if n in placed else None,
                "contradicting": desk.contradicting.get(n),
                "pin": "hard" if n in desk.known.pins else "soft" if n in desk.known.priors else None,
            }
            for n in names
        ],
        "parts": [] if desk.result is None else _parts(desk, desk.result),
        "solve": desk.solve,
        "probability": None if desk.result is None else desk.result.probability,
        "points": [
            {"a": s.a, "b": s.b, "points": [[list(p), list(q)] for p, q in s.points]}
            for s in desk.known.same_points
        ],
        "forbidden": [list(pair) for pair in desk.known.forbidden],
        "solving": None if solving is None else dataclasses.asdict(solving),
        "problem": problem,
        "is_solved": desk.result is not None,
        "is_current": desk.result is not None and desk.solved == desk.known,
        "moved": desk.moved,
        "frame": desk.frame,
        "is_saved": is_saved,
        "undo": steps[0],
        "redo": steps[1],
        "output": str(output),
    }


def arrangements(desk: Desk, centres: hypotheses.Centres) -> list[dict[str, Any]]:
    """The hypotheses: what each has otherwise than the bench shows, in words and as poses on the bench."""
    out: list[dict[str, Any]] = []
    for k, h in enumerate(() if desk.result is None else desk.result.hypotheses):
        found = hypotheses.differences(k, desk, centres)
        out.append(
            {
                "probability": h.probability,
                "says": hypotheses.words(found),
                "poses": {d.name: list(d.pose) for d in found if d.pose is not None},
                "apart": [d.name for d in found if d.pose is None],
            }
        )
    return out


def pairs(name: str, names: Sequence[str], desk: Desk) -> list[dict[str, Any]]:
    """What a map and each other one say of each other alone, the most probable first."""
    told = () if desk.result is None else desk.result.pairs
    known = {frozenset((p.a, p.b)): p for p in told}
    out: list[dict[str, Any]] = []
    for other in names:
        if other == name:
            continue
        pair = known.get(frozenset((name, other)))
        status = None if pair is None else pair.status
        if desk.known.is_forbidden(name, other):
            status = "forbidden"
        elif status == "forbidden":
            status = None
        probability = None if pair is None or status in (None, "forbidden") else pair.probability
        out.append({"a": name, "b": other, "status": status, "probability": probability})
    return sorted(out, key=lambda p: -1.0 if p["probability"] is None else -p["probability"] - 1.0)


def _parts(desk: Desk, result: MergeResult) -> list[dict[str, Any]]:
    """Components as the page shows them; `pose` is T_bench_component, None once its maps have been moved."""
    maps = {m.name: m for m in result.maps}
    parts = []
    for k, c in enumerate(result.components):
        placed = {n: maps[n].T_component_map for n in c.order}
        first = placed[c.reference]
        pose = None
        if first is not None:
            T = se2.compose(desk.poses[c.reference], se2.inverse(first))
            is_still = all(
                own is not None and np.allclose(se2.compose(T, own), desk.poses[n], atol=1e-6)
                for n, own in placed.items()
            )
            pose = list(as_pose(T)) if is_still else None
        grid = c.merged
        parts.append(
            {
                "index": k,
                "maps": list(c.order),
                "shared_cells": c.shared_cells,
                "conflict_cells": c.conflict_cells,
                "pose": pose,
                "origin": None if grid is None else list(grid.origin),
                "resolution": None if grid is None else grid.resolution,
            }
        )
    return parts
