"""Ten robots in processes of their own, whose maps grow under the node: right, ever wrong, how often moved?

    make ros-robots
    .venv-ros/bin/python ros/mapmeld_ros/benchmark/ten_robots.py --case mazeA_k10 --seeds 3 --further 300

The node runs with default parameters in one process, the robots in two, and this one listens: it holds every
transform and every estimate that the node publishes against the truth. Maps are revealed as in
benchmarks/robots_growth.py, a step every `--step-seconds`, whether the node keeps up or not. Then no map
changes until the node takes them for done. `--further` updates of one robot each follow after the first
seed, each with an estimate, while the node's memory is read. Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from witness import WRONG_DEG, WRONG_M, Witness, robot

import bench_cases
import bench_report
from graph import Fleet, Graph
from robots_growth import Growth

# Placements of a robot: its first, and one more.
MOST_PLACEMENTS = 2
# The node's memory is flat when it grows by no more from the second third of the further updates to the last.
FLAT_PERCENT = 5.0
# How long the node may take to answer an update, seconds; on a machine that does nothing else it takes one.
_PATIENCE = 60.0


@dataclass
class Story:
    """What happened with one seed."""

    seed: int
    robots: int
    witness: Witness
    components: list[int] = field(default_factory=list)
    when_done: list[str] = field(default_factory=list)
    placements: dict[str, int] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)

    @property
    def growth(self) -> float:
        """Of the memory from the first third of the further updates to the last, percent."""
        third = len(self.memory) // 3
        first, last = (sum(part) / third for part in (self.memory[third : 2 * third], self.memory[-third:]))
        return 100.0 * (last / first - 1.0)


def main(argv: Sequence[str] | None = None) -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--case", default="mazeA_k10")
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--step-seconds", type=float, default=4.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--further", type=int, default=300)
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    folder = bench_cases.find(args.case)
    if folder is None:
        raise SystemExit(f"{args.case}: not here; set MAPMELD_SHARED to the folder that holds data/")
    case = bench_cases.load(folder)
    stories = []
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        with tempfile.TemporaryDirectory() as scratch:
            further = args.further if seed == args.first_seed else 0
            stories.append(grow(case, seed, args, further, Path(scratch)))
    bench_report.write(_report(stories, args), args.output)


def grow(case: bench_cases.Case, seed: int, args: argparse.Namespace, further: int, scratch: Path) -> Story:
    """Lets a case's maps grow before the node, and watches what it publishes."""
    growths = [Growth(grid, 1000 * seed + k) for k, grid in enumerate(case.maps)]
    graph = Graph(scratch)
    try:
        witness = Witness(graph.ros, case)
        fleets = [graph.fleet("first"), graph.fleet("second")]
        node = graph.node(merging_rate=4.0, estimation_rate=0.5, discovery_rate=0.05)
        story = Story(seed, len(growths), witness)
        for step in range(1, args.steps + 1):
            began = time.monotonic()
            witness.when = f"step {step}"
            for k, growth in enumerate(growths):
                _send(graph, fleets[k % 2], growth, step / args.steps)
            _listen(graph, began + args.step_seconds - time.monotonic())
            newest = witness.newest
            story.components.append(len(newest.components) if newest else 0)
            bench_report.tell(
                f"seed {seed}, step {step}: {story.components[-1]} components, {witness.said()}"
            )
        witness.when = "when done"
        # The node's quiet_time, and an estimate that may begin at its end.
        _listen(graph, 20.0)
        _settle(graph, witness)
        newest = witness.newest
        story.when_done = [", ".join(c.robots) for c in newest.components]
        story.placements = {r.robot: r.placements for r in newest.robots}
        story.seconds = list(witness.seconds)
        witness.when = "afterwards"
        for k in range(further):
            share = 0.9 + 0.1 * ((k // len(growths)) % 10) / 10
            count = witness.estimates
            _send(graph, fleets[k % len(growths) % 2], growths[k % len(growths)], share)
            graph.wait("an estimate", lambda count=count: witness.estimates > count, _PATIENCE)
            _drop_maps(graph)
            story.memory.append(resident_mb(node.popen.pid))
            if k % 30 == 29:
                bench_report.tell(f"seed {seed}, further update {k + 1}: {story.memory[-1]:.0f} MB")
        bench_report.tell(f"seed {seed}: {witness.said()}")
        return story
    finally:
        graph.close()


def resident_mb(pid: int) -> float:
    """Memory that a process has in the machine's, megabytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _send(graph: Graph, fleet: Fleet, growth: Growth, share: float) -> None:
    grid = growth.at(share)
    file = graph.save(grid)
    name = robot(grid.name)
    fleet.do(do="map", topic=f"/{name}/map", frame=f"{name}/map", file=file)
    os.remove(file)


def _listen(graph: Graph, seconds: float) -> None:
    graph.spin(max(seconds, 0.01))
    _drop_maps(graph)


def _settle(graph: Graph, witness: Witness) -> None:
    """Listens until no estimate has come for some time: the last one took the maps for done."""
    heard = -1
    while heard != witness.estimates:
        heard = witness.estimates
        _listen(graph, 10.0)


def _drop_maps(graph: Graph) -> None:
    """The witness keeps what is asked for: this process must not grow either."""
    for got in (graph.maps["/map"], graph.estimates, graph.links["/tf_static"], graph.links["/tf"]):
        got.clear()


def _report(stories: Sequence[Story], args: argparse.Namespace) -> str:
    limits = [
        f"{args.steps} steps, one every {args.step_seconds:g} s; all robots grow at once, from places that "
        "the seed draws. Node with default parameters.",
        "*worst* is the largest error of any published transform or estimate between two robots of one "
        f"frame, at any time; more than {WRONG_M:g} m or {WRONG_DEG:g} degrees is wrong.",
        "*components* after the last step, while maps might still grow, and *when done*, after quiet_time.",
        "*placed* is the largest number of placements of a robot.",
        "*estimate* is the node's time for one, while maps grew.",
    ]
    rows = []
    for s in stories:
        w, ordered = s.witness, sorted(s.seconds)
        rows.append(
            (
                s.seed,
                s.robots,
                w.transforms,
                w.estimates,
                len(w.wrong),
                f"{w.worst_m:.2f}",
                f"{w.worst_deg:.1f}",
                s.components[-1],
                len(s.when_done),
                max(s.placements.values()),
                f"{ordered[len(ordered) // 2]:.1f}",
                f"{ordered[-1]:.1f}",
            )
        )
    columns = (
        "seed", "robots", "transforms", "estimates", "wrong", "worst m", "worst deg",
        "components", "when done", "placed", "estimate median s", "worst s",
    )  # fmt: skip
    packages = ("ros-rclpy", "ros-fastdds")
    text = bench_report.header("Ten robots under the node", limits, packages) + "\n"
    text += _goals(stories) + "\n" + bench_report.table(columns, rows)
    for s in stories:
        text += f"\nSeed {s.seed}: components by step {s.components}. When done: {'; '.join(s.when_done)}. "
        text += f"Placements {list(s.placements.values())}.\n"
        text += "".join(f"- {line}\n" for line in s.witness.wrong[:20])
        if s.memory:
            marks = [k for k in range(0, len(s.memory) + 1, 30) if k] or [len(s.memory)]
            told = ", ".join(f"{s.memory[k - 1]:.0f}" for k in marks)
            text += f"\nMemory of the node after every 30th of {len(s.memory)} further updates, MB: {told}.\n"
    return text


def _goals(stories: Sequence[Story]) -> str:
    wrong = sum(len(s.witness.wrong) for s in stories)
    placed = max(n for s in stories for n in s.placements.values())
    parts = max(len(s.when_done) for s in stories)
    rows = [
        ("wrong transforms and estimates", wrong, "0", wrong == 0),
        ("components when done, most", parts, "1", parts == 1),
        ("placements of a robot, most", placed, f"{MOST_PLACEMENTS}", placed <= MOST_PLACEMENTS),
    ]
    rows += [
        (
            f"memory, second third to last third of {len(s.memory)} updates",
            f"{s.growth:+.1f} %",
            f"at most {FLAT_PERCENT:g} %",
            s.growth <= FLAT_PERCENT,
        )
        for s in stories
        if len(s.memory) >= 3
    ]
    told = [(*row[:3], "met" if row[3] else "missed") for row in rows]
    return bench_report.table(("figure", "measured", "goal", "verdict"), told)


if __name__ == "__main__":
    main()
