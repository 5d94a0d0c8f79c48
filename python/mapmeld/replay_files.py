"""What a replay writes: a line for each estimate, and the last one as the result of a merge."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.estimate import Estimate, RobotEstimate
from mapmeld.replay import Moment
from mapmeld.result import Component, Hypothesis, MergeResult, PlacedMap


def moment_line(moment: Moment) -> str:
    """A line of estimates.jsonl, see docs/replay.md."""
    value = {
        "time": moment.nanoseconds / 1e9,
        "since_start": moment.since_start,
        "robots": [_robot(r) for r in moment.robots],
        "components": [
            {"names": list(c.names), "anchor": c.anchor, "is_world": c.is_world} for c in moment.components
        ],
        "registered_pairs": moment.registered_pairs,
        "seconds": moment.seconds,
    }
    return json.dumps(value, allow_nan=False) + "\n"


def result_of_estimate(estimate: Estimate, seconds: Mapping[str, float]) -> MergeResult:
    """An estimate as the result of a merge: maps where the estimate holds them, in its frames.

    Hypotheses and pairs are those of the last merge; a hypothesis that holds a component's anchor is told in
    that component's frame. What was counted of a component is None where the estimate holds another
    arrangement than the last merge found.
    """
    merge = estimate.result
    assert merge is not None, "there is a map"
    found = {frozenset(c.order): c for c in merge.components}
    components = []
    for k, c in enumerate(estimate.components):
        same = found.get(frozenset(c.names))
        order = (c.anchor, *(n for n in c.names if n != c.anchor)) if same is None else same.order
        merged = c.merged
        if merged is not None:
            name = "merged" if k == 0 else f"merged_{k + 1}"
            merged = type(merged)(merged.data, merged.resolution, merged.origin, name)
        components.append(
            Component(
                c.anchor,
                order,
                None if same is None else same.rms_m,
                merged,
                None if same is None else same.shared_cells,
                None if same is None else same.conflict_cells,
            )
        )
    maps = []
    for r in estimate.robots:
        index = r.component
        if index is None:  # blank: a component of its own, so that every map has one
            index = len(components)
            components.append(Component(r.name, (r.name,), None, None, 0, 0))
        maps.append(PlacedMap(r.name, index, r.T_world_map, r.covariance, r.status, r.probability, r.reason))
    poses = {r.name: r.T_world_map for r in estimate.robots if r.T_world_map is not None}
    held = {c.anchor: poses[c.anchor] for c in estimate.components}
    return dataclasses.replace(
        merge,
        maps=tuple(maps),
        components=tuple(components),
        hypotheses=tuple(_in_frames(h, held) for h in merge.hypotheses),
        probability=math.prod(r.probability for r in estimate.robots if r.status == "merged"),
        seconds={**merge.seconds, **seconds},
    )


def _in_frames(hypothesis: Hypothesis, held: Mapping[str, NDArray[np.float64]]) -> Hypothesis:
    """The hypothesis, with each of its components moved to where the first anchor in it is held; anchors of
    most robots come first."""
    to_frame: dict[int, NDArray[np.float64]] = {}
    placed = {m.name: m for m in hypothesis.maps}
    for name, T_frame_anchor in held.items():
        m = placed.get(name)
        if m is not None and m.component not in to_frame:
            to_frame[m.component] = se2.compose(T_frame_anchor, se2.inverse(m.T_component_map))
    moved = (
        dataclasses.replace(m, T_component_map=se2.compose(to_frame[m.component], m.T_component_map))
        if m.component in to_frame
        else m
        for m in hypothesis.maps
    )
    return Hypothesis(hypothesis.probability, tuple(moved))


def _robot(r: RobotEstimate) -> dict[str, Any]:
    return {
        "name": r.name,
        "component": r.component,
        "T_world_map": _numbers(r.T_world_map),
        "covariance": _numbers(r.covariance),
        "probability": r.probability,
        "status": r.status,
        "reason": r.reason,
        "runner_up": None
        if r.runner_up is None
        else {
            "T_world_map": _numbers(r.runner_up.T_world_map),
            "component": r.runner_up.component,
            "probability": r.runner_up.probability,
        },
        "placements": r.placements,
    }


def _numbers(array: NDArray[np.float64] | None) -> list[Any] | None:
    """Nested lists; None for numbers that are not finite, which JSON does not know."""
    if array is None:
        return None
    if array.ndim > 1:
        return [_numbers(row) for row in array]
    return [v if math.isfinite(v) else None for v in array.tolist()]
