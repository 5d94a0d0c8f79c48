"""An estimator under maps that grow: right in the end, ever wrong, how still, how fast?

    python benchmarks/robots.py
    python benchmarks/robots.py --case mazeA_k10 --steps 30 --seeds 3 --idle 300

Every map of a case is revealed step by step, from a place in it that the seed draws outwards; all robots
grow at once, in every step one map update each and then one estimate. After each estimate all transforms
between robots of one component are held against the truth. In the end the maps are said to be done. `--idle`
further updates, of one robot each, follow, to see whether memory stays flat; `--one-by-one` estimates after
every single update, to see how long one takes. Cases are those of $MAPMELD_SHARED/data and the bundled ones.
Prints Markdown.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import bench_cases
import bench_report
from mapmeld import Estimate, Estimator, OccupancyGrid, se2
from mapmeld.known_cells import known_cells
from robots_growth import Growth

CASES = ("mazeA_k10", "intel_k10_drift")
WRONG_M, WRONG_DEG = 0.5, 5.0


@dataclass
class Story:
    """What happened while one case grew with one seed."""

    case: str
    seed: int
    robots: int
    seconds: list[float] = field(default_factory=list)
    worst_m: float = 0.0
    worst_deg: float = 0.0
    wrong: list[str] = field(default_factory=list)
    components: list[int] = field(default_factory=list)
    placements: dict[str, int] = field(default_factory=dict)
    jumps: int = 0
    end: str = ""
    done: int = 0
    peak_mb: float = 0.0
    idle_mb: tuple[float, float] | None = None


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", help=f"name; {', '.join(CASES)} without it")
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--idle", type=int, default=0, help="further updates at the end, one robot each")
    parser.add_argument("--one-by-one", action="store_true", help="an estimate after every single update")
    parser.add_argument("-v", "--verbose", action="store_true", help="tell every step, on stderr")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)

    stories = []
    for name in args.case or CASES:
        folder = bench_cases.find(name)
        if folder is None:
            bench_report.tell(f"{name}: not here")
            continue
        case = bench_cases.load(folder)
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            stories.append(grow(case, seed, args))
    if not stories:
        raise SystemExit("no maps to grow; set MAPMELD_SHARED to the folder that holds data/")
    limits = [
        f"{args.steps} steps; all robots grow at once, from places that the seed draws. "
        + ("One estimate after every update." if args.one_by_one else "One estimate a step."),
        "*worst* is the largest error of any told transform between two robots of one component, at any "
        f"time; more than {WRONG_M:g} m or {WRONG_DEG:g} degrees is wrong. Drifted maps have no exact truth.",
        "*components* after the last step, while maps might still grow, and *when done*, told so.",
        "*placed* is the largest number of placements of a robot: into the frame of others, or elsewhere by "
        "more than 0.2 m or 0.04 rad. *moves*: all changes of told poses, refinements among them.",
        "Peak memory is that of this process, which holds the finished maps as well.",
    ]
    text = bench_report.header("Growing robots", limits) + "\n" + _table(stories)
    for s in stories:
        text += f"\n{s.case}, seed {s.seed}: components by step {s.components}. {s.end}\n"
        text += "".join(f"- {line}\n" for line in s.wrong[:20])
    bench_report.write(text, args.output)


def grow(case: bench_cases.Case, seed: int, args: argparse.Namespace) -> Story:
    """Lets a case's maps grow and watches the estimates."""
    growths = [Growth(grid, 1000 * seed + k) for k, grid in enumerate(case.maps)]
    estimator = Estimator()
    story = Story(case.name, seed, len(growths))
    told: dict[str, tuple[int, Any]] = {}
    estimate: Estimate | None = None
    for step in range(1, args.steps + 1):
        for k, growth in enumerate(growths):
            estimator.update(growth.at(step / args.steps))
            if args.one_by_one or k == len(growths) - 1:
                estimate = estimator.estimate()
                told = _watch(story, estimate, case, told, f"step {step}", args.verbose)
    assert estimate is not None
    estimate = estimator.estimate(maps_are_done=True)
    _watch(story, estimate, case, told, "when done", args.verbose)
    story.end = _end(estimate)
    story.done = story.components.pop()
    story.placements = {r.name: r.placements for r in estimate.robots}
    if args.idle:
        story.idle_mb = _idle(estimator, growths, args.idle)
    story.peak_mb = _peak_mb()
    bench_report.tell(f"{case.name}, seed {seed}: worst {story.worst_m:.2f} m, {story.worst_deg:.1f} deg")
    return story


