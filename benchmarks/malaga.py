"""Cases of a building that no weight was fitted to, for benchmarks/trust.py.

    python benchmarks/malaga.py /usr/share/mrpt/datasets target/malaga
    MAPMELD_SHARED=target/malaga python benchmarks/trust.py --only pairs same

MRPT's example data (Debian: mrpt-common) hold a laser log of a hall with round pillars in Malaga, with poses
by SLAM, and a grid map of the campus about it: four wings alike, a hundred metres long, and rows of pillars.
Maps are drawn of stretches of the log, no scan in two of them, and of robots that drive in the grid map. What
failed here led to the second round of rotations and to the generated concourse: it is no blind test of those.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import mrpt_files
from mapmeld import OccupancyGrid, se2
from mapmeld.map_io import write_map
from mapmeld.simulate import SimulateOptions, simulate, write_case
from mapmeld.simulate.overlap import PlacedMap, overlap
from mapmeld.simulate.tracing import trace_map
from mrpt_files import Scans

NOTHING_FROM, NOTHING_TO = 79.0, 0.05
"""Ranges in metres from which, and to which, the scanner saw nothing."""
RANGES = (8.0, 15.0, 40.0)
"""Up to where returns are drawn, metres."""
STRETCHES = ((2, 0.3), (4, 0.3), (6, 0.3), (9, 0.4))
"""Maps that share the log, and how much of its stretch each shares with the next."""
RESOLUTION = 0.05
DRIVES = 8


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("datasets", type=Path, help="folder of MRPT's example data")
    parser.add_argument("output", type=Path, help="folder for the cases, new")
    args = parser.parse_args(argv)
    log = args.datasets / "malaga-cs-fac-building.simplemap.gz"
    campus = args.datasets / "2006-MalagaCampus.gridmap.gz"
    if missing := [p for p in (log, campus) if not p.is_file()]:
        sys.exit(
            f"{missing[0]} is not there; Debian's package mrpt-common has it in /usr/share/mrpt/datasets"
        )
    if args.output.exists():
        sys.exit(f"{args.output} is there already; name another folder")
    cases = args.output / "data"
    recorded(mrpt_files.read_scans(log), cases)
    driven(mrpt_files.read_grid(campus, "campus"), args.output)


def recorded(scans: Scans, cases: Path) -> None:
    """Cases of stretches of the log."""
    rng = np.random.default_rng(11)
    for farthest in RANGES:
        for maps, common in STRETCHES:
            parts = stretches(len(scans.poses), maps, common)
            draw(scans, parts, farthest, rng, cases / f"malaga_{farthest:.0f}m_k{maps}")


def stretches(scans: int, maps: int, common: float) -> list[list[int]]:
    """Scans of each map: neighbours share a part of their stretch, whose scans are dealt in turn."""
    length = scans / (maps - (maps - 1) * common)
    starts = [k * length * (1.0 - common) for k in range(maps)]
    reach = [range(round(s), min(scans, round(s + length))) for s in starts]
    owners = {i: [k for k, r in enumerate(reach) if i in r] for i in range(scans)}
    return [[i for i, of in owners.items() if of and of[i % len(of)] == k] for k in range(maps)]


def draw(
    scans: Scans, parts: list[list[int]], farthest: float, rng: np.random.Generator, folder: Path
) -> None:
    """Writes a case of maps, each in a random frame."""
    ranges = np.where(scans.ranges > farthest, np.inf, scans.ranges)
    ranges[(scans.ranges <= NOTHING_TO) | (scans.ranges > NOTHING_FROM)] = np.nan
    placed: list[tuple[OccupancyGrid, tuple[float, float, float]]] = []
    for k, part in enumerate(parts):
        x, y = scans.poses[part[0], :2] + rng.uniform(-10.0, 10.0, 2)
        frame = tuple(float(v) for v in np.round([x, y, rng.uniform(-math.pi, math.pi)], 6))
        poses = np.array([se2.compose(se2.inverse(frame), p) for p in scans.poses[part]])
        offset = tuple(float(v) for v in rng.uniform(size=2))
        name = f"{k:02d}_r{k}"
        grid = trace_map(poses, ranges[part], scans.angles, farthest, RESOLUTION, name=name, offset=offset)
        placed.append((grid, frame))
    folder.mkdir(parents=True)
    for grid, _ in placed:
        write_map(folder / f"{grid.name}.yaml", grid)
    truth = {
        "source": "MRPT's example data: malaga-cs-fac-building.simplemap",
        "truth": "poses of the key frames",
        "maps": [{"name": g.name, "T_world_map": t} for g, t in placed],
        "pairs": pair_records(placed),
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def pair_records(
    placed: list[tuple[OccupancyGrid, tuple[float, float, float]]],
) -> list[dict[str, object]]:
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


def driven(campus: OccupancyGrid, folder: Path) -> None:
    """Cases of robots on the campus: some stay near, some see far, some are bent."""
    (folder / "world").mkdir()
    world = folder / "world" / "campus.yaml"
    write_map(world, campus)
    for seed in range(DRIVES):
        options = SimulateOptions(
            world=str(world),
            seed=seed,
            robots=6,
            region_radius=(15.0, 25.0, 40.0)[seed % 3],
            path_length=(80.0, 120.0, 150.0)[seed % 3],
            max_range=(8.0, 15.0)[seed % 2],
            drift=(0.0, 0.0, 1.0)[seed % 3],
        )
        write_case(simulate(options), folder / "data" / f"campus_s{seed}")


if __name__ == "__main__":
    main()
