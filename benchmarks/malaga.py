"""Cases of a building that no weight was fitted to, for benchmarks/trust.py.

    python benchmarks/malaga.py /usr/share/mrpt/datasets target/malaga
    MAPMELD_SHARED=target/malaga python benchmarks/trust.py --only pairs same whole

MRPT's example data (Debian: mrpt-common) hold a laser log of a hall with round pillars in Malaga, with poses
by SLAM, and a grid map of the campus about it: four wings alike, a hundred metres long, and rows of pillars.
Maps are drawn of stretches of the log, no scan in two of them, and of robots that drive in the grid map. What
failed here led to the second round of rotations and to the generated concourse: it is no blind test of those.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import mrpt_files
from drawn_cases import Scans, draw, stretches
from mapmeld import OccupancyGrid
from mapmeld.map_io import write_map
from mapmeld.simulate import SimulateOptions, simulate, write_case

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
    is_silent = (scans.ranges <= NOTHING_TO) | (scans.ranges > NOTHING_FROM)
    scans = replace(scans, ranges=np.where(is_silent, np.nan, scans.ranges))
    source = "MRPT's example data: malaga-cs-fac-building.simplemap"
    for farthest in RANGES:
        for maps, common in STRETCHES:
            parts = stretches(len(scans.poses), maps, common)
            folder = cases / f"malaga_{farthest:.0f}m_k{maps}"
            draw(scans, parts, farthest, RESOLUTION, rng, folder, source)


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
