"""How a merge of many maps grows: candidates, memory and time against maps, corners and particles.

    python benchmarks/scaling.py                              # floors of 10 to 100 maps
    python benchmarks/scaling.py --maps 100 300 1000 --corners --particles
    python benchmarks/scaling.py --case folder --cache DIR    # a simulated case that is on disk
    python benchmarks/scaling.py --dask                       # 1 and 2 workers, and a simulation of more

Every run is a process of its own, so that the peak memory is its own (getrusage). A floor has 100 square
metres for each map. Prints Markdown.
"""

from __future__ import annotations

import argparse
import heapq
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import bench_cases
import bench_report
import mapmeld
from complexity import fit
from mapmeld import se2
from mapmeld.simulate import simulate, write_case
from partners import floor_options

STAGES = ("spread", "prepare", "register", "filter", "join", "fuse", "merge")
RIGHT = 0.5
"""A map lies right when its centre is within so many metres of the truth, in the frame that most maps fit."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--maps", type=int, nargs="*", default=[10, 20, 50, 100])
    parser.add_argument("--corners", action="store_true", help="vary the corners of a map")
    parser.add_argument("--particles", action="store_true", help="vary the particles")
    parser.add_argument("--dask", action="store_true", help="1 and 2 workers, and a simulation")
    parser.add_argument("--held", type=int, default=50, help="maps where something else is varied")
    parser.add_argument("--case", type=Path, action="append", default=[], help="folder of a case")
    parser.add_argument("--cache", type=Path, help="folder of registered pairs, for all runs")
    parser.add_argument("--threads", type=int, help="of the core; all cores")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    if args.worker:
        print(json.dumps(measure(json.loads(args.worker))))
        return
    limits = [
        "Peak memory is the largest resident set of the process (getrusage), Python and the maps included.",
        f"Right: within {RIGHT} m of the truth in the frame that most maps of a component fit; wrong: placed "
        "with others and farther off. The other maps are alone.",
    ]
    text = bench_report.header("Scaling", limits, ("distributed",))
    with tempfile.TemporaryDirectory() as scratch:
        folders = [str(f) for f in args.case] or [_case(Path(scratch), n, args.seed) for n in args.maps]
        shared: dict[str, Any] = {"threads": args.threads, "cache": args.cache and str(args.cache)}
        if folders:
            runs = [_run({**shared, "case": folder}) for folder in folders]
            text += f"\n## Maps\n\n{_table(runs)}{_exponents(runs)}"
        held = (
            _case(Path(scratch), args.held, args.seed) if args.corners or args.particles or args.dask else ""
        )
        if args.corners:
            runs = [_run({**shared, "case": held, "corners": c}) for c in (5, 10, 20)]
            text += f"\n## Corners, at most\n\n{_table(runs)}"
        if args.particles:
            runs = [_run({**shared, "case": held, "particles": p}) for p in (25, 100, 400)]
            text += f"\n## Particles\n\n{_table(runs)}"
        if args.dask:
            text += f"\n## Workers\n\n{_workers(held)}"
    bench_report.write(text, args.output)


def _case(scratch: Path, maps: int, seed: int) -> str:
    folder = scratch / f"floor_{maps}_{seed}"
    if not folder.is_dir():
        bench_report.tell(f"simulating {maps} maps")
        write_case(simulate(floor_options(maps, seed)), folder)
    return str(folder)


def _run(what: dict[str, Any]) -> dict[str, Any]:
    """One merge in a process of its own."""
    command = [sys.executable, __file__, "--worker", json.dumps(what)]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    run: dict[str, Any] = json.loads(found.stdout)
    bench_report.tell(f"{run['maps']} maps, {run['pairs']} pairs: {run['seconds']['merge']:.1f} s")
    return run


def measure(what: dict[str, Any]) -> dict[str, Any]:
    """Merges a case; what it took and how much is right."""
    case = bench_cases.load(Path(what["case"]))
    config: dict[str, Any] = {}
    if "corners" in what:
        config = {"registration": {"max_corners": what["corners"]}}
    began = time.perf_counter()
    result = mapmeld.merge(
        case.maps,
        particles=what.get("particles"),
        threads=what.get("threads"),
        config=config,
        cache=what.get("cache"),
        dask=what.get("dask"),
    )
    seconds = {**result.seconds, "merge": time.perf_counter() - began}
    right, wrong = judged(result, case)
    sample = case.maps[:: max(1, len(case.maps) // 20)]
    return {
        "maps": len(case.maps),
        "corners": float(np.mean([len(mapmeld.features(g, config).corners.vertex) for g in sample])),
        "particles": result.config["filter"]["particles"],
        "pairs": len(result.pairs),
        "candidates": sum(p.candidates for p in result.pairs),
        "seconds": seconds,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "parts": len(result.components),
        "right": right,
        "wrong": wrong,
    }


def judged(result: mapmeld.MergeResult, case: bench_cases.Case) -> tuple[int, int]:
    """Maps placed right and wrong among those that were merged with others."""
    truth = {m["name"]: np.array(m["T_world_map"]) for m in case.truth["maps"]}
    right = wrong = 0
    for k, component in enumerate(result.components):
        placed = {m.name: m.T_component_map for m in result.maps if m.component == k}
        if len(component.order) < 2:
            continue
        best = 0
        for name, T in placed.items():
            T_world_component = se2.compose(truth[name], se2.inverse(T))
            errors = [_error(T_world_component, placed[m], truth[m], case.centres[m]) for m in placed]
            best = max(best, sum(e <= RIGHT for e in errors))
        right += best
        wrong += len(placed) - best
    return right, wrong


def _error(T_world_component: Any, T_component_map: Any, T_world_map: Any, centre: Any) -> float:
    point = np.array([centre])
    found = se2.apply(se2.compose(T_world_component, T_component_map), point)
    return float(np.hypot(*(found - se2.apply(T_world_map, point))[0]))


def _table(runs: Sequence[dict[str, Any]]) -> str:
    stages = [s for s in STAGES if any(s in r["seconds"] for r in runs)]
    rows = [
        (
            r["maps"],
            f"{r['corners']:.1f}",
            r["particles"],
            r["pairs"],
            r["candidates"],
            *(f"{r['seconds'].get(s, 0.0):.2f}" for s in stages),
            f"{r['peak_gb']:.2f}",
            r["parts"],
            r["right"],
            r["wrong"],
        )
        for r in runs
    ]
    columns = (
        "N",
        "c",
        "Np",
        "pairs",
        "candidates",
        *(f"{s} s" for s in stages),
        "peak GB",
        "parts",
        "right",
        "wrong",
    )
    return bench_report.table(columns, rows)


def _exponents(runs: Sequence[dict[str, Any]]) -> str:
    if len(runs) < 3:
        return ""
    n = [r["maps"] for r in runs]
    told = []
    for name in ("pairs", "register", "filter", "merge"):
        values = [r["pairs"] if name == "pairs" else r["seconds"].get(name, 0.0) for r in runs]
        slope, error = fit(n, values)
        told.append(f"{name} {slope:.2f} ± {error:.2f}")
    return f"\nExponents in N: {', '.join(told)}.\n"


def _workers(case: str) -> str:
    """Real workers, and from the tasks' measured costs how many would help."""
    import distributed

    from mapmeld.config import effective_config
    from mapmeld.spreading import BATCH, batches, register_batch

    rows = []
    for workers in (1, 2):
        with distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        ) as cluster:
            run = _run({"case": case, "dask": cluster.scheduler_address})
        rows.append((workers, f"{run['seconds']['spread']:.2f}", f"{run['seconds']['merge']:.2f}"))
    text = bench_report.table(("worker processes", "pairs s", "whole s"), rows)

    maps = bench_cases.load(Path(case)).maps
    config = json.dumps(effective_config({"threads": 1}))
    given = [(g.name, g.data, g.resolution, g.origin) for g in maps]
    began = time.perf_counter()
    plan = mapmeld._core.plan(given, config)
    planning = time.perf_counter() - began
    expected = mapmeld._core.registration_digest(config)
    costs = []
    for batch in batches(plan, BATCH):
        involved = sorted({m for pair in batch for m in pair[:2]})
        pairs = [(involved.index(a), involved.index(b), hints) for a, b, hints, _ in batch]
        began = time.perf_counter()
        register_batch([given[m] for m in involved], pairs, config, expected)
        costs.append(time.perf_counter() - began)
    joint = run["seconds"]["merge"] - run["seconds"]["spread"]
    rows = []
    for workers in (1, 2, 4, 8, 16, 32, 64):
        spread = makespan(costs, workers)
        whole = planning + spread + joint
        alone = planning + sum(costs) + joint
        rows.append((workers, f"{spread:.2f}", f"{whole:.2f}", f"{alone / whole:.1f}"))
    text += f"\nSimulated from the measured costs of {len(costs)} batches of {BATCH} pairs "
    text += f"(mean {np.mean(costs):.2f} s, largest {max(costs):.2f} s), 1 ms of the scheduler for each, "
    text += f"{planning:.2f} s of planning and {joint:.2f} s of the joint stage, which nobody shares:\n\n"
    return text + bench_report.table(("workers", "pairs s", "whole s", "times as fast"), rows)


def makespan(costs: Sequence[float], workers: int, scheduling: float = 1e-3) -> float:
    """When the last of some tasks ends that are handed out in turn, each to the worker that is free first."""
    free = [0.0] * workers
    handed = 0.0
    for cost in costs:
        handed += scheduling
        heapq.heappush(free, max(heapq.heappop(free), handed) + cost)
    return max(free)


if __name__ == "__main__":
    main()
