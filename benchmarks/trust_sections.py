"""What each section of the trust benchmark has to measure, and the table that shows it."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import trust_beliefs
import trust_buildings
import trust_cases
import trust_failures
import trust_peers
import trust_tables
from trust_cases import MapPair
from trust_merges import PairMerge, Reordered, Row, Search, WholeMerge

_T = TypeVar("_T")


class Task(Protocol):
    """A piece of work; equal ones give equal rows, but for times."""

    def run(self) -> Any: ...


@dataclass(frozen=True)
class Plan:
    """How much to measure.

    only: texts in the names of cases, None for all. seeds: of the merges, from 1. sample: at most so many
    pairs, and cases, of each section. worlds: of the simulated buildings; strangers, scattered and wholes:
    how many of each a world. draws: of some of a case's maps, for each case. unrelated: pairs of these and of
    recorded maps. cache: folder of what is simulated.
    """

    cache: Path
    only: tuple[str, ...] | None = None
    seeds: int = 5
    sample: int | None = None
    unrelated: int = 3000
    worlds: tuple[str, ...] = trust_buildings.WORLDS
    strangers: int = 12
    scattered: int = 4
    wholes: int = 6
    draws: int = 40

    @property
    def folders(self) -> list[Path]:
        return trust_cases.folders(self.only)

    def buildings(self, sections: Sequence[str]) -> list[trust_buildings.Building]:
        """What must be simulated first."""
        found: list[trust_buildings.Building] = []
        if "unrelated" in sections:
            found += trust_buildings.strangers(self.strangers, self.cache, self.worlds)
        if "same" in sections:
            found += trust_buildings.scattered(self.scattered, self.cache, self.worlds)
        if "whole" in sections or "covariance" in sections:
            found += trust_buildings.wholes(self.wholes, self.cache, self.worlds)
        return found

    def banded(self) -> list[MapPair]:
        """The pairs of both bands."""
        return self.some([p for f in self.folders for p in trust_cases.pairs(f) if p.band is not None])

    def whole_cases(self) -> list[Path]:
        """Cases of three maps or more that are not simulated here."""
        return self.some([f for f in self.folders if len(trust_cases.map_files(f)) >= 3])

    def simulated_wholes(self) -> list[Path]:
        return [b.folder for b in trust_buildings.wholes(self.wholes, self.cache, self.worlds)]

    def some(self, items: list[_T]) -> list[_T]:
        """The items; a sample of them, in their order, where the plan says so."""
        if self.sample is None or len(items) <= self.sample:
            return items
        chosen = sorted(random.Random(7).sample(range(len(items)), self.sample))
        return [items[k] for k in chosen]

    def every_seed(self, pairs: Sequence[MapPair]) -> list[PairMerge]:
        return [PairMerge(p, seed) for p in pairs for seed in range(1, self.seeds + 1)]


def pairs(plan: Plan) -> Sequence[Task]:
    return plan.every_seed(plan.banded())


def negatives(plan: Plan) -> Sequence[Task]:
    return plan.every_seed(plan.some(trust_cases.negatives(plan.only)))


def unrelated(plan: Plan) -> Sequence[Task]:
    """One seed a pair, in turn: more buildings tell more than more seeds."""
    simulated = [b.folder for b in trust_buildings.strangers(plan.strangers, plan.cache, plan.worlds)]
    found = trust_buildings.unrelated(plan.unrelated, plan.folders, simulated)
    return [PairMerge(p, 1 + k % plan.seeds) for k, p in enumerate(found)]


def same(plan: Plan) -> Sequence[Task]:
    """All seeds of recorded cases, one of simulated buildings."""
    recorded = plan.some([p for f in plan.folders for p in trust_cases.apart(f)])
    made = trust_buildings.scattered(plan.scattered, plan.cache, plan.worlds)
    simulated = plan.some([p for b in made for p in trust_cases.apart(b.folder)])
    return [*plan.every_seed(recorded), *(PairMerge(p, 1) for p in simulated)]


def whole(plan: Plan) -> Sequence[Task]:
    recorded = [WholeMerge(f, seed) for f in plan.whole_cases() for seed in range(1, plan.seeds + 1)]
    return [*recorded, *(WholeMerge(f, 1) for f in plan.some(plan.simulated_wholes()))]


def some(plan: Plan) -> Sequence[Task]:
    """Three to six maps, not all, of each recorded case of six or more, drawn at random: other pairs hold
    them together. A seed a draw."""
    found = []
    for folder in plan.whole_cases():
        names = [m.name for m in trust_cases.map_files(folder)]
        rng = random.Random(folder.name)
        for seed in range(1, 1 + plan.draws * (len(names) >= 6)):
            few = rng.sample(names, rng.randint(3, min(6, len(names) - 1)))
            found.append(WholeMerge(folder, seed, tuple(sorted(few))))
    return found


def invariance(plan: Plan) -> Sequence[Task]:
    """Forty pairs, and every whole case."""
    banded = plan.banded()
    chosen = sorted(random.Random(7).sample(range(len(banded)), min(40, len(banded))))
    two = [Reordered(f"{p.a.case}: {p.a.name}, {p.b.name}", (p.a, p.b)) for p in (banded[k] for k in chosen)]
    return [*two, *(Reordered(f.name, tuple(trust_cases.map_files(f))) for f in plan.whole_cases())]


def covariance(plan: Plan) -> Sequence[Task]:
    """Recorded pairs, and those of simulated buildings that share a quarter of their walls."""
    simulated = [p for f in plan.simulated_wholes() for p in trust_cases.pairs(f) if p.band == "many"]
    return [PairMerge(p, 1) for p in [*plan.banded(), *plan.some(simulated)]]


def recall(plan: Plan) -> Sequence[Task]:
    return [Search(p) for p in plan.banded()]


def peers(plan: Plan) -> Sequence[Task]:
    asked = [*plan.banded(), *plan.some(trust_cases.negatives(plan.only))]
    found: list[Task] = [trust_peers.PeerMatch(m, p) for m in trust_peers.methods() for p in asked]
    return [*(PairMerge(p, 1) for p in asked), *found]


@dataclass(frozen=True)
class Part:
    """A section: its title, its work, how its rows are shown. of: sections whose rows it shows as well."""

    title: str
    tasks: Callable[[Plan], Sequence[Task]] | None
    show: Callable[[trust_tables.Rows], trust_tables.Section]
    of: tuple[str, ...] = ()


def show_peers(rows: trust_tables.Rows) -> trust_tables.Section:
    return trust_beliefs.peers(
        [
            r if "method" in r else {**r, "method": "mapmeld", "accepted": r["joined"], "score": 0.0}
            for r in rows
        ]
    )


def show_pairs(rows: trust_tables.Rows) -> trust_tables.Section:
    text, goals = trust_tables.pairs(rows)
    return text + trust_tables.PAIRS_LEGEND, goals


def show_failures(rows: Sequence[Row]) -> trust_tables.Section:
    """Every failed pair with its cause."""
    return trust_failures.table(rows) + trust_failures.LEGEND, []


PARTS: dict[str, Part] = {
    "pairs": Part("Two maps alone", pairs, show_pairs),
    "negatives": Part(
        "The listed pairs of different buildings",
        negatives,
        lambda rows: trust_tables.strangers(rows, "listed pairs of different buildings: merged"),
    ),
    "unrelated": Part(
        "Many pairs of different buildings",
        unrelated,
        lambda rows: trust_tables.strangers(rows, "unrelated pairs: merged"),
    ),
    "same": Part("One building, nothing in common", same, trust_tables.same),
    "whole": Part("All maps of a case at once", whole, trust_tables.whole),
    "some": Part("Some maps of a case at once", some, trust_tables.some),
    "calibration": Part(
        "Stated probabilities",
        None,
        trust_beliefs.calibration,
        of=("pairs", "negatives", "unrelated", "same"),
    ),
    "failures": Part(
        "The failed pairs, one by one",
        None,
        show_failures,
        of=("pairs", "negatives", "unrelated", "same"),
    ),
    "invariance": Part("Other orders of the same maps", invariance, trust_beliefs.invariance),
    "covariance": Part("Stated covariances", covariance, trust_beliefs.covariance),
    "recall": Part("Candidates and modes", recall, trust_beliefs.recall),
    "peers": Part("Other methods", peers, show_peers),
}


def measured(names: Sequence[str]) -> list[str]:
    """The sections that have work of their own, for these to be shown."""
    wanted = {n for name in names for n in (name, *PARTS[name].of)}
    return [n for n, part in PARTS.items() if n in wanted and part.tasks is not None]


def finish(name: str, rows: list[Row], plan: Plan) -> list[Row]:
    """Adds what a row needs of its case, once the work is done."""
    if name != "whole":
        return rows
    by_name = {f.name: f for f in [*plan.folders, *plan.simulated_wholes()]}
    return [{**r, "linked": trust_buildings.linked(by_name[r["case"]])} for r in rows]
