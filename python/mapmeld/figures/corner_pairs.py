"""Similar corners of two maps, and the pose that each pair of them proposes (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import _core, se2
from mapmeld.figures.study import Pose


@dataclass(frozen=True, eq=False)
class CornerPair:
    """A corner of map a and a similar one of map b, and the closed-form T_a_b that lays them on each other.

    corner_a, corner_b: indices into LocalMap.corners().
    """

    corner_a: int
    corner_b: int
    T_a_b: Pose


def corner_pairs(a: _core.LocalMap, b: _core.LocalMap) -> list[CornerPair]:
    """Every candidate of the core that comes from corners, with its corners, in the core's order: the most
    visible corners of a first.

    The core does not say which corners a pose comes from. They are told by their centroid: that of the vertex
    and of the two arms, as far as both maps show them, is the one point that the closed form maps exactly.
    """
    poses = [np.array(T) for source, T in _core.candidates(a, b, "{}") if source == "corners"]
    if not poses:
        return []
    centroid_a, centroid_b = _centroids(a.corners(), b.corners())
    found = []
    for T in poses:
        apart = np.linalg.norm(se2.apply(T, centroid_b) - centroid_a, axis=-1)
        i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
        found.append(CornerPair(int(i), int(j), T))
    return found


def distinct(
    pairs: list[CornerPair], centre_b: NDArray[np.float64], metres: float, radians: float
) -> list[int]:
    """Indices of the pairs whose pose is no repetition of an earlier one: farther from all of those than
    `metres` at the centre of b, or turned by more than `radians`."""
    kept: list[int] = []
    for i, pair in enumerate(pairs):
        if all(_differ(pair.T_a_b, pairs[k].T_a_b, centre_b, metres, radians) for k in kept):
            kept.append(i)
    return kept


def _differ(T: Pose, other: Pose, centre_b: NDArray[np.float64], metres: float, radians: float) -> bool:
    moved = np.linalg.norm(se2.apply(T, centre_b) - se2.apply(other, centre_b))
    return bool(moved > metres or abs(se2.wrap(float(T[2] - other[2]))) > radians)


def _centroids(a: _core._Corners, b: _core._Corners) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For every corner of a (rows) and of b (columns): the centroid of vertex and arm ends in either map."""
    shared = np.minimum(a["lengths"][:, None, :], b["lengths"][None, :, :])
    ends_a = shared[..., :1] * a["arm0"][:, None, :] + shared[..., 1:] * a["arm1"][:, None, :]
    ends_b = shared[..., :1] * b["arm0"][None, :, :] + shared[..., 1:] * b["arm1"][None, :, :]
    return a["vertex"][:, None, :] + ends_a / 3, b["vertex"][None, :, :] + ends_b / 3
