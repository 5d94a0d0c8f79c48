"""How the time of a merge grows with the number of maps, their corners and the particles.

    python benchmarks/complexity.py             # several minutes
    python benchmarks/complexity.py --quick     # seconds; too small for conclusions

Prints Markdown: the exponents of our stages beside the paper's O(Np c^2 N^2) (known order) and O(Np c^2 N^3)
(unknown order), and the times that they were fitted to.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import bench_cases
import bench_report
import mapmeld
from mapmeld.simulate import SimulateOptions

ORDERS = ("known", "unknown")
STAGES = ("prepare", "register", "filter", "join", "fuse")
FITTED = ("register", "filter", "merge")
PAPER: dict[str | tuple[str, str], int] = {("known", "N"): 2, ("unknown", "N"): 3, "c": 2, "Np": 1}
"""Exponents of the paper's complexity figures; c and Np have the same in both orders."""


@dataclass(frozen=True)
class Plan:
    """What is varied, and what is held meanwhile. The last numbers of maps are also those held."""

    small: SimulateOptions
    large: SimulateOptions
    maps: tuple[int, ...]
    corners: tuple[int, ...]
    particles: tuple[int, ...]
    held_maps: int
    held_particles: int


FULL = Plan(
    # Regions of 3 m in the paper's kind of maze: about eight corners a map, and most pairs overlap.
    small=SimulateOptions(seed=3, robots=24, region_radius=3.0, path_length=12.0),
    # A larger maze, seen at length, so that there are corners to leave out.
    large=SimulateOptions(
        seed=4, robots=4, size=(20.0, 20.0), density=0.8, region_radius=9.0, path_length=90.0
    ),
    maps=(3, 6, 9, 12, 18, 24),
    corners=(4, 8, 16, 32, 58),
    particles=(25, 50, 100, 200, 400),
    held_maps=10,
    held_particles=100,
)
QUICK = Plan(
    small=SimulateOptions(seed=3, robots=5, region_radius=2.5, path_length=5.0),
    large=SimulateOptions(seed=3, robots=2, region_radius=4.0, path_length=12.0),
    maps=(2, 3, 5),
    corners=(2, 4, 8),
    particles=(10, 20, 40),
    held_maps=4,
    held_particles=20,
)


@dataclass(frozen=True)
class Run:
    """One setting, measured: the shortest time of each stage, in seconds."""

    order: str
    maps: int
    corners: float
    particles: int
    seconds: dict[str, float]
    candidates: int
    merged: int

    def value(self, varied: str) -> float:
        return {"N": self.maps, "c": self.corners, "Np": self.particles}[varied]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small settings, for a test of this script")
    parser.add_argument("--repeats", type=int, default=1, help="runs of a setting; the shortest counts")
    parser.add_argument("--threads", type=int, default=1, help="threads of the core")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    plan = QUICK if args.quick else FULL
    bench_report.tell("simulating the maps")
    small, large = (bench_cases.connected_mazes(o) for o in (plan.small, plan.large))

    def run(maps: Sequence[mapmeld.OccupancyGrid], particles: int, most: int | None = None) -> list[Run]:
        return [measure(maps, order, particles, most, args.repeats, args.threads) for order in ORDERS]

    sweeps = {
        "N": _sweep(plan.maps, lambda n: run(small[:n], plan.held_particles)),
        "c": _sweep(plan.corners, lambda c: run(large, plan.held_particles, c)),
        "Np": _sweep(plan.particles, lambda p: run(small[: plan.held_maps], p)),
    }
    limits = [
        f"Times are those of the core, on {args.threads} thread(s), shortest of {args.repeats} run(s); the "
        "maps are in memory.",
        "An exponent is the slope of a straight line through the logarithms of sizes and times, with its "
        "standard error; it holds for the sizes below only. In brackets: that of the three largest sizes.",
        f"The number of pairs, N (N - 1) / 2, has by itself the exponent {_exponent_of_pairs(plan.maps):.2f} "
        "over these N, and tends to 2.",
        "`merge` is the whole merge. A stage that does not depend on a size has an exponent near 0 there.",
    ]
    if args.quick:
        limits.append("Quick: so small that the exponents mean nothing.")
    text = bench_report.header("Complexity", limits)
    text += f"\n## Exponents\n\n{_exponents(sweeps)}\n{WHY}"
    for varied, runs in sweeps.items():
        text += f"\n## Times, {NAMES[varied]} varied\n\n{_times(varied, runs)}"
    bench_report.write(text, args.output)


def _sweep(values: Sequence[int], run: Callable[[int], list[Run]]) -> list[Run]:
    return [r for value in values for r in run(value)]


