"""Cases drawn of one robot's laser scans: maps of stretches of its way, as if each were of another robot."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapmeld import OccupancyGrid, se2
from mapmeld.map_io import write_map
from mapmeld.simulate.overlap import PlacedMap, overlap
from mapmeld.simulate.tracing import trace_map

Placed = tuple[OccupancyGrid, tuple[float, float, float]]
"""A map and its T_world_map, metres and radians."""


@dataclass(frozen=True)
class Scans:
    """Laser scans and where they were taken.

    poses: shape (scans, 3), T_world_laser as (x, y, theta) in metres and radians. ranges: shape
    (scans, beams), metres; nan where a beam tells nothing. angles: shape (beams,), of the beams, radians.
    """

    poses: NDArray[np.float64]
    ranges: NDArray[np.float64]
    angles: NDArray[np.float64]


def stretches(scans: int, maps: int, common: float) -> list[list[int]]:
    """Scans of each map: neighbours share a part of their stretch, whose scans are dealt in turn."""
    length = scans / (maps - (maps - 1) * common)
    starts = [k * length * (1.0 - common) for k in range(maps)]
    reach = [range(round(s), min(scans, round(s + length))) for s in starts]
    owners = {i: [k for k, r in enumerate(reach) if i in r] for i in range(scans)}
    return [[i for i, of in owners.items() if of and of[i % len(of)] == k] for k in range(maps)]


def draw(
    scans: Scans,
    parts: list[list[int]],
    farthest: float,
    resolution: float,
    rng: np.random.Generator,
    folder: Path,
    source: str,
) -> None:
    """Writes a case of maps, each in a random frame; returns from beyond the farthest are not drawn."""
    ranges = np.where(scans.ranges > farthest, np.inf, scans.ranges)
    placed: list[Placed] = []
    for k, part in enumerate(parts):
        x, y = scans.poses[part[0], :2] + rng.uniform(-10.0, 10.0, 2)
        frame = tuple(float(v) for v in np.round([x, y, rng.uniform(-math.pi, math.pi)], 6))
        poses = np.array([se2.compose(se2.inverse(frame), p) for p in scans.poses[part]])
        offset = tuple(float(v) for v in rng.uniform(size=2))
        name = f"{k:02d}_r{k}"
        grid = trace_map(poses, ranges[part], scans.angles, farthest, resolution, name=name, offset=offset)
        placed.append((grid, frame))
    folder.mkdir(parents=True)
    for grid, _ in placed:
        write_map(folder / f"{grid.name}.yaml", grid)
    truth = {
        "source": source,
        "truth": "poses that came with the scans",
        "maps": [{"name": g.name, "T_world_map": t} for g, t in placed],
        "pairs": _pair_records(placed),
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def _pair_records(placed: list[Placed]) -> list[dict[str, object]]:
    maps = [PlacedMap(g, np.array(t)) for g, t in placed]
    found: list[dict[str, object]] = []
    for j in range(len(placed)):
        for i in range(j):
            common = overlap(maps[i], maps[j])
            pose = se2.compose(se2.inverse(placed[i][1]), placed[j][1])
            found.append(
                {
                    "a": placed[i][0].name,
                    "b": placed[j][0].name,
                    "T_a_b": [round(float(v), 6) for v in pose],
                    "overlap": round(common.overlap, 4),
                    "iou": round(common.iou, 4),
                    "overlap_occupied": round(common.overlap_occupied, 4),
                }
            )
    return found
