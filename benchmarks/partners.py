"""How many of the pairs that share walls the index of partners proposes.

    python benchmarks/partners.py                # simulated floors, and the shared recorded cases
    python benchmarks/partners.py --maps 30      # smaller floors, for a test of this script

A pair is proposed with K partners when either map is among the K most promising ones of the other. Recorded
cases are searched among the maps of all other buildings and of a simulated floor.
Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bench_cases
import bench_report
import mapmeld
from mapmeld import _core
from mapmeld.config import effective_config
from mapmeld.simulate import SimulateOptions, simulate

CLASSES = {"a quarter and more": (0.25, 1.01), "5 to 25 %": (0.05, 0.25)}
PARTNERS = (8, 16, 24, 32)
SIDE_OF_A_MAP = 10.0
"""A floor has so many metres squared for each of its maps."""


def floor_options(maps: int, seed: int, world: str = "floor", **others: Any) -> SimulateOptions:
    """A floor as large as so many maps need, each of which overlaps a few others."""
    side = max(24.0, SIDE_OF_A_MAP * math.sqrt(maps))
    others = {"resolution": 0.1, **others}
    return SimulateOptions(world=world, size=(side, side), robots=maps, seed=seed, **others)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--maps", type=int, default=100, help="maps of a simulated floor")
    parser.add_argument("--case", type=Path, action="append", default=[], help="further folder of a case")
    parser.add_argument("--no-recorded", action="store_true", help="leave the recorded cases out")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    rows: list[Any] = []
    floors = {
        "floor": floor_options(args.maps, 11),
        "floor, light drift": floor_options(args.maps, 12, drift=1.0),
        "floor, 0.05 m cells": floor_options(args.maps, 13, resolution=0.05),
        "maze": SimulateOptions(
            world="maze", size=(30.0, 30.0), robots=args.maps, seed=14, density=0.8, region_radius=4.0
        ),
    }
    strangers: list[Any] = []
    for name, options in floors.items():
        bench_report.tell(f"simulating {name}")
        case = simulate(options)
        maps = prepared(case.maps)
        if name == "floor":
            strangers = list(maps.values())[:50]
        rows += measure(name, maps, case.truth["pairs"], [])
    for folder in args.case:
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        grids = [mapmeld.read_map(folder / f"{m['name']}.yaml") for m in truth["maps"]]
        rows += measure(folder.name, prepared(grids), truth["pairs"], [])
    if not args.no_recorded and bench_cases.shared_data().is_dir():
        rows += recorded(strangers)
    limits = ["Shares of walls as `truth.json` has them (`overlap_occupied`)."]
    columns = ("case", "maps", "walls in common", "pairs", *(f"K = {k}" for k in PARTNERS), "index s")
    text = bench_report.header("Partners that the index proposes", limits)
    bench_report.write(f"{text}\n{bench_report.table(columns, rows)}", args.output)


def prepared(grids: Sequence[mapmeld.OccupancyGrid]) -> dict[str, _core.LocalMap]:
    """The maps by their names, prepared."""
    config = json.dumps(effective_config({}))
    return {g.name: _core.LocalMap(g.name, g.data, g.resolution, g.origin, config) for g in grids}


def recorded(strangers: list[Any]) -> list[Any]:
    """All shared cases, each among the maps of the other buildings."""
    cases: dict[str, Any] = {}
    for folder in sorted(p.parent for p in bench_cases.shared_data().glob("*/truth.json")):
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        grids = [mapmeld.read_map(folder / f"{m['name']}.yaml") for m in truth["maps"]]
        cases[folder.name] = (truth, prepared(grids), folder.name.split("_")[0])
    rows = []
    for name, (truth, maps, building) in cases.items():
        others = [m for _, ms, b in cases.values() if b != building for m in ms.values()]
        rows += measure(name, maps, truth["pairs"], [*others, *strangers])
    return rows


def measure(name: str, maps: dict[str, Any], pairs: Any, strangers: list[Any]) -> list[Any]:
    """A row for each share of walls."""
    began = time.perf_counter()
    found = _core.partners([*maps.values(), *strangers], json.dumps(effective_config({})))
    seconds = time.perf_counter() - began
    names = list(maps)
    index = {n: k for k, n in enumerate(names)}
    rank = [{other: r for r, (other, _) in enumerate(of_map)} for of_map in found]
    rows = []
    for told, (least, most) in CLASSES.items():
        of_class = [p for p in pairs if least <= p.get("overlap_occupied", 0.0) < most]
        if not of_class:
            continue
        best = []
        for p in of_class:
            a, b = index[p["a"]], index[p["b"]]
            best.append(min(rank[a].get(b, len(found)), rank[b].get(a, len(found))))
        recall = [sum(r < k for r in best) / len(best) for k in PARTNERS]
        rows.append(
            (
                name,
                len(found),
                told,
                len(of_class),
                *(f"{100 * r:.1f}" for r in recall),
                f"{seconds:.2f}",
            )
        )
        bench_report.tell(" ".join(map(str, rows[-1])))
    return rows


if __name__ == "__main__":
    main()
