"""The error of one estimated transform against its reference, at the centre of a map's known cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapmeld import se2
from mapmeld.placement import Placement
from mapmeld.tolerance import FINE, NOT_WRONG, RIGHT, Tolerance
from mapmeld.truth import Reference, Truth


@dataclass(frozen=True)
class Measurement:
    """How far map b is from where it belongs, seen from map a: metres at b's centre, and degrees (>= 0).

    resolution: side of b's cells in metres.
    """

    translation_m: float
    rotation_deg: float
    reference: Reference
    resolution: float

    def within(self, tolerance: Tolerance) -> bool:
        """Whether the error is within a tolerance, given the residual that the reference allows for."""
        return tolerance.admits(self.translation_m, self.rotation_deg, self.resolution, self.reference.rms_m)

    @property
    def ratio(self) -> float:
        """The error as a multiple of what is right: at most 1 is right. One number for metres and degrees."""
        return RIGHT.ratio(self.translation_m, self.rotation_deg, self.resolution, self.reference.rms_m)

    @property
    def right(self) -> bool:
        return self.within(RIGHT)

    @property
    def fine(self) -> bool:
        return self.within(FINE)

    @property
    def wrong(self) -> bool:
        return not self.within(NOT_WRONG)

    @property
    def verdict(self) -> str:
        """The strictest word that applies. Wrong comes first: three cells of a coarse map can exceed it."""
        if self.wrong:
            return "wrong"
        return "fine" if self.fine else "right" if self.right else "off"


@dataclass(frozen=True)
class Rig:
    """What a measurement needs: placements and truth by map name, centres (x, y) and cells in metres."""

    placements: Mapping[str, Placement]
    truth: Truth
    centres: Mapping[str, Sequence[float]]
    resolutions: Mapping[str, float]

    def component(self, name: str) -> int | None:
        """The component that the map is placed in; None when it is not placed."""
        placement = self.placements[name]
        return None if placement.T_component_map is None else placement.component

    def joined(self, a: str, b: str) -> bool:
        """Whether both maps are placed, in one component."""
        return self.component(a) is not None and self.component(a) == self.component(b)

    def shares(self, name: str, names: Iterable[str]) -> float | None:
        """Largest overlap_occupied of the map with any of the others; None where the truth is silent.

        The truth states the share by the map of the pair with fewer occupied cells, so for the larger map
        of a pair this is an upper bound.
        """
        shares = [self.truth.shared(name, other) for other in names if other != name]
        return max((s for s in shares if s is not None), default=None)

    def measure(self, a: str, b: str) -> Measurement | None:
        """The error of b seen from a; None when they are not joined, or the truth has no reference."""
        reference = self.truth.reference(a, b)
        T_c_a, T_c_b = self.placements[a].T_component_map, self.placements[b].T_component_map
        if reference is None or T_c_a is None or T_c_b is None or not self.joined(a, b):
            return None
        T_a_b = se2.compose(se2.inverse(T_c_a), T_c_b)
        centre = np.asarray(self.centres[b], dtype=float)
        dx, dy = se2.apply(T_a_b, centre) - se2.apply(reference.T_a_b, centre)
        rotation = abs(math.degrees(se2.wrap(float(T_a_b[2]) - reference.T_a_b[2])))
        return Measurement(math.hypot(dx, dy), rotation, reference, self.resolutions[b])
