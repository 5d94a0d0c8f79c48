"""Wall time and memory of `mapmeld merge`, files to files.

    python benchmarks/wall_time.py
    python benchmarks/wall_time.py --case maze10 --runs 3

Ten mazeA maps, order unknown, 100 particles. The goal is under 2 s on 2 cores and under 500 MB. The maps are
those of mazeA_k10 in $MAPMELD_SHARED/data (by default ../shared/data as seen from the repository) or, where
these are not to be had, the bundled ones. Prints Markdown.
"""

from __future__ import annotations

import argparse
import atexit
import functools
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import bench_report

# Nothing heavy is imported here: a child counts the memory of its parent as its own until it is replaced.

GOAL_SECONDS, GOAL_MB = 2.0, 500.0


@dataclass(frozen=True)
class Run:
    """One merge: wall and processor seconds, peak resident megabytes, and seconds by stage as it tells."""

    wall: float
    processor: float
    peak_mb: float
    stages: dict[str, float]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", help="name; mazeA_k10, or maze10 where that is not there")
    parser.add_argument("--runs", type=int, default=5, help="after one that warms up")
    parser.add_argument("--particles", type=int, default=100)
    parser.add_argument("--threads", type=int, help="all cores without it")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    case, maps = _maps(args.case)

    program = [*command(), "merge", *map(str, maps), "--particles", str(args.particles), "--quiet"]
    if args.threads:
        program += ["--threads", str(args.threads)]
    runs = []
    for k in range(args.runs + 1):
        run = measure(program)
        bench_report.tell(f"{'warm-up' if k == 0 else f'run {k}'}: {run.wall:.2f} s, {run.peak_mb:.0f} MB")
        runs.append(run)
    runs = runs[1:]

    limits = [
        f"`mapmeld merge` of the {len(maps)} maps of {case}, order unknown, {args.particles} particles, "
        f"{args.threads or 'all'} threads: from the start of the process to its end, all files written.",
        f"Median of {len(runs)} runs after one more that warmed the file cache and compiled Python's files, "
        "as pip does when it installs. Peak memory is the largest resident set of the process.",
        "*processor* is what all threads computed, together: other load on the machine lengthens wall time "
        "far more than that.",
    ]
    text = bench_report.header("Wall time", limits)
    text += f"\n## Whole command\n\n{_whole(runs)}\n## Stages\n\n{_stages(runs)}"
    bench_report.write(text, args.output)


def measure(command: Sequence[str]) -> Run:
    """Runs the merge into a new folder."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        program = [*command, "-o", str(out)]
        started = time.perf_counter()
        child = os.posix_spawn(program[0], program, environment(bytecode()))
        _, status, usage = os.wait4(child, 0)
        wall = time.perf_counter() - started
        code = os.waitstatus_to_exitcode(status)
        if code != 0:
            raise SystemExit(f"mapmeld merge ended with exit code {code}")
        stages = json.loads((out / "result.json").read_text(encoding="utf-8"))["seconds"]
    # ru_maxrss is in kilobytes, on macOS in bytes.
    peak = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024)
    return Run(wall, usage.ru_utime + usage.ru_stime, peak, stages)


def environment(folder: str) -> dict[str, str]:
    """That of this process, but Python keeps its bytecode in `folder`.

    pip compiles what it installs. A source tree may have no bytecode (PYTHONDONTWRITEBYTECODE) or stale one
    (copied), and would be compiled in every run.
    """
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {**inherited, "PYTHONPYCACHEPREFIX": folder}


@functools.cache
def bytecode() -> str:
    """A folder for bytecode, gone with this process. The run that warms up fills it."""
    folder = tempfile.TemporaryDirectory(prefix="mapmeld-bytecode-")
    atexit.register(folder.cleanup)
    return folder.name


def _maps(name: str | None) -> tuple[str, list[Path]]:
    """A case's name and map files. Bundled maps are found without importing the package."""
    shared = Path(os.environ.get("MAPMELD_SHARED", bench_report.REPOSITORY.parent / "shared")) / "data"
    spec = find_spec("mapmeld")
    if spec is None or spec.origin is None:
        raise SystemExit("mapmeld is not installed here; run make, then .venv/bin/python")
    bundled = Path(spec.origin).parent / "data"
    for case in (name,) if name else ("mazeA_k10", "maze10"):
        for folder in (shared / case, bundled / case):
            if maps := sorted(folder.glob("*.yaml")):
                return case, maps
        bench_report.tell(f"{case}: not here")
    raise SystemExit("no maps to merge; set MAPMELD_SHARED to the folder that holds data/")


def command() -> list[str]:
    """The command line program that belongs to this interpreter."""
    script = Path(sys.executable).parent / "mapmeld"
    if script.is_file():
        return [str(script)]
    return [sys.executable, "-c", "from mapmeld.cli import main; main()"]


def _whole(runs: Sequence[Run]) -> str:
    rows = []
    for name, values, goal, digits in (
        ("wall s", [r.wall for r in runs], GOAL_SECONDS, 2),
        ("processor s", [r.processor for r in runs], None, 2),
        ("peak memory MB", [r.peak_mb for r in runs], GOAL_MB, 0),
    ):
        median = statistics.median(values)
        verdict = "-" if goal is None else "met" if median < goal else "missed"
        rows.append(
            (
                name,
                *(f"{v:.{digits}f}" for v in (median, min(values), max(values))),
                "-" if goal is None else f"under {goal:g}",
                verdict,
            )
        )
    return bench_report.table(("", "median", "least", "most", "goal", "median meets it"), rows)


def _stages(runs: Sequence[Run]) -> str:
    """Medians by stage; `merge` and `total` are sums of others, the start of Python is in none of them."""
    medians = {s: statistics.median(r.stages[s] for r in runs) for s in runs[0].stages}
    rows = [(stage, f"{1e3 * seconds:.0f}") for stage, seconds in medians.items()]
    started = statistics.median(r.wall - r.stages["total"] for r in runs)
    rows.append(("(start and end of Python)", f"{1e3 * started:.0f}"))
    return bench_report.table(("stage", "median ms"), rows)


if __name__ == "__main__":
    main()
