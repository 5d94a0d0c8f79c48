"""Simulated buildings of the trust benchmark, written once into a folder, and pairs of unrelated maps."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import trust_cases
from mapmeld import simulate as simulator
from mapmeld.simulate import SimulateOptions, simulate, write_case
from trust_cases import MapFile, MapPair

WORLDS = (
    "maze", "office", "cells", "halls", "wings", "symmetric", "concourse", "warehouse", "home", "corridors",
)  # fmt: skip
SIZES: dict[str, tuple[tuple[float, float] | None, ...]] = {
    "maze": (None, (9.6, 9.6), (18.0, 12.0)),
    "office": (None, (26.0, 18.0), (56.0, 28.0)),
    "cells": (None, (24.0, 12.0), (90.0, 16.0)),
    "halls": ((60.0, 30.0), (80.0, 40.0), None),
    "wings": (None, (36.0, 20.0), (74.0, 32.0)),
    "symmetric": (None, (20.0, 18.0), (40.0, 30.0)),
    "concourse": ((60.0, 36.0), (44.0, 28.0), None),
    "warehouse": ((44.0, 36.0), None, (36.0, 44.0)),
    "home": (None, (9.0, 7.5), (18.0, 12.0)),
    "corridors": ((70.0, 40.0), None, (110.0, 36.0)),
}
NEAR = {"maze": 3.0, "home": 3.0, "corridors": 15.0}
"""How far robots go where they are to have little in common, metres; six in the other worlds."""
RESOLUTIONS = (0.05, 0.05, 0.1, 0.05, 0.04)
_STRANGER_SEED, _APART_SEED, _WHOLE_SEED = 1000, 1500, 2000


@dataclass(frozen=True)
class Building:
    """A case to simulate into a folder of `cache`, whose name holds all that shapes it."""

    options: SimulateOptions
    cache: Path

    @property
    def folder(self) -> Path:
        told = json.dumps(self.options.to_dict(), sort_keys=True) + _simulator()
        digest = hashlib.sha256(told.encode()).hexdigest()[:8]
        world = Path(self.options.world)
        name = f"{world.parent.name}-{world.stem}-" if world.suffix else self.options.world
        return self.cache / f"{name}{self.options.seed}_sim_{digest}"

    def run(self) -> None:
        """Simulates it, unless that was done before."""
        if (self.folder / "truth.json").is_file():
            return
        self.cache.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=self.cache, prefix="draft_"))
        try:
            write_case(simulate(self.options), draft)
            draft.chmod(0o755)
            os.replace(draft, self.folder)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def strangers(count: int, cache: Path, worlds: Sequence[str] = WORLDS) -> list[Building]:
    """`count` buildings a world: sizes, cells, drifts and numbers of robots take turns."""
    return [
        Building(
            SimulateOptions(
                world=world,
                seed=_STRANGER_SEED + k,
                robots=2 + k % 2,
                size=SIZES[world][k % 3],
                resolution=RESOLUTIONS[k % 5],
                drift=(0.0, 1.0, 0.0, 2.0)[k % 4],
            ),
            cache,
        )
        for world in worlds
        for k in range(count)
    ]


def scattered(count: int, cache: Path, worlds: Sequence[str] = WORLDS) -> list[Building]:
    """`count` buildings a world with small regions, so that many of their maps have nothing in common."""
    return [
        Building(
            SimulateOptions(
                world=world,
                seed=_APART_SEED + k,
                robots=6,
                region_radius=NEAR.get(world, 6.0),
                path_length=6.0 * NEAR.get(world, 6.0),
                max_range=4.0 if world == "maze" else 8.0,
                drift=float(k % 2),
            ),
            cache,
        )
        for world in worlds
        for k in range(count)
    ]


def wholes(count: int, cache: Path, worlds: Sequence[str] = WORLDS) -> list[Building]:
    """`count` buildings a world, four maps each, every second one bent."""
    return [
        Building(
            SimulateOptions(
                world=world,
                seed=_WHOLE_SEED + k,
                robots=4,
                size=SIZES[world][0],
                drift=float(k % 2),
            ),
            cache,
        )
        for world in worlds
        for k in range(count)
    ]


def unrelated(count: int, real: Sequence[Path], simulated: Sequence[Path]) -> list[MapPair]:
    """`count` different pairs of maps of different buildings: half of simulated maps alone, a quarter of real
    ones, a quarter mixed; all simulated where there are no real ones. Buildings are drawn first, then maps,
    so that one with many maps does not stand for all."""
    rng = random.Random(1000)
    ours, others = _by_building(simulated), _by_building(real)
    quarter = count // 4 if others else 0
    found: dict[tuple[Path, Path], MapPair] = {}
    _draw(rng, found, len(found) + quarter, others, others)
    _draw(rng, found, len(found) + quarter, others, ours)
    _draw(rng, found, count, ours, ours)
    return list(found.values())


def _draw(
    rng: random.Random,
    found: dict[tuple[Path, Path], MapPair],
    count: int,
    first: dict[str, list[MapFile]],
    second: dict[str, list[MapFile]],
) -> None:
    """Adds pairs until there are `count`, or until hardly any are left."""
    if not first or not second:
        return
    for _ in range(50 * max(count, 1)):
        if len(found) >= count:
            return
        one, two = rng.choice(sorted(first)), rng.choice(sorted(second))
        if one == two:
            continue
        a, b = rng.choice(first[one]), rng.choice(second[two])
        if (a.path, b.path) not in found and (b.path, a.path) not in found:
            found[a.path, b.path] = MapPair(a, b)


def _by_building(folders: Sequence[Path]) -> dict[str, list[MapFile]]:
    found: dict[str, list[MapFile]] = {}
    for folder in folders:
        for m in trust_cases.map_files(folder):
            found.setdefault(m.building, []).append(m)
    return found


def linked(folder: Path) -> int:
    """How many maps of a case hang together by pairs that share a quarter of their walls."""
    groups = {m.name: {m.name} for m in trust_cases.map_files(folder)}
    for p in trust_cases.pairs(folder):
        if p.walls >= trust_cases.MANY_WALLS:
            joint = groups[p.a.name] | groups[p.b.name]
            for name in joint:
                groups[name] = joint
    most = max((len(g) for g in groups.values()), default=0)
    return most if most > 1 else 0


def _simulator() -> str:
    """A digest of the simulator's sources: other sources, other cases."""
    if not _sources:
        folder = Path(str(simulator.__file__)).parent
        texts = [p.read_bytes() for p in sorted(folder.glob("*.py"))]
        _sources.append(hashlib.sha256(b"".join(texts)).hexdigest())
    return _sources[0]


_sources: list[str] = []
