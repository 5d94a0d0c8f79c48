"""What a merge found, and the same as JSON. docs/result.md documents every key."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.filter_step import FilterStep
from mapmeld.grid import OccupancyGrid
from mapmeld.map_file import MapFile

if TYPE_CHECKING:
    from mapmeld.known import Known


@dataclass(frozen=True, eq=False)
class PlacedMap:
    """Where a map ended up.

    component: index into the result's components, 0 the one of most maps.
    T_component_map: (x, y, theta), float64 (3,), metres and radians: takes map coordinates to the frame of
        the component, which is that of its reference map. None for a blank map.
    covariance: float64 (3, 3), of (x, y, theta) relative to the reference map, whose own is zero. None for a
        blank map.
    status: "merged", "ambiguous" (it belongs to others, but more than one place is probable, or its
        matches contradict the place that it had: a component of its own), "no evidence" (no other map shares
        enough walls with it: a component of its own), "blank" (nothing is known in it), "prior" (placed by
        what was known of its pose alone) or "pinned".
    probability: that the map lies where T_component_map says, 0..1; 0 for a blank map. Of an ambiguous map:
        that of its most probable place among the others.
    reason: why it stands so, a sentence with its numbers.
    file: where it was read from; None for a map that is no file's.
    """

    name: str
    component: int
    T_component_map: NDArray[np.float64] | None
    covariance: NDArray[np.float64] | None
    status: str
    probability: float
    reason: str
    file: MapFile | None = None


@dataclass(frozen=True, eq=False)
class HypothesisMap:
    """Where a hypothesis places a map: T_component_map as in PlacedMap, before the joint refinement."""

    name: str
    component: int
    T_component_map: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """An arrangement of all maps that are not blank, with its probability, 0..1."""

    probability: float
    maps: tuple[HypothesisMap, ...]


@dataclass(frozen=True, eq=False)
class Mode:
    """A possible motion of the virtual robot between two maps, and what the walls say about it.

    T_a_b: (x, y, theta), takes coordinates of map b to map a. covariance: of T_a_b, from the curvature there.
    log_likelihood: of the walls at T_a_b against unrelated maps, nats. log_odds: of the whole mode over the
        search volume, nats; the evidence that the two maps belong together so.
    hits, misses, opposed, conflicts: wall that is found where it should be, is not, faces the other way, lies
        in free space; in independent observations. straight_conflicts: those of the conflicts that lie amid
        long straight walls. bending: what bending the maps until their walls met cost, nats; log_likelihood
        has paid it. shared_floor: open floor that both show, square metres. agreement: share of hits, 0..1.
    shared_length: metres of wall that both maps show. second_direction: how much of it holds the weaker axis.
    source: what proposed the mode: "corners", "segments" or "correlation".
    """

    T_a_b: NDArray[np.float64]
    covariance: NDArray[np.float64]
    log_likelihood: float
    log_odds: float
    hits: float
    misses: float
    opposed: float
    conflicts: float
    straight_conflicts: float
    bending: float
    shared_floor: float
    agreement: float
    shared_length: float
    second_direction: float
    source: str


@dataclass(frozen=True, eq=False)
class Pair:
    """The registration of maps a and b alone: modes, the likeliest first, out of so many candidates.

    status: what would become of these two maps alone: "merged", "ambiguous" or "no evidence"; or "forbidden":
        their match is known to be wrong. probability: that the first mode is right, 0..1; 0 without one.
    decoy_log_likelihood: the best that the mirror image of one map reaches on the other, nats: what chance
        and repetition reach; 0 where that is next to nothing beside the first mode. None when nothing was
        tried.
    scale, scale_deviation: how many times as large b would fit a best there, and the standard deviation of
        that; 1 where both are true to scale. None of pairs that alone would not be merged, and where walls do
        not tell.
    """

    a: str
    b: str
    candidates: int
    status: str
    probability: float
    decoy_log_likelihood: float | None
    scale: float | None
    scale_deviation: float | None
    modes: tuple[Mode, ...]


@dataclass(frozen=True, eq=False)
class Component:
    """Maps that lie in one frame, that of `reference`.

    order: names in the order in which the virtual robot visited them, which starts where the evidence is
        densest.
    rms_m: root mean square of the walls' residuals after the joint refinement, metres; None for a single
        map.
    merged: the fused map, None when the component is one blank map or, in an Estimate, too large to draw.
    shared_cells: cells that more than one map knows; conflict_cells: those that one of them shows occupied
        and another, whose own walls are farther than a cell away, free. None where nobody counted, as after
        a replay.
    provenance: int32, of the shape of `merged.data`: for each cell the index into `order` of the first map
        that shows what the merged map shows there, -1 where no map knows it. conflicts: bool, of the same
        shape: the conflict_cells. Both None where there is no merged map or nobody counted.
    steps: of the filter in its travels through the maps of the component, in their order.
    in_world: the frame is not that of `reference` but the world of priors and pins.
    """

    reference: str
    order: tuple[str, ...]
    rms_m: float | None
    merged: OccupancyGrid | None
    shared_cells: int | None
    conflict_cells: int | None
    in_world: bool = False
    provenance: NDArray[np.int32] | None = None
    conflicts: NDArray[np.bool_] | None = None
    steps: tuple[FilterStep, ...] = ()


@dataclass(frozen=True, eq=False)
class MergeResult:
    """All that a merge found.

    maps: in the order given. order: that of the largest component, empty when all maps are blank.
    probability: that all of `maps` is right, 0..1. hypotheses: most probable first. pairs: every pair of
        maps, of more than 40 maps those that were worth registering.
    components: those of most maps first, blank maps last, one by one.
    seconds: wall time by stage. config: all options in effect. version: of Mapmeld. known: what was known of
        poses, None where nothing was.
    """

    maps: tuple[PlacedMap, ...]
    hypotheses: tuple[Hypothesis, ...]
    pairs: tuple[Pair, ...]
    components: tuple[Component, ...]
    probability: float
    seconds: Mapping[str, float]
    config: Mapping[str, Any]
    version: str
    known: Known | None = None

    @property
    def order(self) -> tuple[str, ...]:
        """Names of the largest component's maps in merge order; empty when all maps are blank."""
        first = self.components[0]
        return first.order if first.merged is not None or len(first.order) > 1 else ()

    @property
    def seed(self) -> int:
        """Seed of every random draw."""
        return int(self.config["seed"])

    @property
    def merged(self) -> OccupancyGrid | None:
        """The fused map of the largest component, in its frame; None when all maps are blank."""
        return self.components[0].merged

    def __repr__(self) -> str:
        count = Counter(m.status for m in self.maps)
        statuses = ", ".join(f"{n} {status}" for status, n in count.items())
        return (
            f"MergeResult({len(self.maps)} maps: {statuses}; in {len(self.components)} components, "
            f"probability {self.probability:.3f})"
        )

    @property
    def merged_maps(self) -> tuple[OccupancyGrid, ...]:
        """The fused map of every component but the blank ones, in the components' order."""
        return tuple(c.merged for c in self.components if c.merged is not None)

    def to_dict(self, folder: str | Path = ".") -> dict[str, Any]:
        """The contents of result.json: plain dicts, lists, strings, numbers and None, see docs/result.md.

        folder: where the file will lie; paths of maps are told from there.
        Numbers that are not finite become None. The same maps, options and seed give the same contents but
        for `seconds`: the number of threads is left out of `config` for that reason.
        """
        return {
            "maps": [
                {
                    "name": m.name,
                    "component": m.component,
                    "T_component_map": _numbers(m.T_component_map),
                    "covariance": _numbers(m.covariance),
                    "status": m.status,
                    "probability": _number(m.probability),
                    "reason": m.reason,
                    "file": None if m.file is None else m.file.to_dict(Path(folder)),
                }
                for m in self.maps
            ],
            "probability": _number(self.probability),
            "order": list(self.order),
            "components": [
                {
                    "reference": c.reference,
                    "order": list(c.order),
                    "rms_m": _number(c.rms_m),
                    "merged": f"{c.merged.name}.yaml" if c.merged is not None else None,
                    "shared_cells": c.shared_cells,
                    "conflict_cells": c.conflict_cells,
                    "in_world": c.in_world,
                    "steps": [s.to_dict() for s in c.steps],
                }
                for c in self.components
            ],
            "hypotheses": [
                {
                    "probability": _number(h.probability),
                    "maps": [
                        {
                            "name": m.name,
                            "component": m.component,
                            "T_component_map": _numbers(m.T_component_map),
                        }
                        for m in h.maps
                    ],
                }
                for h in self.hypotheses
            ],
            "pairs": [_pair(p) for p in self.pairs],
            "seconds": {stage: _number(s) for stage, s in self.seconds.items()},
            "config": {key: value for key, value in self.config.items() if key != "threads"},
            "known": None if self.known is None else self.known.to_dict(),
            "seed": self.seed,
            "version": self.version,
        }

    def to_json(self, folder: str | Path = ".") -> str:
        """`to_dict` as JSON in ASCII, an item a line, with a final newline."""
        lines = []
        for key, value in self.to_dict(folder).items():
            if isinstance(value, list) and value and isinstance(value[0], dict):
                items = ",\n  ".join(json.dumps(item, allow_nan=False) for item in value)
                text = f"[\n  {items}\n ]"
            else:
                text = json.dumps(value, allow_nan=False)
            lines.append(f" {json.dumps(key)}: {text}")
        return "{\n" + ",\n".join(lines) + "\n}\n"