def measure(
    maps: Sequence[mapmeld.OccupancyGrid],
    order: str,
    particles: int,
    max_corners: int | None,
    repeats: int,
    threads: int,
) -> Run:
    """Merges the maps; their sequence is the order, where it is known."""
    config: dict[str, Any] = {}
    if max_corners is not None:
        config = {"registration": {"max_corners": max_corners}}
    best: dict[str, float] = {}
    for _ in range(repeats):
        result = mapmeld.merge(
            maps,
            particles=particles,
            threads=threads,
            order=range(len(maps)) if order == "known" else None,
            config=config,
        )
        best = {k: min(best.get(k, v), v) for k, v in result.seconds.items()}
    corners = [len(mapmeld.features(g, config).corners.vertex) for g in maps]
    found = Run(
        order,
        len(maps),
        float(np.mean(corners)),
        particles,
        best,
        sum(p.candidates for p in result.pairs),
        len(result.order),
    )
    bench_report.tell(
        f"{order} order, N {len(maps)}, c {found.corners:.1f}, Np {particles}: {best['merge']:.2f} s"
    )
    return found


NAMES = {"N": "maps N", "c": "corners per map c", "Np": "particles Np"}


def fit(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Slope of log y over log x by least squares, and its standard error; NaN where it is not determined."""
    log_x, log_y = np.log(x), np.log(np.maximum(y, 1e-6))
    spread = log_x - log_x.mean()
    if len(log_x) < 3 or not np.any(spread):
        return float("nan"), float("nan")
    slope = float(spread @ log_y / (spread @ spread))
    residual = log_y - log_y.mean() - slope * spread
    error = float(np.sqrt(residual @ residual / (len(log_x) - 2) / (spread @ spread)))
    return slope, error


def _exponent_of_pairs(maps: Sequence[int]) -> float:
    return fit(maps, [n * (n - 1) / 2 for n in maps])[0]


def _exponents(sweeps: dict[str, list[Run]]) -> str:
    rows = []
    faster = []
    for order in ORDERS:
        for varied, all_runs in sweeps.items():
            runs = [r for r in all_runs if r.order == order]
            x = [r.value(varied) for r in runs]
            paper = PAPER.get((order, varied), PAPER.get(varied, 0))
            cells = []
            for stage in FITTED:
                y = [r.seconds[stage] for r in runs]
                slope, error = fit(x, y)
                last = f" ({fit(x[-3:], y[-3:])[0]:.2f})" if len(x) > 3 else ""
                cells.append(f"{slope:.2f} ± {error:.2f}{last}")
                if slope > paper:
                    where = f"{order} order, {NAMES[varied]}, `{stage}`"
                    faster.append(f"- {where}: {slope:.2f} ± {error:.2f}, not {paper}\n")
            rows.append((order, NAMES[varied], f"{x[0]:.3g} to {x[-1]:.3g}", *cells, paper))
    text = bench_report.table(("order", "varied", "from .. to", *FITTED, "paper"), rows)
    if faster:
        return f"{text}\nAbove the paper's exponent of the whole, over these sizes:\n\n{''.join(faster)}"
    return text + "\nNone is above the paper's exponent of the whole.\n"


def _times(varied: str, runs: Sequence[Run]) -> str:
    rows = [
        (
            r.order,
            r.maps,
            f"{r.corners:.1f}",
            r.particles,
            *(f"{1e3 * r.seconds.get(stage, 0.0):.1f}" for stage in (*STAGES, "merge")),
            r.candidates,
            r.merged,
        )
        for r in runs
    ]
    columns = ("order", "N", "c", "Np", *(f"{s} ms" for s in (*STAGES, "merge")), "candidates", "maps merged")
    return bench_report.table(columns, rows)


WHY = """
The paper registers a new map against all merged maps anew for every particle, and compares all pairs of
corners each time: O(Np c^2 N^2) with a known order, O(Np c^2 N^3) when every map left is tried at every
step. Here the candidates of a pair of maps are found and climbed once, before the filter, and kept; a
particle composes the modes kept of each pair (`registration.max_modes`) with its own poses. So

- corners c meet in `register` only, N (N - 1) / 2 times, and never Np times. Most candidates of a pair get
  one short look and a list of fixed length is climbed, so c^2 is what is proposed, not what is climbed.
  Corners are one source of three, and asked only where correlation finds too little; `candidates` counts all
  that were proposed, and where the other sources propose most of them, c^2 is hidden by what they cost.
- particles Np and maps N meet in `filter`, which looks at no corners: a step composes kept modes with the
  poses of the placed maps and weighs at most `filter.candidates_per_map` poses of a map. With an unknown
  order, maps left are tried until one is sure or `filter.maps_per_step` of them have been found to fit, and a
  particle goes to the surest of those. Particles that are copies of each other are served by one turn.

What `filter` pays in unknown order grows in two ways at once while maps are few: a pose is weighed against
all placed maps, and more maps are tried until one is sure. Besides, the motions of all
maps left from all placed maps are composed at every step, N^3 in all, without a look at any map.
"""


if __name__ == "__main__":
    main()
