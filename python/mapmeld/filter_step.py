"""How the particle filter fared in one step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FilterStep:
    """One step of the filter: one more map is merged in every particle that found one.

    weights: of the particles before resampling, 0..1, which sum to one. effective_sample_size: N_eff, from 1
        (one particle has all the weight) to their number. resampled: whether they were resampled then.
    log_evidence: log of the estimated p(z_t | z_1..t-1), nats.
    """

    weights: Sequence[float]
    effective_sample_size: float
    resampled: bool
    log_evidence: float

    def to_dict(self) -> dict[str, Any]:
        """As in result.json. Weights of six digits: they are looked at, not computed with."""
        return {
            "effective_sample_size": self.effective_sample_size,
            "resampled": self.resampled,
            "log_evidence": self.log_evidence,
            "weights": [float(f"{w:.6g}") for w in self.weights],
        }