_MODE_NUMBERS = (
    "log_likelihood",
    "log_odds",
    "hits",
    "misses",
    "opposed",
    "conflicts",
    "straight_conflicts",
    "bending",
    "shared_floor",
    "agreement",
    "shared_length",
    "second_direction",
)


def _pair(pair: Pair) -> dict[str, Any]:
    best = pair.modes[0] if pair.modes else None
    second = pair.modes[1] if len(pair.modes) > 1 else None
    return {
        "a": pair.a,
        "b": pair.b,
        "T_a_b": _numbers(best.T_a_b) if best else None,
        "covariance": _numbers(best.covariance) if best else None,
        **{key: _number(getattr(best, key)) if best else None for key in _MODE_NUMBERS},
        "source": best.source if best else None,
        "status": pair.status,
        "probability": _number(pair.probability),
        "candidates": pair.candidates,
        "decoy_log_likelihood": _number(pair.decoy_log_likelihood),
        "scale": _number(pair.scale),
        "scale_deviation": _number(pair.scale_deviation),
        "modes": len(pair.modes),
        "runner_up": {
            "T_a_b": _numbers(second.T_a_b),
            "log_likelihood": _number(second.log_likelihood),
            "log_odds": _number(second.log_odds),
        }
        if second
        else None,
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _numbers(array: NDArray[np.float64] | None) -> list[Any] | None:
    """Nested lists of an array's numbers; None for those that are not finite."""
    if array is None:
        return None
    if array.ndim > 1:
        return [_numbers(row) for row in array]
    return [_number(v) for v in array.tolist()]
