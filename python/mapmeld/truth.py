"""Ground truth of a case: where its maps belong, and which statement a pair is measured against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mapmeld import json_fields, se2
from mapmeld.errors import MapmeldError
from mapmeld.tolerance import BENT_FRAMES_RMS_M, PAIR_TRUTH_OVERLAP

Pose = tuple[float, float, float]
"""(x, y, theta) in metres and radians."""


@dataclass(frozen=True)
class TruthPair:
    """What the truth says of maps a and b. Shares lie in 0..1; None where the truth is silent.

    T_a_b takes coordinates of b to a; rms_m is its residual in metres. overlap is the share of the smaller
    map's known area, overlap_occupied the share of the occupied cells of the map that has fewer.
    """

    a: str
    b: str
    T_a_b: Pose | None
    overlap: float | None
    overlap_occupied: float | None
    rms_m: float | None


@dataclass(frozen=True)
class Reference:
    """The true T_a_b that an estimate is held against.

    source: "pair" for the pair's own T_a_b, "frames" for the one that the two T_world_map imply.
    rms_m: residual in metres that the verdicts allow for (stated, or assumed for frames of bent maps).
    stated_rms_m: the residual that the truth itself states, 0 where it states none.
    """

    T_a_b: Pose
    source: str
    rms_m: float
    stated_rms_m: float


@dataclass(frozen=True)
class Truth:
    """The truth of one case.

    T_world_map: by map name, in the order of the file; None where the truth gives no frame.
    pairs: by (a, b), in the direction in which the file states them.
    resolution: side of a cell in metres; None where the file does not say.
    bent: whether the maps were drawn along drifting paths, so that no rigid transform is exact.
    """

    T_world_map: Mapping[str, Pose | None]
    pairs: Mapping[tuple[str, str], TruthPair]
    resolution: float | None
    bent: bool

    def pair(self, a: str, b: str) -> TruthPair | None:
        """The statement about a and b, in whichever direction it is written."""
        return self.pairs.get((a, b)) or self.pairs.get((b, a))

    def shared(self, a: str, b: str) -> float | None:
        """overlap_occupied of the two maps, 0..1; None where the truth does not say."""
        pair = self.pair(a, b)
        return pair.overlap_occupied if pair else None

    def reference(self, a: str, b: str) -> Reference | None:
        """The true T_a_b; None where the truth gives neither the pair's transform nor both frames.

        The pair's own transform counts where the maps overlap enough to give it leverage; below that, and
        where there is none, the frames count.
        """
        pair = self.pair(a, b)
        stated = (pair.rms_m or 0.0) if pair else 0.0
        T_world_a, T_world_b = self.T_world_map[a], self.T_world_map[b]
        has_leverage = (
            pair is not None and pair.T_a_b is not None and (pair.overlap or 0.0) >= PAIR_TRUTH_OVERLAP
        )
        if not has_leverage and T_world_a is not None and T_world_b is not None:
            T = se2.compose(se2.inverse(T_world_a), T_world_b)
            rms = max(stated, BENT_FRAMES_RMS_M if self.bent else 0.0)
            return Reference(_pose(T), "frames", rms, stated)
        if pair is None or pair.T_a_b is None:
            return None
        T_a_b = pair.T_a_b if pair.a == a else _pose(se2.inverse(pair.T_a_b))
        return Reference(T_a_b, "pair", stated, stated)


def parse_truth(truth: Mapping[str, Any], label: str = "truth") -> Truth:
    """Checks the contents of a truth.json. `label` is what messages call it, usually the file.

    Raises MapmeldError for a missing key, a value of another kind, a name given twice, and a pair of maps
    that the truth does not list.
    """
    frames: dict[str, Pose | None] = {}
    for i, item in enumerate(json_fields.objects(truth, "maps", label)):
        where = f"{label}: maps[{i}]"
        name = json_fields.string(item, "name", where)
        if name in frames:
            raise MapmeldError(f"{where}: map name {name!r} is given twice")
        frames[name] = json_fields.optional_pose(item, "T_world_map", where)
    pairs: dict[tuple[str, str], TruthPair] = {}
    for i, item in enumerate(json_fields.objects(truth, "pairs", label)):
        where = f"{label}: pairs[{i}]"
        a, b = json_fields.string(item, "a", where), json_fields.string(item, "b", where)
        for key, name in (("a", a), ("b", b)):
            if name not in frames:
                raise MapmeldError(f"{where}: '{key}' names map {name!r}, which 'maps' does not list")
        if a == b:
            raise MapmeldError(f"{where}: 'a' and 'b' are the same map {a!r}")
        if (a, b) in pairs or (b, a) in pairs:
            raise MapmeldError(f"{where}: the pair of {a!r} and {b!r} is given twice")
        pairs[a, b] = TruthPair(
            a=a,
            b=b,
            T_a_b=json_fields.optional_pose(item, "T_a_b", where),
            overlap=json_fields.optional_number(item, "overlap", where),
            overlap_occupied=json_fields.optional_number(item, "overlap_occupied", where),
            rms_m=json_fields.optional_number(item, "rms_m", where),
        )
    resolution = json_fields.optional_number(truth, "resolution", label)
    if resolution == 0:
        raise MapmeldError(f"{label}: 'resolution' must be a positive number of metres, got 0")
    # The truth files of drifting paths say so; pair residuals alone do not (hand-made truth has them too).
    return Truth(frames, pairs, resolution, bent=truth.get("variant") == "drift")


def _pose(T: Any) -> Pose:
    x, y, theta = (float(v) for v in T)
    return x, y, theta
