"""Cases of a building that no weight was fitted to: MIT's Killian Court, corridors of up to 200 metres.

    pip download --no-deps rtb-data && unzip rtb_data-*.whl rtbdata/data/killian.g2o.zip
    python benchmarks/killian.py rtbdata/data/killian.g2o.zip target/killian
    MAPMELD_SHARED=target/killian python benchmarks/trust.py --only pairs same whole

The robot of the log (M. Bosse and others, MIT) drives 1.9 km on one floor; the poses are those of the file,
to which SLAM led. Maps are drawn of stretches of the log, no scan in two of them; places that it comes back
to are in maps of different hours. What failed here led to exact rotations, to the cells that large maps are
correlated in and to the generated corridors: it is no blind test of those.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import g2o_files
from drawn_cases import draw, stretches

RANGES = (8.0, 30.0)
"""Up to where returns are drawn, metres."""
STRETCHES = ((6, 0.2), (12, 0.2), (24, 0.3))
"""Maps that share the log, and how much of its stretch each shares with the next."""
RESOLUTION = 0.1
ASTRAY = slice(1730, 1845)
"""Scans left out: their poses slip along the corridor, up to 1.8 metres from those of other passes."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path, help="killian.g2o, zipped or not")
    parser.add_argument("output", type=Path, help="folder for the cases, new")
    args = parser.parse_args(argv)
    if not args.log.is_file():
        sys.exit(f"{args.log} is not there; the package rtb-data on PyPI has it as data/killian.g2o.zip")
    if args.output.exists():
        sys.exit(f"{args.output} is there already; name another folder")
    scans = g2o_files.read_scans(args.log)
    is_kept = np.ones(len(scans.poses), dtype=bool)
    is_kept[ASTRAY] = False
    scans = replace(scans, poses=scans.poses[is_kept], ranges=scans.ranges[is_kept])
    rng = np.random.default_rng(12)
    for farthest in RANGES:
        for maps, common in STRETCHES:
            parts = stretches(len(scans.poses), maps, common)
            folder = args.output / "data" / f"killian_{farthest:.0f}m_k{maps}"
            draw(scans, parts, farthest, RESOLUTION, rng, folder, "rtb-data: killian.g2o")


if __name__ == "__main__":
    main()
