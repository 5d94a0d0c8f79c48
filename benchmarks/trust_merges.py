"""The pieces of work of the trust benchmark: merges and searches, each a row of numbers for the tables."""

from __future__ import annotations

import itertools
import random
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mapmeld
import trust_cases
import trust_failures
import trust_score
from mapmeld import _core, se2
from mapmeld.truth import parse_truth
from trust_cases import MapPair

Row = dict[str, Any]
"""JSON values by name."""
ANOTHER_PLACE_M = 1.0
"""How far a map lies from its best place when that is another one."""


def pair_facts(pair: MapPair) -> Row:
    """What a row says of the pair itself."""
    return {
        "case_a": pair.a.case,
        "a": pair.a.name,
        "case_b": pair.b.case,
        "b": pair.b.name,
        "family": pair.family,
        "simulated": pair.simulated,
        "band": pair.band,
        "walls": pair.walls,
        "bent": pair.bent,
        "laser": pair.laser,
        "T_true": trust_score.rounded(pair.T_a_b),
    }


def judged(pair: MapPair, T: NDArray[np.float64] | list[float] | None) -> trust_score.Verdict | None:
    """The verdict on T_a_b; None without one, or without a truth."""
    if T is None or pair.T_a_b is None:
        return None
    resolution = trust_cases.grid(pair.b.path, "b").resolution
    return trust_score.judge(T, pair.T_a_b, pair.rms_m, trust_cases.centre(pair.b.path), resolution)


@dataclass(frozen=True)
class PairMerge:
    """Two maps alone."""

    pair: MapPair
    seed: int

    def run(self) -> Row:
        grids = [trust_cases.grid(self.pair.a.path, "a"), trust_cases.grid(self.pair.b.path, "b")]
        cpu, started = time.process_time(), time.perf_counter()
        result = mapmeld.merge(grids, seed=self.seed, threads=1)
        cpu, seconds = time.process_time() - cpu, time.perf_counter() - started
        T = trust_score.relative(result, 0, 1)
        told = result.to_dict()
        best = told["pairs"][0] if told["pairs"] else {}
        mode = best.get("T_a_b")
        in_order = best.get("a") == "a"
        mode_T = mode if mode is None or in_order else se2.inverse(mode)
        seen = judged(self.pair, mode_T)
        right = self.pair.T_a_b
        modes = [m.T_a_b if in_order else se2.inverse(m.T_a_b) for p in result.pairs for m in p.modes]
        verdicts = [judged(self.pair, m) for m in modes]
        rank = next((k for k, v in enumerate(verdicts) if v is not None and v.right), None)
        return {
            **pair_facts(self.pair),
            "seed": self.seed,
            "joined": T is not None,
            **trust_score.verdict_fields(judged(self.pair, T), T is not None),
            "statuses": [m.status for m in result.maps],
            "probability": told["probability"],
            "mode_probability": best.get("probability"),
            "mode_right": seen is not None and seen.right,
            "evidence": trust_failures.evidence(best, rank, self._rival(result)),
            "nees": None if right is None else trust_score.nees(result, right),
            "T_found": trust_score.rounded(T),
            "T_mode": trust_score.rounded(mode_T),
            "seconds": seconds,
            "cpu": cpu,
        }

    def _rival(self, result: mapmeld.MergeResult) -> float:
        """The most that another place than the best mode's reaches, nats."""
        modes = [m for p in result.pairs for m in p.modes]
        if not modes:
            return 0.0
        centre = trust_cases.centre(self.pair.b.path)
        away = [
            m.log_likelihood
            for m in modes
            if trust_score.judge(m.T_a_b, modes[0].T_a_b, 0.0, centre, 0.0).error_m > ANOTHER_PLACE_M
        ]
        return max(away, default=0.0)


