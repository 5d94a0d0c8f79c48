"""Two other ways to merge two maps, for comparison: stitching by image features, and exhaustive correlation.

Written from what their authors publish, on top of OpenCV (opencv-python-headless) and numpy.
"""

from __future__ import annotations

import ctypes.util
import importlib.util
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mapmeld
import trust_cases
import trust_merges
import trust_score
from mapmeld import se2
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN
from trust_cases import MapPair

FEATURES = ("orb", "akaze")
METHODS = (*FEATURES, "fft")
ACCEPTED_CONFIDENCE = 1.0
"""Of the ROS node multirobot_map_merge, by default (estimation_confidence)."""
_COARSE, _COARSER, _LARGE = 0.2, 0.4, 60.0
"""Sides in metres of the cells for correlation: the second where a map is longer than the third."""
_GREY = {UNKNOWN: 205, FREE: 254, OCCUPIED: 0}

Found = tuple[NDArray[np.float64] | None, float]
"""T_a_b, None where there is none, and the method's score for it."""


def missing() -> list[str]:
    """What cannot be measured here, a sentence each."""
    lines = []
    if importlib.util.find_spec("cv2") is None:
        lines.append(
            "Stitching by features is not measured: opencv-python-headless (below 5) is not installed."
        )
    where = ctypes.util.find_library("mrpt-slam") or ctypes.util.find_library("mrpt_slam")
    state = "is on this machine, but this script does not drive it" if where else "is not on this machine"
    lines.append(f"MRPT's grid map aligner is not measured: libmrpt-slam {state}.")
    return lines


def methods() -> tuple[str, ...]:
    """Those that can run here."""
    return METHODS if importlib.util.find_spec("cv2") is not None else ("fft",)


@dataclass(frozen=True)
class PeerMatch:
    """One method on one pair."""

    method: str
    pair: MapPair

    def run(self) -> trust_merges.Row:
        a = trust_cases.grid(self.pair.a.path, "a")
        b = trust_cases.grid(self.pair.b.path, "b")
        started = time.process_time()
        T, score = correlate(a, b) if self.method == "fft" else stitch(a, b, self.method)
        cpu = time.process_time() - started
        verdict = trust_merges.judged(self.pair, T)
        return {
            **trust_merges.pair_facts(self.pair),
            "method": self.method,
            "score": score,
            "found": T is not None,
            "accepted": None if self.method == "fft" else T is not None and score >= ACCEPTED_CONFIDENCE,
            **trust_score.verdict_fields(verdict, T is not None),
            "cpu": cpu,
        }


def stitch(a: mapmeld.OccupancyGrid, b: mapmeld.OccupancyGrid, feature: str) -> Found:
    """As the ROS node does: features of both pictures, the best of two nearest matches each, a similarity
    transform by RANSAC, whose confidence is inliers / (8 + 0.3 matches). The coarser map is enlarged to the
    finer one's cells, which the node leaves to its user."""
    cv2: Any = importlib.import_module("cv2")
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    finder = cv2.ORB_create() if feature == "orb" else cv2.AKAZE_create()
    cell = min(a.resolution, b.resolution)
    seen = []
    for g in (b, a):
        picture = _picture(g)
        k = g.resolution / cell
        if k > 1.0:
            picture = cv2.resize(picture, None, fx=k, fy=k, interpolation=cv2.INTER_NEAREST)
        seen.append(cv2.detail.computeImageFeatures2(finder, picture))
    if any(len(s.getKeypoints()) < 2 for s in seen):
        return None, 0.0
    try:
        match = cv2.detail_AffineBestOf2NearestMatcher(False, False).apply(*seen)
    except cv2.error:
        return None, 0.0
    H = None if match.H is None else np.asarray(match.H, dtype=np.float64)
    if H is None or H.size == 0:
        return None, float(match.confidence)
    # Pixel centres to metres from the grid's corner; the scale that the fit took is dropped at b's centre.
    height, width = _picture(b).shape
    middle = np.array([width * b.resolution, height * b.resolution]) / 2
    image = (H[:2, :2] @ (middle / cell - 0.5) + H[:2, 2] + 0.5) * cell
    theta = math.atan2(H[1, 0], H[0, 0])
    shift = image - se2.apply((0.0, 0.0, theta), middle)
    return _in_maps(a, b, np.array([shift[0], shift[1], theta])), float(match.confidence)


