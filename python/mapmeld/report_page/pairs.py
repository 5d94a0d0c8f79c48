"""What is said of two maps: the verdict in words, with the numbers that it rests on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mapmeld.config import least_probability
from mapmeld.one_place import is_one_place
from mapmeld.reasons import Lack, lack_of
from mapmeld.report_page.links import Bond, bonds
from mapmeld.report_page.story import Story

_LEAST = 1e-9
"""Probabilities are told apart as far as this from 0 and 1."""


@dataclass(frozen=True)
class PairRow:
    """A row of the table of pairs.

    shared: metres of wall. second: share of the hits that holds the weaker direction, conflicts: share of the
    walls amid free space of the other; 0..1. over_runner_up, over_decoy: by how much the best mode is
    likelier, nats. None where there is no such number."""

    a: str
    b: str
    status: str
    probability: float
    why: str
    candidates: int
    modes: int
    shared: float | None
    second: float | None
    conflicts: float | None
    over_runner_up: float | None
    over_decoy: float | None


def pair_rows(story: Story, held: Sequence[Bond] | None = None) -> list[PairRow]:
    """All pairs, the doubtful ones first: the weakest link of each component, then those whose probability is
    nearest to the one that is asked for, in log odds. held: the components' bonds, None to find them here."""
    held = bonds(story) if held is None else held
    weakest = {(b.weakest.a, b.weakest.b): b for b in held if b.weakest is not None}
    asked = _log_odds(least_probability(story.found["config"], len(story.found["maps"])))

    def doubt(p: Mapping[str, Any]) -> tuple[Any, ...]:
        distance = abs(_log_odds(p["probability"]) - asked)
        is_link = (p["a"], p["b"]) in weakest
        return not is_link, p["T_a_b"] is None, distance, -(p["log_likelihood"] or 0.0), p["a"], p["b"]

    found = sorted(story.found["pairs"], key=doubt)
    return [_row(p, story, weakest.get((p["a"], p["b"]))) for p in found]


def lack(pair: Mapping[str, Any], story: Story) -> Lack:
    """What speaks most against the best mode of a pair that has one."""
    rival = pair["decoy_log_likelihood"] or 0.0
    second = pair["runner_up"]
    if second is not None and not is_one_place(second["T_a_b"], pair["T_a_b"], story.centres[pair["b"]]):
        rival = max(rival, second["log_likelihood"] or 0.0)
    keys = ("shared_length", "hits", "conflicts", "second_direction", "log_likelihood")
    length, hits, conflicts, direction, likelihood = (pair[key] or 0.0 for key in keys)
    return lack_of(length, hits, conflicts, direction, likelihood, rival)


def _log_odds(probability: float) -> float:
    p = min(max(probability, _LEAST), 1 - _LEAST)
    return math.log(p / (1 - p))


def _row(pair: Mapping[str, Any], story: Story, weakest_of: Bond | None) -> PairRow:
    has_mode = pair["T_a_b"] is not None
    likelihood, decoy, second = pair["log_likelihood"], pair["decoy_log_likelihood"], pair["runner_up"]
    rival = None if second is None else second["log_likelihood"]
    wall = (pair["hits"] or 0.0) + (pair["conflicts"] or 0.0)
    why = _why(pair, story) if has_mode else "no motion puts walls on walls"
    if weakest_of is not None:
        why = f"the weakest link of component {weakest_of.component}: {why}"
    return PairRow(
        pair["a"],
        pair["b"],
        pair["status"],
        pair["probability"],
        why,
        pair["candidates"],
        pair["modes"],
        pair["shared_length"],
        (pair["second_direction"] or 0.0) / pair["hits"] if pair["hits"] else None,
        pair["conflicts"] / wall if wall else None,
        None if likelihood is None or rival is None else likelihood - rival,
        None if likelihood is None or decoy is None else likelihood - decoy,
    )


def _why(pair: Mapping[str, Any], story: Story) -> str:
    if pair["status"] == "forbidden":
        return "it was told that these do not match"
    if pair["status"] == "ambiguous":
        return "they belong together, in more than one way"
    if pair["status"] == "merged":
        return "walls agree, and nothing else fits as well"
    match lack(pair, story):
        case Lack.WALL:
            return "too little wall in common"
        case Lack.CONFLICTS:
            return "walls of one amid free space of the other"
        case Lack.DIRECTION:
            return "walls in common run nearly all in one direction"
        case Lack.RIVAL:
            return "its mirror image or another place fits about as well"
    return "less probable than asked for"
