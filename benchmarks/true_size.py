"""How well a map of a wrong size is noticed: two maps of a building, the second said to be of other cells.

    python benchmarks/true_size.py
    python benchmarks/true_size.py --every 4

Recorded pairs that share a quarter of their walls, in $MAPMELD_SHARED/data (by default ../shared/data as seen
from the repository), merged as two maps alone. Hand-held maps (Halmstad) are told apart: they are bent.
Prints Markdown.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import bench_report
import mapmeld
import trust_cases
from mapmeld.true_size import wrong_sizes

TIMES = (0.95, 0.96, 0.98, 1.0, 1.02, 1.04, 1.05)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--every", type=int, default=1, help="take every so manieth pair")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    pairs = [p for f in trust_cases.folders(None) for p in trust_cases.pairs(f) if p.band and p.walls >= 0.25]
    rows = []
    for hand_held in (False, True):
        some = [p for p in pairs if ("halmstad" in p.a.case) == hand_held][:: args.every]
        rows += [_row("hand-held" if hand_held else "laser", some, times) for times in TIMES]
    columns = ("maps", "cells said to be", "pairs", "merged", "told of", "size found, median", "90 % within")
    bench_report.write(
        bench_report.header("True size") + "\n" + bench_report.table(columns, rows), args.output
    )


def _row(kind: str, pairs: list[trust_cases.MapPair], times: float) -> tuple[str, ...]:
    merged = told = 0
    found = []
    for p in pairs:
        a, b = trust_cases.grid(p.a.path, "a"), trust_cases.grid(p.b.path, "b")
        x, y, theta = b.origin
        b = mapmeld.OccupancyGrid(b.data, b.resolution * times, (x * times, y * times, theta), "b")
        result = mapmeld.merge([a, b], seed=1)
        (pair,) = result.pairs
        if pair.status != "merged":
            continue
        merged += 1
        told += bool(wrong_sizes(result.pairs))
        found += [] if pair.scale is None else [pair.scale * times]
    off = np.abs(np.array(found) - 1.0)
    return (
        kind,
        f"{times:g}",
        str(len(pairs)),
        str(merged),
        str(told),
        f"{np.median(found) / times:.3f}" if found else "-",
        f"{np.percentile(off, 90):.3f}" if found else "-",
    )


if __name__ == "__main__":
    main()
