"""The cases that the benchmarks merge: bundled, shared or simulated maps, with their truth."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mapmeld
from bench_report import REPOSITORY
from mapmeld import datasets, metrics
from mapmeld.evaluation import Evaluation
from mapmeld.simulate import SimulateOptions, simulate


@dataclass(frozen=True)
class Case:
    """Maps with truth; centres (x, y) and cells in metres by map, as mapmeld.metrics wants them."""

    name: str
    maps: tuple[mapmeld.OccupancyGrid, ...]
    truth: dict[str, Any]
    centres: dict[str, tuple[float, float]]
    resolutions: dict[str, float]

    def judge(self, result: mapmeld.MergeResult) -> Evaluation:
        """The errors of a merge of these maps."""
        return metrics.evaluate(result.to_dict(), self.truth, self.centres, self.resolutions)


def shared_data() -> Path:
    """Folder of the recorded maps, which need not be there: $MAPMELD_SHARED/data, or ../shared/data as seen
    from the repository."""
    return Path(os.environ.get("MAPMELD_SHARED", REPOSITORY.parent / "shared")) / "data"


def find(name: str) -> Path | None:
    """The folder of a bundled or shared case; None when there is none of that name."""
    if name in datasets.names():
        return datasets.bundled(name)
    folder = shared_data() / name
    return folder if (folder / "truth.json").is_file() else None


def load(folder: Path) -> Case:
    """A case folder's maps and truth."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    maps = tuple(mapmeld.read_map(folder / f"{m['name']}.yaml") for m in truth["maps"])
    centres = {g.name: c for g in maps if (c := metrics.centre_of_known_cells(g)) is not None}
    return Case(folder.name, maps, truth, centres, {g.name: g.resolution for g in maps})


def connected_mazes(options: SimulateOptions) -> tuple[mapmeld.OccupancyGrid, ...]:
    """Simulated maps in an order in which each shares walls with an earlier one, as far as they do: every
    head of the list can be merged, and the list is a known order."""
    case = simulate(options)
    pairs: Any = case.truth["pairs"]
    shares = {frozenset((p["a"], p["b"])): p["overlap_occupied"] for p in pairs}
    by_name = {g.name: g for g in case.maps}
    names = [case.maps[0].name]
    while len(names) < len(by_name):
        left = [n for n in by_name if n not in names]
        names.append(max(left, key=lambda n: max(shares.get(frozenset((n, m)), 0.0) for m in names)))
    return tuple(by_name[n] for n in names)
