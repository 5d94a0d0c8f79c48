"""What preparing maps, registering pairs and whole merges cost, next to other methods in the same run.

    python benchmarks/speed.py                        # all of the below
    python benchmarks/speed.py --only prepare pairs   # some of it
    python benchmarks/speed.py --every 4 --runs 3     # a quarter of the pairs, fewer merges

Processor time of one thread, on the recorded pairs that share walls and on those of different buildings in
$MAPMELD_SHARED/data (by default ../shared/data as seen from the repository). The peers stitch by image
features as multirobot_map_merge does, on top of OpenCV (opencv-python-headless below 5). Prints Markdown.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import bench_report
import mapmeld
import trust_cases
import trust_peers
import wall_time
from mapmeld import _core
from trust_cases import MapFile, MapPair

PARTS = ("prepare", "pairs", "peers", "merges")
GOAL_PREPARE_MS = 8.0
"""Of a map of _CELLS cells."""
_CELLS = 500 * 500
GOAL_PAIR_MS, GOAL_PAIR_P95_MS = 5.0, 20.0
GOALS_MERGE_MS = {"mazeA_k10": 150.0, "intel_k10_drift": 600.0}
GOAL_COMMAND_MS = 250.0


class Prepared:
    """Maps as the core prepares them, each once, with their mirror images, and the milliseconds it took."""

    def __init__(self) -> None:
        self._maps: dict[Path, tuple[_core.LocalMap, _core.LocalMap]] = {}
        self.ms: dict[Path, float] = {}
        self.cells: dict[Path, int] = {}

    def get(self, m: MapFile) -> tuple[_core.LocalMap, _core.LocalMap]:
        """The map and its mirror image."""
        if m.path not in self._maps:
            g = trust_cases.grid(m.path, m.name)
            data = np.ascontiguousarray(g.data)
            started = time.process_time()
            prepared = _core.LocalMap(g.name, data, g.resolution, list(g.origin), "{}")
            self.ms[m.path] = 1e3 * (time.process_time() - started)
            self.cells[m.path] = g.data.size
            self._maps[m.path] = (prepared, prepared.mirrored())
        return self._maps[m.path]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, help="parts to measure; all without it")
    parser.add_argument("--every", type=int, default=1, help="take every so manieth pair")
    parser.add_argument("--runs", type=int, default=5, help="merges of each case, after one to warm up")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    parts = args.only or PARTS

    pairs = [p for f in trust_cases.folders(None) for p in trust_cases.pairs(f) if p.band]
    pairs = (pairs + trust_cases.negatives(None))[:: args.every]
    if not pairs:
        raise SystemExit("no recorded pairs here; set MAPMELD_SHARED to the folder that holds data/")
    prepared = Prepared()
    for p in pairs:
        prepared.get(p.a)
        prepared.get(p.b)
    text = bench_report.header("Speed", _limits(pairs), ("numpy", "opencv-python-headless"))
    if "prepare" in parts:
        text += f"\n## Preparing a map\n\n{_prepare(prepared)}"
    if "pairs" in parts or "peers" in parts:
        ours = [_register(p, prepared) for p in pairs]
        text += f"\n## Registering a pair\n\n{_pairs(pairs, ours)}"
        if "peers" in parts:
            text += f"\n## Next to other methods\n\n{_peers(pairs, ours, prepared)}"
    if "merges" in parts:
        text += f"\n## Whole merges\n\n{_merges(args.runs)}"
    bench_report.write(text, args.output)


def _limits(pairs: Sequence[MapPair]) -> list[str]:
    return [
        f"{len(pairs)} recorded pairs: those that share walls, and those of different buildings.",
        "Processor time of one thread; other load on the machine lengthens it, since caches are shared.",
        "A registration finds the modes of all sources at each degree of bending, those of the mirror image, "
        "their evidence and the features of the verdict, on prepared maps.",
        "What a command costs of its own is its median wall time, Python's files compiled, less the core's.",
    ]


def _register(pair: MapPair, prepared: Prepared) -> float:
    """Milliseconds that the registration of a pair takes."""
    (a, _), (b, mirrored) = prepared.get(pair.a), prepared.get(pair.b)
    started = time.process_time()
    _core.weigh(a, b, mirrored, "{}")
    return 1e3 * (time.process_time() - started)


def _verdict(value: float, goal: float) -> str:
    return "met" if value <= goal else "missed"


def _prepare(prepared: Prepared) -> str:
    scaled = [prepared.ms[k] * _CELLS / prepared.cells[k] for k in prepared.ms]
    median = statistics.median(scaled)
    row = (len(scaled), f"{median:.1f}", f"{max(scaled):.1f}", f"{GOAL_PREPARE_MS:g}")
    columns = ("maps", "median ms for 500 x 500 cells", "most", "goal", "median meets it")
    return bench_report.table(columns, [(*row, _verdict(median, GOAL_PREPARE_MS))])


def _pairs(pairs: Sequence[MapPair], ours: Sequence[float]) -> str:
    bands = {"many walls in common": "many", "few walls in common": "few", "different buildings": None}
    chosen = {
        name: [ms for p, ms in zip(pairs, ours, strict=True) if p.band == b] for name, b in bands.items()
    }
    chosen["all"] = list(ours)
    rows = []
    for name, ms in chosen.items():
        if ms:
            median, p95 = float(np.median(ms)), float(np.percentile(ms, 95))
            told = f"{_verdict(median, GOAL_PAIR_MS)}, {_verdict(p95, GOAL_PAIR_P95_MS)}"
            rows.append((name, len(ms), f"{median:.1f}", f"{p95:.1f}", f"{max(ms):.1f}", told))
    goals = f"{GOAL_PAIR_MS:g} and {GOAL_PAIR_P95_MS:g}"
    return bench_report.table(("pairs", "n", "median ms", "p95 ms", "most ms", f"goals {goals}"), rows)


def _peers(pairs: Sequence[MapPair], ours: Sequence[float], prepared: Prepared) -> str:
    """From two grids in memory to a transform: what a peer does anew for every pair, this does too."""
    whole = []
    for p, ms in zip(pairs, ours, strict=True):
        started = time.process_time()
        prepared.get(p.b)[0].mirrored()
        mirror = 1e3 * (time.process_time() - started)
        whole.append(ms + mirror + prepared.ms[p.a.path] + prepared.ms[p.b.path])
    rows = [
        ("mapmeld, both maps prepared anew", _summary(whole), "1.0"),
        ("mapmeld, maps prepared before", _summary(ours), f"{sum(whole) / sum(ours):.1f}"),
    ]
    if "orb" not in trust_peers.methods():
        text = bench_report.table(("method", "median ms, mean ms", "times as fast as the first"), rows)
        return text + "\n" + "\n".join(f"- {line}" for line in trust_peers.missing()) + "\n"
    for method in trust_peers.FEATURES:
        took = []
        for p in pairs:
            a, b = trust_cases.grid(p.a.path, "a"), trust_cases.grid(p.b.path, "b")
            started = time.process_time()
            trust_peers.stitch(a, b, method)
            took.append(1e3 * (time.process_time() - started))
        rows.append((f"OpenCV, {method.upper()}", _summary(took), f"{sum(whole) / sum(took):.2f}"))
    return bench_report.table(("method", "median ms, mean ms", "times as fast as the first"), rows)


def _summary(ms: Sequence[float]) -> str:
    return f"{statistics.median(ms):.1f}, {statistics.fmean(ms):.1f}"


def _merges(runs: int) -> str:
    rows = []
    for case, goal in GOALS_MERGE_MS.items():
        folder = next((f for f in trust_cases.folders([case]) if f.name == case), None)
        if folder is None:
            continue
        files = sorted(folder.glob("*.yaml"))
        maps = [mapmeld.read_map(path) for path in files]
        core = []
        for _ in range(runs + 1):
            started = time.perf_counter()
            mapmeld.merge(maps)
            core.append(1e3 * (time.perf_counter() - started))
        command = [*wall_time.command(), "merge", *map(str, files), "--quiet"]
        whole = [wall_time.measure(command) for _ in range(runs + 1)]
        in_core, outside = statistics.median(core[1:]), statistics.median(1e3 * r.wall for r in whole[1:])
        own = outside - in_core
        of_core = (f"{in_core:.0f}", f"{goal:g}", _verdict(in_core, goal))
        of_command = (f"{outside:.0f}", f"{own:.0f}", f"{GOAL_COMMAND_MS:g}", _verdict(own, GOAL_COMMAND_MS))
        rows.append((case, *of_core, *of_command))
    columns = ("case", "core, wall ms", "goal", "", "command, wall ms", "its own", "goal", "")
    return bench_report.table(columns, rows)


if __name__ == "__main__":
    main()
