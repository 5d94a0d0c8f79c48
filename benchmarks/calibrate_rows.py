"""The pairs of maps that the verdict is calibrated with, each a row of features and whether it is right."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import trust_buildings
import trust_cases
import trust_merges
from mapmeld import _core
from mapmeld.simulate import SimulateOptions
from trust_buildings import Building
from trust_cases import MapFile, MapPair

Row = dict[str, Any]
"""JSON values by name."""

STRANGERS = "different buildings"
"""The group of pairs of maps that are of no one building."""
EXACT_COPIES = ("wings", "symmetric")
"""Worlds that repeat themselves to the last chair: nothing in maps of two copies tells that they are two.
Their own wrong answers are left out of the fit: they would teach that no evidence suffices."""
RADII: dict[str, tuple[float | None, ...]] = {
    "maze": (None, None, 5.0),
    "home": (None, 3.5, 5.0, None),
    "corridors": (None, 15.0, 25.0, None),
}
"""How far the robots of some worlds go, in turn, metres."""
_SEED, _DRIFTED_SEED, _RECORDED_SEED = 100, 300, 200


def buildings(scale: float, cache: Path) -> list[Building]:
    """Buildings to simulate, of other seeds than those of benchmarks/trust.py.

    Robots drive in generated worlds and in recorded maps, so that real walls are seen with all kinds of
    overlap and drift.
    """
    found = []
    for world in trust_buildings.WORLDS:
        for k in range(round(16 * scale)):
            found.append(_generated(world, _SEED + k, (0.0, 1.0, 0.0, 2.0, 1.0)[k % 5], k))
    for world in ("office", "maze", "halls"):
        for k in range(round(6 * scale)):
            found.append(_generated(world, _DRIFTED_SEED + k, (3.0, 5.0)[k % 2], k))
    for path in _recorded_worlds():
        for k in range(max(1, round(8 * scale))):
            found.append(
                SimulateOptions(
                    world=str(path),
                    seed=_RECORDED_SEED + k,
                    robots=4,
                    drift=(0.0, 1.0, 2.0, 3.0)[k % 4],
                    region_radius=(None, 8.0, 12.0)[k % 3],
                )
            )
    return [Building(options, cache) for options in found]


def _generated(world: str, seed: int, drift: float, k: int) -> SimulateOptions:
    radii = RADII.get(world, (None, 8.0, 12.0, None))
    return SimulateOptions(
        world=world,
        seed=seed,
        robots=4,
        size=trust_buildings.SIZES[world][k % 3],
        resolution=trust_buildings.RESOLUTIONS[k % 5],
        drift=drift,
        region_radius=radii[k % len(radii)],
    )


def _recorded_worlds() -> list[Path]:
    """One recorded map of each building, the one with the largest grid."""
    best: dict[str, tuple[int, Path]] = {}
    for folder in trust_cases.folders(None):
        for m in trust_cases.map_files(folder):
            if m.building.startswith("maze"):
                continue
            g = trust_cases.grid(m.path, m.name)
            best[m.building] = max(best.get(m.building, (0, m.path)), (g.width * g.height, m.path))
    return [path for _, path in best.values()]


def build(building: Building) -> None:
    """Simulates it, unless that was done before."""
    building.run()


@dataclass(frozen=True)
class Asked:
    """A pair; group: what it is counted under; buildings: what must be left out to learn nothing of it."""

    pair: MapPair
    group: str
    buildings: tuple[str, ...]

    @property
    def turned(self) -> Asked:
        """The same two maps, the second first: what chance reaches is looked for anew."""
        return replace(self, pair=self.pair.turned)


def pairs(simulated: Sequence[Path], scale: float) -> list[Asked]:
    """Pairs of one building, whatever they share, and pairs of different ones."""
    recorded = trust_cases.folders(None)
    found = []
    for folder in [*recorded, *simulated]:
        kind = kind_of(folder)
        made = folder in set(simulated)
        apart = {(p.a.path, p.b.path): p for p in trust_cases.apart(folder)}
        for p in trust_cases.pairs(folder):
            group = f"{kind} (simulated)" if made else kind
            found.append(Asked(apart.get((p.a.path, p.b.path), p), group, (kind,)))
    rng = random.Random(3)
    ours, others = _by_building(simulated), _by_building(recorded)
    for count, first, second in ((500, others, others), (500, others, ours), (1500, ours, ours)):
        if first and second:
            found += [_strangers(rng, first, second) for _ in range(round(count * scale))]
    return found


def kind_of(folder: Path) -> str:
    """What a case is left out with: its building, or its kind of generated world."""
    options = trust_cases.truth(folder).get("options") or {}
    world = str(options.get("world", ""))
    if world.endswith(".yaml"):
        return kind_of(Path(world).parent)
    return world or trust_cases.building(folder.name)


def _by_building(folders: Sequence[Path]) -> dict[tuple[str, str], list[MapFile]]:
    """Maps by what may be called unrelated: maps of one recorded building never are."""
    found: dict[tuple[str, str], list[MapFile]] = {}
    for folder in folders:
        kind = kind_of(folder)
        generated = kind in trust_buildings.WORLDS
        found.setdefault((kind, folder.name if generated else ""), []).extend(trust_cases.map_files(folder))
    return found


def _strangers(
    rng: random.Random,
    first: dict[tuple[str, str], list[MapFile]],
    second: dict[tuple[str, str], list[MapFile]],
) -> Asked:
    while True:
        one, two = rng.choice(sorted(first)), rng.choice(sorted(second))
        if one != two:
            break
    pair = MapPair(rng.choice(first[one]), rng.choice(second[two]))
    return Asked(pair, STRANGERS, tuple(sorted({one[0], two[0]})))


def measure(asked: Asked) -> Row | None:
    """The row of a pair; None where nothing was found, or where it cannot be told whether it is right."""
    a, b = _prepared(asked.pair.a.path), _prepared(asked.pair.b.path)
    weighed = _core.weigh(a, b, _mirrored(asked.pair.b.path), "{}")
    if weighed["features"] is None:
        return None
    right = False
    if asked.group != STRANGERS:
        verdict = trust_merges.judged(asked.pair, weighed["modes"][0]["T_a_b"])
        # Neither right nor wrong: nothing to learn from.
        if verdict is None or not (verdict.right or verdict.wrong):
            return None
        right = verdict.right
        if not right and asked.buildings[0] in EXACT_COPIES:
            return None
    return {
        "a": f"{asked.pair.a.case}/{asked.pair.a.name}",
        "b": f"{asked.pair.b.case}/{asked.pair.b.name}",
        "group": asked.group,
        "buildings": list(asked.buildings),
        "walls": asked.pair.walls,
        "rung": weighed["rung"],
        "features": weighed["features"],
        "right": right,
    }


@lru_cache(maxsize=128)
def _prepared(path: Path) -> _core.LocalMap:
    g = trust_cases.grid(path, path.stem)
    return _core.LocalMap(g.name, g.data, g.resolution, g.origin, "{}")


@lru_cache(maxsize=128)
def _mirrored(path: Path) -> _core.LocalMap:
    return _prepared(path).mirrored()
