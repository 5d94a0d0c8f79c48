"""The truth of a case, in the format that truth.json has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.simulate.drift import SeenCells, common_fit, fit_rigid, seen_cells
from mapmeld.simulate.options import WORLDS, SimulateOptions
from mapmeld.simulate.overlap import PlacedMap, overlap

_SOURCES = {
    "maze": "simulated maze-like arena of 1.2 m wall panels",
    "office": "simulated offices along corridors",
    "floor": "simulated floor of offices along many corridors",
    "cells": "simulated offices of one size along a corridor",
    "halls": "simulated halls along a corridor",
    "wings": "simulated building of equal wings along a corridor",
    "symmetric": "simulated block that a turn by 180 degrees takes to itself",
    "concourse": "simulated open floor of pillars and equal blocks",
    "warehouse": "simulated rows of racks",
    "home": "simulated home, furnished",
    "corridors": "simulated rings of long corridors",
}


@dataclass(frozen=True)
class RobotRun:
    """What one robot did.

    grid: its map. T_world_map: the true frame of the map.
    true_poses, map_poses: shape (scans, 3), (x, y, theta) of each scan in the world, and in the map.
    ranges: shape (scans, beams), metres. angles: shape (beams,), radians.
    """

    grid: OccupancyGrid
    T_world_map: NDArray[np.float64]
    true_poses: NDArray[np.float64]
    map_poses: NDArray[np.float64]
    ranges: NDArray[np.float64]
    angles: NDArray[np.float64]

    @property
    def seen(self) -> SeenCells:
        """The world cells its beams ended in."""
        return seen_cells(self.true_poses, self.map_poses, self.ranges, self.angles)


def truth_record(options: SimulateOptions, runs: Sequence[RobotRun]) -> dict[str, object]:
    """The truth of a case as JSON values.

    Poses are [x, y, theta] in metres and radians. In a case with drift, T_world_map is the frame of the first
    pose, T_world_map_fit the one that fits the whole path, and a pair's T_a_b is the least-squares rigid
    transform over the world cells both maps show, where these are enough, with its residual rms_m.
    """
    generated = options.world in WORLDS
    environment = f"{options.world}_{options.seed}" if generated else Path(options.world).stem
    resolutions = options.resolutions
    return {
        "source": _SOURCES[options.world] if generated else f"simulated in the map {environment}",
        "licence": "made by mapmeld simulate, no third-party content" if generated else "that of the map",
        "environment": environment,
        "truth": "exact (simulated)",
        "variant": "drift" if options.drift else "corrected",
        # Where the maps differ, each states its own.
        "resolution": resolutions[0] if len(resolutions) == 1 else None,
        "world": options.world,
        "seed": options.seed,
        "options": options.to_dict(),
        "maps": [_map_record(options, run) for run in runs],
        "pairs": _pair_records(options, runs),
    }


def _map_record(options: SimulateOptions, run: RobotRun) -> dict[str, object]:
    record: dict[str, object] = {
        "name": run.grid.name,
        "T_world_map": _pose(run.T_world_map),
        "scans": len(run.true_poses),
    }
    if len(options.resolutions) > 1:
        record["resolution"] = run.grid.resolution
    if options.drift:
        T_fit, rms = fit_rigid(run.map_poses[:, :2], run.true_poses[:, :2])
        record["drift_rms_m_after_fit"] = round(rms, 4)
        record["T_world_map_fit"] = _pose(T_fit)
    return record


def _pair_records(options: SimulateOptions, runs: Sequence[RobotRun]) -> list[dict[str, object]]:
    placed = [PlacedMap(run.grid, run.T_world_map) for run in runs]
    seen = [run.seen for run in runs] if options.drift else []
    records = []
    for i, a in enumerate(runs):
        for j in range(i + 1, len(runs)):
            T_first = se2.compose(se2.inverse(a.T_world_map), runs[j].T_world_map)
            record: dict[str, object] = {"a": a.grid.name, "b": runs[j].grid.name, "T_a_b": _pose(T_first)}
            other = placed[j]
            if options.drift and (fit := common_fit(seen[i], seen[j])) is not None:
                T_a_b, rms, cells = fit
                record |= {
                    "T_a_b": _pose(T_a_b),
                    "rms_m": round(rms, 4),
                    "common_cells": cells,
                    "T_a_b_first_pose": _pose(T_first),
                }
                other = PlacedMap(runs[j].grid, se2.compose(a.T_world_map, T_a_b))
            shared = overlap(placed[i], other)
            record |= {
                "overlap": round(shared.overlap, 4),
                "iou": round(shared.iou, 4),
                "overlap_occupied": round(shared.overlap_occupied, 4),
            }
            records.append(record)
    return records


def _pose(T: NDArray[np.float64]) -> list[float]:
    # Adding zero turns a negative zero into a plain one.
    return [round(float(v), 6) + 0.0 for v in (T[0], T[1], se2.wrap(float(T[2])))]
