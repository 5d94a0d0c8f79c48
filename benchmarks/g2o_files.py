"""Pose graphs in g2o's text format, with the laser scans that some of them carry."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from drawn_cases import Scans


def read_scans(path: Path) -> Scans:
    """The scans of a .g2o file, zipped or not, at the poses of their vertices; all of one aperture.

    A line ROBOTLASER1 is of the vertex before it: type, first angle, aperture, step, farthest, accuracy,
    remission mode, number of beams, the ranges (metres), and what is not needed here.
    """
    poses: list[list[float]] = []
    ranges: list[list[float]] = []
    angles: list[float] = []
    pose = None
    for line in _text(path).splitlines():
        words = line.split()
        if words[:1] == ["VERTEX_SE2"]:
            pose = [float(v) for v in words[2:5]]
        elif words[:1] == ["ROBOTLASER1"]:
            if pose is None:
                raise ValueError(f"{path}: a scan stands before all vertices")
            first, _, step, farthest = (float(v) for v in words[2:6])
            beams = int(words[8])
            if ranges and beams != len(ranges[0]):
                raise ValueError(f"{path}: scans of {len(ranges[0])} and of {beams} beams")
            found = [float(v) for v in words[9 : 9 + beams]]
            angles = [first + k * step for k in range(beams)]
            poses.append(pose)
            ranges.append([v if v < farthest else np.nan for v in found])
    if not poses:
        raise ValueError(f"{path}: no scan in it")
    return Scans(np.array(poses), np.array(ranges), np.array(angles))


def _text(path: Path) -> str:
    if path.suffix != ".zip":
        return path.read_text(encoding="utf-8")
    with zipfile.ZipFile(path) as z:
        names = [n for n in z.namelist() if n.endswith(".g2o") and not n.startswith("__MACOSX")]
        if not names:
            raise ValueError(f"{path}: no .g2o file in it")
        return z.read(names[0]).decode()
