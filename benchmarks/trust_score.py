"""How a placing is judged in the trust benchmark, and how far covariances hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mapmeld
from mapmeld import se2
from mapmeld.tolerance import FINE, NOT_WRONG, RIGHT

PoseLike = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class Verdict:
    """Error of b seen from a, in metres at the centre of b's known cells and in degrees, and what it is."""

    error_m: float
    error_deg: float
    right: bool
    fine: bool
    wrong: bool


def judge(
    found: PoseLike, true: PoseLike, rms_m: float, centre_b: Sequence[float], resolution: float
) -> Verdict:
    """The verdict on T_a_b, given the residual of its truth and the side of b's cells, in metres."""
    at = np.asarray(centre_b, dtype=float)
    dx, dy = se2.apply(found, at) - se2.apply(true, at)
    metres = math.hypot(dx, dy)
    degrees = abs(math.degrees(se2.wrap(float(found[2]) - float(true[2]))))
    return Verdict(
        error_m=metres,
        error_deg=degrees,
        right=RIGHT.admits(metres, degrees, resolution, rms_m),
        fine=FINE.admits(metres, degrees, resolution, rms_m),
        wrong=not NOT_WRONG.admits(metres, degrees, resolution, rms_m),
    )


def relative(result: mapmeld.MergeResult, i: int, j: int) -> NDArray[np.float64] | None:
    """T_i_j of two maps of a result, by index; None when they are not in one component."""
    a, b = result.maps[i], result.maps[j]
    if a.T_component_map is None or b.T_component_map is None or a.component != b.component:
        return None
    return se2.compose(se2.inverse(a.T_component_map), b.T_component_map)


def nees(result: mapmeld.MergeResult, true: PoseLike) -> float | None:
    """Normalised error squared of the second map of two, three degrees of freedom; None when they are apart,
    or without a covariance that can be inverted.

    result.json tells the covariance of (x, y, theta) relative to the reference map, in whose frame the
    component lies, so the error is the plain difference of these three.
    """
    if relative(result, 0, 1) is None:
        return None
    reference = result.components[result.maps[0].component].reference
    if reference == result.maps[0].name:
        moved, expected = result.maps[1], np.asarray(true, dtype=float)
    else:
        moved, expected = result.maps[0], se2.inverse(true)
    T, covariance = moved.T_component_map, moved.covariance
    if T is None or covariance is None:
        return None
    error = np.array([T[0] - expected[0], T[1] - expected[1], se2.wrap(float(T[2] - expected[2]))])
    try:
        value = float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return None
    return value if math.isfinite(value) and value >= 0 else None


def expected_error(stated: Sequence[float], held: Sequence[bool]) -> float:
    """Expected calibration error over ten bins of equal width: the mean gap between what was stated and how
    often it held, weighted by the answers in each bin."""
    gaps = [abs(sum(p for p, _ in b) - sum(h for _, h in b)) for b in bins(stated, held)]
    return sum(gaps) / len(stated) if stated else math.nan


def brier(stated: Sequence[float], held: Sequence[bool]) -> float:
    """Mean squared difference between what was stated and what was so (1 or 0)."""
    if not stated:
        return math.nan
    return sum((p - h) ** 2 for p, h in zip(stated, held, strict=True)) / len(stated)


def bins(stated: Sequence[float], held: Sequence[bool]) -> list[list[tuple[float, bool]]]:
    """The answers by stated probability: [0, 0.1), [0.1, 0.2), ..., [0.9, 1]."""
    found: list[list[tuple[float, bool]]] = [[] for _ in range(10)]
    for p, h in zip(stated, held, strict=True):
        found[min(int(p * 10), 9)].append((p, h))
    return found


def rounded(pose: PoseLike | None) -> list[float] | None:
    """A pose as plain numbers."""
    return None if pose is None else [float(v) for v in pose]


def verdict_fields(verdict: Verdict | None, joined: bool) -> dict[str, Any]:
    """A verdict as a row's fields; joined without a truth is wrong, for such maps do not belong together."""
    if verdict is None:
        return {"error_m": None, "error_deg": None, "right": False, "fine": False, "wrong": joined}
    return {
        "error_m": verdict.error_m,
        "error_deg": verdict.error_deg,
        "right": verdict.right,
        "fine": verdict.fine,
        "wrong": verdict.wrong,
    }
