"""How far merges can be trusted: what is right, what is wrong, what is left apart, and what is said of it.

    python benchmarks/trust.py -o report.md --json rows.json        # everything but --peers
    python benchmarks/trust.py --only pairs negatives --seeds 1     # some sections
    python benchmarks/trust.py --from rows.json                     # the tables again, from kept numbers
    python benchmarks/trust.py --only pairs --failures pictures     # a picture of each pair that failed

Recorded cases are looked for in $MAPMELD_SHARED/data, by default ../shared/data as seen from the repository;
simulated buildings are made once into a folder and kept. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bench_cases
import bench_report
import trust_peers
import trust_pictures
import trust_sections
from trust_sections import PARTS, Plan, Task

CACHE = bench_report.REPOSITORY / "target" / "trust"
PAIR_SECTIONS = ("pairs", "negatives", "unrelated", "same")


def main(argv: Sequence[str] | None = None) -> None:
    args = _arguments(argv)
    if args.kept is not None:
        kept = json.loads(args.kept.read_text(encoding="utf-8"))
        names = [n for n in PARTS if n in (args.only or kept["sections"])]
    else:
        names = [n for n in PARTS if n in args.only] if args.only else [n for n in PARTS if n != "peers"]
        if args.peers and "peers" not in names:
            names.append("peers")
        kept = _measure(_plan(args), names, args.jobs, args.json)
    text = kept["header"] + _report(kept["rows"], kept["seconds"], names)
    bench_report.write(text, args.output)
    if args.failures is not None:
        rows = [r for n in PAIR_SECTIONS if n in names for r in kept["rows"].get(n, [])]
        drawn, missing = trust_pictures.draw_all(rows, lambda c: _find(c, args.cache), args.failures)
        bench_report.tell(f"{drawn} pictures" + (f"; maps of {missing} pairs not found" if missing else ""))


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(PARTS), metavar="SECTION", help=", ".join(PARTS))
    parser.add_argument("--peers", action="store_true", help="other methods on the same pairs, too")
    parser.add_argument("--cases", nargs="+", metavar="TEXT", help="recorded cases with this in their names")
    parser.add_argument("--seeds", type=int, default=5, help="merge with seeds 1 to this one")
    parser.add_argument("--unrelated", type=int, default=3000, help="pairs of the section of that name")
    parser.add_argument("--sample", type=int, help="at most so many pairs, and cases, a section")
    parser.add_argument("--quick", action="store_true", help="next to nothing; for tests of this script")
    parser.add_argument("--jobs", type=int, default=bench_report.usable_cores(), help="processes")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of simulated buildings")
    parser.add_argument("--json", type=Path, help="file to keep the numbers in")
    parser.add_argument("--from", dest="kept", type=Path, help="show such a file, measure nothing")
    parser.add_argument("--failures", type=Path, metavar="DIR", help="folder for pictures of failed pairs")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    if min(args.seeds, args.jobs, args.unrelated, args.sample or 1) < 1:
        parser.error("--seeds, --jobs, --unrelated and --sample take numbers from 1")
    return args


def _plan(args: argparse.Namespace) -> Plan:
    only = None if args.cases is None else tuple(args.cases)
    if args.quick:
        return Plan(
            args.cache,
            only,
            seeds=1,
            sample=3,
            unrelated=4,
            worlds=("maze",),
            strangers=2,
            scattered=1,
            wholes=1,
            draws=2,
        )
    return Plan(args.cache, only, args.seeds, args.sample, args.unrelated)


def _measure(plan: Plan, names: Sequence[str], jobs: int, output: Path | None) -> dict[str, Any]:
    """Rows and seconds of every section and the head of the report; kept in a file after each section."""
    kept: dict[str, Any] = {
        "header": bench_report.header("Merges that can be trusted", _limits(plan, names)),
        "sections": list(names),
        "rows": {},
        "seconds": {},
    }
    wanted = trust_sections.measured(names)
    known: dict[Task, Any] = {}
    with _workers(jobs) as work:
        started = time.perf_counter()
        list(work(plan.buildings(wanted)))
        kept["seconds"]["simulated buildings"] = time.perf_counter() - started
        for name in wanted:
            tasks = PARTS[name].tasks
            assert tasks is not None
            started = time.perf_counter()
            listed = list(tasks(plan))
            fresh = [t for t in dict.fromkeys(listed) if t not in known]
            for count, (task, row) in enumerate(zip(fresh, work(fresh), strict=True), start=1):
                known[task] = row
                if count % 100 == 0:
                    bench_report.tell(f"{name}: {count} of {len(fresh)}")
            kept["rows"][name] = trust_sections.finish(name, [known[t] for t in listed], plan)
            kept["seconds"][name] = time.perf_counter() - started
            bench_report.tell(f"{name}: {len(listed)} answers, {kept['seconds'][name]:.0f} s")
            if output is not None:
                output.write_text(json.dumps(kept) + "\n", encoding="utf-8")
    return kept


@contextmanager
def _workers(jobs: int) -> Iterator[Any]:
    """A map over tasks that keeps their order, in so many processes; in this one for a single job."""
    if jobs == 1:
        yield lambda tasks: map(_run, tasks)
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        yield lambda tasks: pool.map(_run, tasks, chunksize=4)


def _run(task: Task) -> Any:
    return task.run()


def _limits(plan: Plan, names: Sequence[str]) -> list[str]:
    found = plan.folders
    limits = [
        f"{len(found)} recorded cases"
        + (f" whose names hold {' or '.join(plan.only)}" if plan.only else "")
        + f", seeds 1 to {plan.seeds}; simulated buildings vary instead of seeds. Maps in memory.",
        "Truth of buildings is that of corrected laser logs or of key points picked by hand, not surveyed.",
    ]
    if not found:
        limits.append("No recorded case was found (MAPMELD_SHARED): most of the goals are not measured.")
    if plan.sample is not None:
        limits.append(f"A sample: at most {plan.sample} pairs and cases of each kind. Says little.")
    return limits + (trust_peers.missing() if "peers" in names else [])


def _report(rows: dict[str, Any], seconds: dict[str, float], names: Sequence[str]) -> str:
    text, goals = "", []
    for name in names:
        part = PARTS[name]
        mine = [r for n in part.of or (name,) for r in rows.get(n, [])]
        body, found = part.show(mine) if mine else ("Nothing to measure.\n", [])
        text += f"\n## {part.title} ({name})\n\n{body}"
        goals += found
    columns = ("figure", "measured", "goal", "verdict")
    head = f"\n## Goals\n\n{bench_report.table(columns, [g.row() for g in goals])}" if goals else ""
    taken = [(n, f"{s:.0f}") for n, s in seconds.items()]
    return head + text + f"\n## Time\n\n{bench_report.table(('section', 'seconds'), taken)}"


def _find(case: str, cache: Path) -> Path | None:
    return cache / case if "_sim" in case else bench_cases.find(case)


if __name__ == "__main__":
    main()