def _watch(
    story: Story,
    estimate: Estimate,
    case: bench_cases.Case,
    told: dict[str, tuple[int, Any]],
    when: str,
    verbose: bool,
) -> dict[str, tuple[int, Any]]:
    """Holds an estimate against the truth and the one before."""
    story.seconds.append(estimate.seconds)
    worst = (0.0, 0.0)
    for pair in case.truth["pairs"]:
        a, b = estimate.robot(pair["a"]), estimate.robot(pair["b"])
        if a.component is None or a.component != b.component:
            continue
        found = se2.compose(se2.inverse(a.T_world_map), b.T_world_map)
        centre = np.array(known_cells(case_map(case, b.name)).centre)
        metres = math.hypot(*(se2.apply(found, centre) - se2.apply(pair["T_a_b"], centre)))
        degrees = math.degrees(abs(se2.wrap(found[2] - pair["T_a_b"][2])))
        worst = (max(worst[0], metres), max(worst[1], degrees))
        if metres > WRONG_M or degrees > WRONG_DEG:
            story.wrong.append(f"{when}: {a.name} to {b.name} is {metres:.2f} m, {degrees:.1f} degrees off")
    story.worst_m = max(story.worst_m, worst[0])
    story.worst_deg = max(story.worst_deg, worst[1])
    story.components.append(len(estimate.components))
    now = {r.name: (r.component, r.T_world_map) for r in estimate.robots if r.T_world_map is not None}
    moved = [n for n, (_, T) in now.items() if n in told and not np.array_equal(T, told[n][1])]
    story.jumps += len(moved)
    if verbose:
        sizes = [len(c.names) for c in estimate.components]
        bench_report.tell(
            f"{when}: components of {sizes}, {estimate.registered_pairs} pairs, {estimate.seconds:.2f} s, "
            f"worst {worst[0]:.2f} m {worst[1]:.1f} deg, {len(moved)} moved, placements "
            f"{[r.placements for r in estimate.robots]}"
        )
    return now


def case_map(case: bench_cases.Case, name: str) -> OccupancyGrid:
    """A case's finished map."""
    return next(g for g in case.maps if g.name == name)


def _end(estimate: Estimate) -> str:
    parts = [", ".join(c.names) for c in estimate.components]
    return f"In the end {len(parts)} component(s): " + "; ".join(parts) + "."


def _idle(estimator: Estimator, growths: Sequence[Growth], updates: int) -> tuple[float, float]:
    """Resident megabytes after a tenth of further updates, and after all of them."""
    early = 0.0
    for k in range(updates):
        share = 0.9 + 0.1 * ((k // len(growths)) % 10) / 10
        estimator.update(growths[k % len(growths)].at(share))
        estimator.estimate()
        if k == updates // 10:
            early = _resident_mb()
    return early, _resident_mb()


def _table(stories: Sequence[Story]) -> str:
    rows = []
    for s in stories:
        quantiles = statistics.quantiles(s.seconds, n=20) if len(s.seconds) > 1 else s.seconds * 19
        idle = "-" if s.idle_mb is None else f"{s.idle_mb[0]:.0f} to {s.idle_mb[1]:.0f}"
        rows.append(
            (
                s.case,
                s.seed,
                s.robots,
                s.components[-1],
                s.done,
                f"{s.worst_m:.2f}",
                f"{s.worst_deg:.1f}",
                len(s.wrong),
                max(s.placements.values()),
                s.jumps,
                f"{1e3 * statistics.median(s.seconds):.0f}",
                f"{1e3 * quantiles[-1]:.0f}",
                f"{s.peak_mb:.0f}",
                idle,
            )
        )
    columns = (
        "case", "seed", "robots", "components",
        "when done", "worst m", "worst deg", "wrong transforms", "placed",
        "moves", "median ms", "p95 ms", "peak MB", "idle MB",
    )  # fmt: skip
    return bench_report.table(columns, rows)


def _resident_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as stream:
        return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _peak_mb() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    main()
