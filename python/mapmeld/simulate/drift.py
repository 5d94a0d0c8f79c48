"""Odometry drift: a path put together again from its relative motions plus noise, and what that bends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2

# Random walks of a light drift (drift = 1): standard deviations after one metre, and after one radian.
_STEP = 0.003
_YAW_PER_METRE = math.radians(0.15)
_YAW_PER_RADIAN = math.radians(0.08)

_CELL = 0.1
"""Side in metres of the world cells in which two maps are compared."""
_LEAST_COMMON = 30
"""World cells below which two maps show too little in common for a fit."""


def drifted(poses: NDArray[np.float64], drift: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """The path that odometry believes in; its first pose is exact.

    poses: shape (n, 3), (x, y, theta) in metres and radians.
    drift: scale of the noise; its standard deviations grow with the root of the way driven and turned: for
        drift = 1, 3 mm along and across and 0.15 degrees for one metre, 0.08 degrees for one radian turned.
    """
    moved = np.diff(poses[:, :2], axis=0)
    turned = np.diff(poses[:, 2])
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    distance = np.hypot(moved[:, 0], moved[:, 1])
    noise = rng.normal(size=(len(turned), 3)) * drift
    root = np.sqrt(distance)
    forward = c * moved[:, 0] + s * moved[:, 1] + noise[:, 0] * _STEP * root
    sideways = -s * moved[:, 0] + c * moved[:, 1] + noise[:, 1] * _STEP * root
    yaw_sigma = np.sqrt(_YAW_PER_METRE**2 * distance + _YAW_PER_RADIAN**2 * np.abs(turned))
    theta = poses[0, 2] + np.concatenate([[0.0], np.cumsum(turned + noise[:, 2] * yaw_sigma)])
    c, s = np.cos(theta[:-1]), np.sin(theta[:-1])
    steps = np.stack([c * forward - s * sideways, s * forward + c * sideways], axis=-1)
    points = poses[0, :2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([points, theta])


def fit_rigid(
    points_b: NDArray[np.float64], points_a: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """The least-squares T_a_b that takes points_b to points_a, both of shape (n, 2), and its rms, metres."""
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    a, b = points_a - mean_a, points_b - mean_b
    theta = math.atan2(float((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum()), float((a * b).sum()))
    shift = mean_a - se2.apply((0.0, 0.0, theta), mean_b)
    T = np.array([shift[0], shift[1], theta])
    residual = se2.apply(T, points_b) - points_a
    return T, math.sqrt(float((residual**2).sum(axis=1).mean()))


@dataclass(frozen=True)
class SeenCells:
    """The world cells that one robot's beams ended in, and where its map shows them.

    index: shape (n, 2), int64, unique, sorted: column and row of each cell in the world.
    shown: shape (n, 2): map coordinates in metres of each cell's centre, the mean over the beams.
    """

    index: NDArray[np.int64]
    shown: NDArray[np.float64]


def seen_cells(
    true_poses: NDArray[np.float64],
    map_poses: NDArray[np.float64],
    ranges: NDArray[np.float64],
    angles: NDArray[np.float64],
) -> SeenCells:
    """The world cells of a robot's hits.

    true_poses, map_poses: shape (scans, 3), where a scan was taken in the world, and where the map puts it.
    ranges: shape (scans, beams), metres; angles: shape (beams,), radians.
    """
    scan, beam = np.nonzero(np.isfinite(ranges))
    direction = true_poses[scan, 2] + angles[beam]
    hits = true_poses[scan, :2] + ranges[scan, beam, None] * np.stack(
        [np.cos(direction), np.sin(direction)], axis=-1
    )
    index, inverse, counts = np.unique(
        np.floor(hits / _CELL).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    inverse = inverse.reshape(-1)
    centre = (index[inverse] + 0.5) * _CELL - true_poses[scan, :2]
    # The map shows the cell where the scan's pose error takes it.
    turn = map_poses[scan, 2] - true_poses[scan, 2]
    c, s = np.cos(turn), np.sin(turn)
    shown_x = map_poses[scan, 0] + c * centre[:, 0] - s * centre[:, 1]
    shown_y = map_poses[scan, 1] + s * centre[:, 0] + c * centre[:, 1]
    shown = np.stack([np.bincount(inverse, v) / counts for v in (shown_x, shown_y)], axis=-1)
    return SeenCells(index, shown)


def common_fit(a: SeenCells, b: SeenCells) -> tuple[NDArray[np.float64], float, int] | None:
    """(T_a_b, rms in metres, number of cells) of the least-squares rigid fit over the cells both maps show.

    None where they show too few in common.
    """
    row_b = {(int(c), int(r)): k for k, (c, r) in enumerate(b.index)}
    pairs = [(k, row_b[key]) for k, (c, r) in enumerate(a.index) if (key := (int(c), int(r))) in row_b]
    if len(pairs) < _LEAST_COMMON:
        return None
    in_a, in_b = np.array(pairs).T
    T, rms = fit_rigid(b.shown[in_b], a.shown[in_a])
    return T, rms, len(pairs)
