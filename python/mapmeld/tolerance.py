"""The tolerances that a placed map is judged by; the only place where their values are written."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerance:
    """A bound on the error of a transform: metres at the centre of the map's known cells, and degrees.

    The bound in metres is the largest of `metres`, `cells` cells of the map, and `residuals` times the rms
    residual that the truth itself leaves (bent maps fit no rigid transform better than that).
    """

    metres: float
    cells: float
    residuals: float
    degrees: float

    def limit_m(self, resolution: float, rms_m: float) -> float:
        """The bound in metres for cells of `resolution` metres and a truth with residual `rms_m` metres."""
        return max(self.metres, self.cells * resolution, self.residuals * rms_m)

    def ratio(self, translation_m: float, rotation_deg: float, resolution: float, rms_m: float) -> float:
        """The error as a multiple of the bound, the worse of metres and degrees: up to 1 is within."""
        metres = translation_m / self.limit_m(resolution, rms_m)
        return max(metres, rotation_deg / self.degrees)

    def admits(self, translation_m: float, rotation_deg: float, resolution: float, rms_m: float) -> bool:
        """Whether the error lies within the bound (the bound itself included)."""
        return translation_m <= self.limit_m(resolution, rms_m) and rotation_deg <= self.degrees


RIGHT = Tolerance(metres=0.5, cells=0, residuals=2, degrees=5)
"""Placed where it belongs."""
FINE = Tolerance(metres=0.15, cells=3, residuals=1.5, degrees=1.5)
"""Placed as well as the cells allow."""
NOT_WRONG = Tolerance(metres=1, cells=0, residuals=3, degrees=10)
"""Anything outside is wrong: maps joined that should not be, or not so."""
ACCEPTED = Tolerance(metres=0, cells=3, residuals=1, degrees=1.5)
"""What Mapmeld's acceptance rule asks of every map that shares enough with the rest."""

SHARES_ENOUGH = 0.10
"""Smallest share of occupied cells in common (truth's overlap_occupied) at which the acceptance rule asks."""
PAIR_TRUTH_OVERLAP = 0.05
"""Smallest share of known area in common (truth's overlap) at which a pair's own T_a_b is the reference."""
BENT_FRAMES_RMS_M = 0.3
"""Residual in metres assumed for the map frames of bent maps, where the truth states none."""