def correlate(a: mapmeld.OccupancyGrid, b: mapmeld.OccupancyGrid) -> Found:
    """Every whole degree and every shift of b over a, in coarse cells, by Fourier transform: walls on walls
    count for, walls on free floor against; the best, and its score as a share of the smaller map's walls."""
    longest = max(max(g.width, g.height) * g.resolution for g in (a, b))
    cell = _COARSER if longest > _LARGE else _COARSE
    layers_a = _layers(a, cell)
    walls_b, free_b = _points(b)
    if not len(walls_b) or not layers_a[2]:
        return None, 0.0
    middle = np.vstack([walls_b, free_b]).mean(axis=0)
    reach = float(np.hypot(*(np.vstack([walls_b, free_b]) - middle).T).max())
    side_b = 2 * math.ceil(reach / cell) + 3
    shape = tuple(_fast_length(n + side_b) for n in layers_a[0].shape)
    spectra = [np.fft.rfft2(layer, shape) for layer in layers_a[:2]]
    smaller = min(layers_a[2], len(np.unique(np.floor(walls_b / cell).astype(int), axis=0)))
    best: tuple[float, float, tuple[int, int]] = (-math.inf, 0.0, (0, 0))
    for degree in range(360):
        theta = math.radians(degree)
        grids = []
        for points in (walls_b, free_b):
            turned = se2.apply((0.0, 0.0, theta), points - middle)
            cells = np.floor(turned / cell).astype(int) + side_b // 2
            layer = np.zeros((side_b, side_b), dtype=np.float32)
            layer[cells[:, 1], cells[:, 0]] = 1.0
            grids.append(layer)
        grids[1][grids[0] > 0] = 0.0
        walls, free = (np.conj(np.fft.rfft2(layer, shape)) for layer in grids)
        # spectra[0]: a's walls, widened, less its free floor; spectra[1]: its walls.
        score = np.fft.irfft2(spectra[0] * walls - 0.5 * spectra[1] * free, shape)
        row, col = divmod(int(np.argmax(score)), shape[1])
        if score[row, col] > best[0]:
            best = (float(score[row, col]), theta, (row, col))
    value, theta, (row, col) = best
    row, col = (v - n if v >= n - side_b else v for v, n in zip((row, col), shape, strict=True))
    corner = np.array([col + side_b // 2, row + side_b // 2]) * cell
    shift = corner - se2.apply((0.0, 0.0, theta), middle)
    T = np.array([shift[0], shift[1], theta])
    return _in_maps(a, b, T), value / smaller


def _layers(g: mapmeld.OccupancyGrid, cell: float) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
    """Coarse rasters: walls widened by half their weight less half of free floor; walls; how many."""
    walls, free = _points(g)
    size = (math.ceil(g.height * g.resolution / cell) + 2, math.ceil(g.width * g.resolution / cell) + 2)
    rasters = []
    for points in (walls, free):
        raster = np.zeros(size, dtype=np.float32)
        cells = np.floor(points / cell).astype(int)
        raster[cells[:, 1], cells[:, 0]] = 1.0
        rasters.append(raster)
    wall, floor = rasters
    wide = wall.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        wide = np.maximum(wide, 0.5 * np.roll(wall, step, axis))
    floor[wide > 0] = 0.0
    return wide - 0.5 * floor, wall, int(wall.sum())


def _points(g: mapmeld.OccupancyGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of walls and of free cells in metres from the grid's corner, along its axes."""
    found = []
    for cells in (g.data >= 65, (g.data >= 0) & (g.data <= 25)):
        rows, cols = np.nonzero(cells)
        found.append((np.column_stack([cols, rows]) + 0.5) * g.resolution)
    return found[0], found[1]


def _picture(g: mapmeld.OccupancyGrid) -> NDArray[np.uint8]:
    """The map as map_saver would draw it, row 0 at the lowest y."""
    picture = np.full(g.data.shape, _GREY[UNKNOWN], dtype=np.uint8)
    picture[(g.data >= 0) & (g.data <= 25)] = _GREY[FREE]
    picture[g.data >= 65] = _GREY[OCCUPIED]
    return picture


def _in_maps(
    a: mapmeld.OccupancyGrid, b: mapmeld.OccupancyGrid, T_grids: NDArray[np.float64]
) -> NDArray[np.float64]:
    """T_a_b in map coordinates from the one between the grids' corners."""
    return se2.compose(se2.compose(a.origin, T_grids), se2.inverse(b.origin))


def _fast_length(least: int) -> int:
    """The smallest length from `least` on that is made of 2, 3 and 5 only."""
    while True:
        rest = least
        for k in (2, 3, 5):
            while rest % k == 0:
                rest //= k
        if rest == 1:
            return least
        least += 1