@dataclass(frozen=True)
class WholeMerge:
    """All maps of a case at once, or those of some names."""

    folder: Path
    seed: int
    names: tuple[str, ...] = ()

    def run(self) -> Row:
        files = [m for m in trust_cases.map_files(self.folder) if not self.names or m.name in self.names]
        grids = [trust_cases.grid(m.path, m.name) for m in files]
        started = time.perf_counter()
        result = mapmeld.merge(grids, seed=self.seed, threads=1)
        seconds = time.perf_counter() - started
        known = parse_truth(trust_cases.truth(self.folder), self.folder.name)
        friends = {m.name: 1 for m in files}
        joined = wrong = 0
        errors = []
        for i, j in itertools.combinations(range(len(files)), 2):
            a, b = files[i], files[j]
            T, reference = trust_score.relative(result, i, j), known.reference(a.name, b.name)
            if T is None or reference is None:
                continue
            verdict = trust_score.judge(
                T, reference.T_a_b, reference.rms_m, trust_cases.centre(b.path), grids[j].resolution
            )
            joined += 1
            wrong += verdict.wrong
            if verdict.right:
                friends[a.name] += 1
                friends[b.name] += 1
                errors.append(verdict.error_m)
        most = max(friends.values())
        return {
            "case": self.folder.name,
            "seed": self.seed,
            "names": [m.name for m in files],
            "maps": len(files),
            "placed": most if most > 1 else 0,
            "joined": joined,
            "right": len(errors),
            "wrong": wrong,
            "parts": len(result.components),
            "error_m": statistics.median(errors) if errors else None,
            "seconds": seconds,
        }


@dataclass(frozen=True)
class Reordered:
    """The same maps in other orders and with another reference: is the answer the same?"""

    case: str
    files: tuple[trust_cases.MapFile, ...]

    def run(self) -> Row:
        names = [f"{k}_{m.name}" for k, m in enumerate(self.files)]
        grids = [trust_cases.grid(m.path, n) for m, n in zip(self.files, names, strict=True)]
        centres = [trust_cases.centre(m.path) for m in self.files]
        shuffled = list(range(len(grids)))
        random.Random(1).shuffle(shuffled)
        base = mapmeld.merge(grids, seed=1, threads=1)
        first = base.components[0].reference
        # A map that is merged with others, where there is one; else any.
        other = next((n for n in reversed(base.components[0].order) if n != first), names[-1])
        variants: dict[str, mapmeld.MergeResult] = {
            "swapped" if len(grids) == 2 else "reversed": mapmeld.merge(grids[::-1], seed=1, threads=1),
            "other reference": mapmeld.merge(grids, seed=1, threads=1, reference=other),
        }
        if len(grids) > 2:
            variants["shuffled"] = mapmeld.merge([grids[k] for k in shuffled], seed=1, threads=1)
        answers = {
            name: _difference(base, result, names, centres, self.files) for name, result in variants.items()
        }
        return {"case": self.case, "maps": len(grids), "variants": answers}


def _difference(
    base: mapmeld.MergeResult,
    other: mapmeld.MergeResult,
    names: Sequence[str],
    centres: Sequence[tuple[float, float]],
    files: Sequence[trust_cases.MapFile],
) -> Row:
    at = [[m.name for m in r.maps] for r in (base, other)]
    groups = [
        {frozenset(m.name for m in r.maps if m.component == k.component) for k in r.maps}
        for r in (base, other)
    ]
    status = [{m.name: m.status for m in r.maps} for r in (base, other)]
    metres = degrees = 0.0
    for (_, a), (j, b) in itertools.combinations(enumerate(names), 2):
        T, U = (
            trust_score.relative(r, order.index(a), order.index(b))
            for r, order in zip((base, other), at, strict=True)
        )
        if T is not None and U is not None:
            error = trust_score.judge(U, T, 0.0, centres[j], 0.0)
            metres, degrees = max(metres, error.error_m), max(degrees, error.error_deg)
    return {
        "same_parts": groups[0] == groups[1],
        "same_statuses": status[0] == status[1],
        "metres": metres,
        "degrees": degrees,
    }


@dataclass(frozen=True)
class Search:
    """What the candidates and the refined modes of a pair hold."""

    pair: MapPair

    def run(self) -> Row:
        a, b = (
            _core.LocalMap(g.name, g.data, g.resolution, g.origin, "{}")
            for g in (trust_cases.grid(self.pair.a.path, "a"), trust_cases.grid(self.pair.b.path, "b"))
        )
        counts: dict[str, int] = {}
        right: dict[str, bool] = {}
        for source, T in _core.candidates(a, b, "{}"):
            counts[source] = counts.get(source, 0) + 1
            right[source] = right.get(source, False) or self._is_right(T)
        _, modes = _core.register(a, b, "{}")
        rank = next((k for k, m in enumerate(modes) if self._is_right(m["T_a_b"])), None)
        return {
            **pair_facts(self.pair),
            "candidates": counts,
            "right_from": sorted(s for s, is_right in right.items() if is_right),
            "modes": len(modes),
            "rank": rank,
        }

    def _is_right(self, T: list[float]) -> bool:
        verdict = judged(self.pair, T)
        return verdict is not None and verdict.right
