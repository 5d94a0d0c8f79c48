"""What `mapmeld evaluate` finds: errors per pair and per map, counts, and the acceptance rule's verdict."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from mapmeld.acceptance import Acceptance


@dataclass(frozen=True)
class PairError:
    """The error of two maps to each other.

    overlap_occupied: as the truth states it, 0..1; None where it does not.
    rms_m: residual of the reference in metres, which the verdict allows for; reference: "pair" (the pair's
        own T_a_b), "frames" (from both T_world_map); both None where the truth gives neither.
    translation_error_m, rotation_error_deg: None unless joined and measured.
    joined: both maps in one component. right, fine, wrong: the tolerances of mapmeld.tolerance.
    verdict: "fine", "right", "off" (neither right nor wrong), "wrong", "apart" (not joined), "no truth".
    """

    a: str
    b: str
    overlap_occupied: float | None
    rms_m: float | None
    reference: str | None
    joined: bool
    translation_error_m: float | None
    rotation_error_deg: float | None
    right: bool
    fine: bool
    wrong: bool
    verdict: str


@dataclass(frozen=True)
class MapError:
    """The error of a map to the anchor of its component.

    component: None for a map that is not placed. anchor: name of the map that the errors refer to.
    translation_error_m, rotation_error_deg: None for the anchor itself and for maps without one.
    rms_m, reference: as in PairError, of the pair of anchor and map.
    shares: largest overlap_occupied with any other map of the result, 0..1; None where the truth is silent.
    verdict: as in PairError, or "alone" (nothing else in the component), or "not placed".
    accepted: whether the acceptance rule holds for this map; None when it does not ask (shares too little).
    accepted_via: the map against which it holds (the anchor's: the first map accepted against it).
    """

    name: str
    status: str
    component: int | None
    anchor: str | None
    translation_error_m: float | None
    rotation_error_deg: float | None
    rms_m: float | None
    reference: str | None
    shares: float | None
    verdict: str
    accepted: bool | None
    accepted_via: str | None


@dataclass(frozen=True)
class Summary:
    """Counts over the whole result.

    pairs: those with a truth; joined, right, fine, wrong: how many of these. median_right_m: median
    translation error of the right pairs in metres, None when there are none. maps: maps in the result;
    placed_maps: those with a transform; right_maps: the most maps that are right against one of them, that
    one included (0 when there is none). components: number of components that hold a placed map.
    """

    maps: int
    placed_maps: int
    right_maps: int
    components: int
    pairs: int
    joined: int
    right: int
    fine: int
    wrong: int
    median_right_m: float | None


@dataclass(frozen=True)
class Evaluation:
    """Everything `mapmeld evaluate` prints. Maps and pairs come in the order of the truth.

    not_in_result: maps that the truth lists and the result does not; nothing here refers to them.
    """

    maps: tuple[MapError, ...]
    pairs: tuple[PairError, ...]
    summary: Summary
    acceptance: Acceptance
    not_in_result: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists, numbers, strings and None, ready for JSON."""
        plain = dataclasses.asdict(self)
        return {
            **plain,
            "maps": list(plain["maps"]),
            "pairs": list(plain["pairs"]),
            "acceptance": {**plain["acceptance"], "failing": list(self.acceptance.failing)},
            "not_in_result": list(self.not_in_result),
        }
