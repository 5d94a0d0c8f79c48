"""Pairs and cases with truth that the trust benchmark merges, from bundled, shared or simulated folders."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import bench_cases
import mapmeld
from mapmeld import datasets, metrics, se2
from mapmeld.truth import Pose, parse_truth

MOST_RESIDUAL_M = 0.75
"""Pairs whose truth leaves more than this are not asked."""
MANY_WALLS, FEW_WALLS = 0.25, 0.05
"""Shares of walls in common (overlap_occupied) that part the two bands of pairs."""
NO_WALLS, NO_FLOOR = 0.01, 0.02
"""Below both, two maps of one building have nothing in common to be merged by."""


@dataclass(frozen=True)
class MapFile:
    """A map of a case, and where it is."""

    case: str
    name: str
    path: Path

    @property
    def building(self) -> str:
        """Maps of two of these must not be merged."""
        return building(self.case)


def building(case: str) -> str:
    """The building of a case, by its name."""
    parts = case.split("_")
    return "_".join(parts[:2]) if parts[0] == "halmstad" else parts[0]


@dataclass(frozen=True)
class MapPair:
    """Two maps and their truth.

    T_a_b, rms_m: the truth, and the residual in metres that it leaves; T_a_b None for maps of different
    buildings. walls: overlap_occupied, floor: overlap, 0..1. bent: maps drawn along a drifting path.
    laser: from a recorded laser log whose corrected poses are the truth.
    """

    a: MapFile
    b: MapFile
    T_a_b: Pose | None = None
    rms_m: float = 0.0
    walls: float = 0.0
    floor: float = 0.0
    bent: bool = False
    laser: bool = False

    @property
    def turned(self) -> MapPair:
        """The same two maps, the second first."""
        if self.T_a_b is None:
            return replace(self, a=self.b, b=self.a)
        x, y, theta = (float(v) for v in se2.inverse(self.T_a_b))
        return replace(self, a=self.b, b=self.a, T_a_b=(x, y, theta))

    @property
    def family(self) -> str:
        """The case name's first part; simulated worlds lose their seed."""
        return self.a.case.split("_")[0].rstrip("0123456789") if self.simulated else self.a.case.split("_")[0]

    @property
    def simulated(self) -> bool:
        """By mapmeld simulate, for this benchmark."""
        return "_sim" in self.a.case

    @property
    def band(self) -> str | None:
        """Which band of walls in common the pair is in; None below both, and where the truth is too loose."""
        if self.T_a_b is None or self.rms_m > MOST_RESIDUAL_M or self.walls < FEW_WALLS:
            return None
        return "many" if self.walls >= MANY_WALLS else "few"


@lru_cache(maxsize=64)
def grid(path: Path, name: str) -> mapmeld.OccupancyGrid:
    """The map in a file, called `name`."""
    return replace_name(mapmeld.read_map(path), name)


def replace_name(g: mapmeld.OccupancyGrid, name: str) -> mapmeld.OccupancyGrid:
    """The same map under another name."""
    return mapmeld.OccupancyGrid(g.data, g.resolution, g.origin, name)


@lru_cache(maxsize=512)
def centre(path: Path) -> tuple[float, float]:
    """Of the known cells, map coordinates in metres; the origin for a map that knows nothing."""
    return metrics.centre_of_known_cells(mapmeld.read_map(path)) or (0.0, 0.0)


def folders(only: Sequence[str] | None) -> list[Path]:
    """The shared cases in order of name; with `only`, those whose names contain one of the texts, and bundled
    cases of exactly such a name."""
    found = [p.parent for p in sorted(bench_cases.shared_data().glob("*/truth.json"))]
    found = [f for f in found if not f.name.endswith("_frontend")]
    found = [f for f in found if not f.name.startswith("halmstad") or f.name.endswith("_half")]
    if only is None:
        return found
    chosen = [f for f in found if any(text in f.name for text in only)]
    names = {f.name for f in chosen}
    return chosen + [datasets.bundled(n) for n in datasets.names() if n in only and n not in names]


@lru_cache(maxsize=512)
def truth(folder: Path) -> dict[str, Any]:
    """The contents of the folder's truth.json."""
    found: dict[str, Any] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return found


def map_files(folder: Path) -> list[MapFile]:
    """The maps of a case in order of name, which is the order in which a shell would give them."""
    return [MapFile(folder.name, p.stem, p) for p in sorted(folder.glob("*.yaml"))]


def pairs(folder: Path) -> Iterator[MapPair]:
    """Every pair that the truth of a case tells of, held against the pair's own transform."""
    told = truth(folder)
    laser = str(told.get("truth", "")).startswith("corrected log")
    for p in told.get("pairs", []):
        T = p.get("T_a_b")
        yield MapPair(
            a=_map_file(folder, p["a"]),
            b=_map_file(folder, p["b"]),
            T_a_b=None if T is None else (float(T[0]), float(T[1]), float(T[2])),
            rms_m=float(p.get("rms_m") or 0.0),
            walls=float(p.get("overlap_occupied", 1.0)),
            floor=float(p.get("overlap") or 0.0),
            bent=told.get("variant") == "drift",
            laser=laser,
        )


def apart(folder: Path) -> list[MapPair]:
    """The pairs of a case that have nothing in common, held against the frames of their maps."""
    known = parse_truth(truth(folder), folder.name)
    found = []
    for p in pairs(folder):
        reference = known.reference(p.a.name, p.b.name)
        if p.walls < NO_WALLS and p.floor < NO_FLOOR and reference is not None:
            found.append(replace(p, T_a_b=reference.T_a_b, rms_m=reference.rms_m))
    return found


def negatives(only: Sequence[str] | None) -> list[MapPair]:
    """The shared list of pairs of different buildings; with `only`, those of which both cases are chosen."""
    data = bench_cases.shared_data()
    if not (data / "negatives.json").is_file():
        return []
    found = []
    for p in json.loads((data / "negatives.json").read_text(encoding="utf-8"))["pairs"]:
        a, b = (_map_file(data / case, name) for case, name in (p[k].split("/") for k in ("a", "b")))
        if only is None or all(any(text in m.case for text in only) for m in (a, b)):
            found.append(MapPair(a, b))
    return found


def _map_file(folder: Path, name: str) -> MapFile:
    return MapFile(folder.name, name, folder / f"{name}.yaml")
