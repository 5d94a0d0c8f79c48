"""What MRPT's programs save, gzipped: a grid map, and a map of key frames with their laser scans."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np

from drawn_cases import Scans
from mapmeld import OccupancyGrid, se2
from mapmeld.grid import FREE, OCCUPIED, UNKNOWN

_FREE_FROM, _OCCUPIED_TO = 7, -7
"""Log-odds of being free, in sixteenths: probabilities of 0.6 and 0.4."""


def read_grid(path: Path, name: str) -> OccupancyGrid:
    """The grid of a .gridmap.gz file."""
    data = gzip.decompress(path.read_bytes())
    at = _behind(data, b"COccupancyGridMap2D", 0) + 2
    width, height = struct.unpack_from("<2I", data, at)
    x, _, y, _, resolution = struct.unpack_from("<5f", data, at + 8)
    odds = np.frombuffer(data, np.int8, width * height, at + 28).reshape(height, width)
    cells = np.full(odds.shape, UNKNOWN, np.int8)
    cells[odds >= _FREE_FROM] = FREE
    cells[odds <= _OCCUPIED_TO] = OCCUPIED
    return OccupancyGrid(cells, float(np.round(resolution, 6)), (float(x), float(y), 0.0), name)


def read_scans(path: Path) -> Scans:
    """The key frames of a .simplemap.gz file, each with one scan from right to left, all of one aperture."""
    data = gzip.decompress(path.read_bytes())
    poses, ranges, at, aperture = [], [], 0, 0.0
    while (at := data.find(b"CPose3DPDFGaussian", at)) >= 0:
        robot, _ = _pose(data, at + 18)
        at = _behind(data, b"CObservation2DRangeScan", at)
        (aperture,) = struct.unpack_from("<f", data, at + 1)
        laser, at = _pose(data, at)
        (beams,) = struct.unpack_from("<I", data, at + 1)
        poses.append(se2.compose(robot, laser))
        ranges.append(np.frombuffer(data, np.float32, beams, at + 5).astype(np.float64))
    angles = np.linspace(-aperture / 2, aperture / 2, len(ranges[0]))
    return Scans(np.array(poses), np.array(ranges), angles)


def _behind(data: bytes, name: bytes, start: int) -> int:
    """Where the version of the next object of a class stands."""
    return data.index(name, start) + len(name)


def _pose(data: bytes, start: int) -> tuple[tuple[float, float, float], int]:
    """The next pose as (x, y, theta), and where it ends: x, y, z and a quaternion about the upright axis."""
    at = _behind(data, b"CPose3D", start) + 1
    x, y, _, w, _, _, z = struct.unpack_from("<7d", data, at)
    return (x, y, 2.0 * float(np.arctan2(z, w))), at + 56
