"""What holds a component together: the strongest link of each map, and the weakest of them all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mapmeld import se2
from mapmeld.one_place import is_one_place
from mapmeld.report_page.story import Story

SURE = 0.99
"""Probability of a pair alone below which a link counts as doubtful."""
_MOST_NAMES = 8


@dataclass(frozen=True)
class Link:
    """Two maps that lie as their walls alone fit best. probability: that this fit is right, 0..1."""

    a: str
    b: str
    probability: float

    def other(self, name: str) -> str:
        """The other one of the two."""
        return self.b if name == self.a else self.a


@dataclass(frozen=True)
class Bond:
    """How a component of several maps hangs together.

    strongest: the strongest link of each map that has one. weakest: of the links without which it would
    fall apart, None where it would fall apart anyway: no pair alone puts its parts where they lie. others:
    the probability that the rest of these links reach at least, None where there is no other. parts: what
    it falls into, the smaller part last.
    """

    component: int
    strongest: Mapping[str, Link]
    weakest: Link | None
    others: float | None
    parts: tuple[Sequence[str], Sequence[str]]

    @property
    def is_doubtful(self) -> bool:
        """Whether something hangs by less than a sure link."""
        return self.weakest is None or self.weakest.probability < SURE


def bonds(story: Story) -> list[Bond]:
    """Of every component of several maps."""
    links: dict[int, list[Link]] = {}
    for p in story.found["pairs"]:
        number = _told_by(p, story)
        if number is not None:
            links.setdefault(number, []).append(Link(p["a"], p["b"], p["probability"]))
    parts = enumerate(story.found["components"])
    return [bond(k, c["order"], links.get(k, [])) for k, c in parts if len(c["order"]) > 1]


def bond(number: int, names: Sequence[str], links: Sequence[Link]) -> Bond:
    """From all links among the maps of a component.

    Those that hold it are the maximum spanning tree: each cut is held by its strongest link, and the weakest
    link of the tree is the strongest one of the weakest cut.
    """
    links = sorted(links, key=lambda link: (-link.probability, link.a, link.b))
    strongest: dict[str, Link] = {}
    for link in links:
        strongest.setdefault(link.a, link)
        strongest.setdefault(link.b, link)
    part = {name: k for k, name in enumerate(names)}
    tree: list[Link] = []
    parts = _split(names, part)
    for link in links:
        a, b = part[link.a], part[link.b]
        if a == b:
            continue
        tree.append(link)
        parts = _split(names, part)
        part = {name: a if k == b else k for name, k in part.items()}
    if len(tree) < len(names) - 1:
        # Of three parts and more, the rest does not hang together either.
        is_in_two = tree and len(tree) == len(names) - 2
        others = tree[-1].probability if is_in_two else None
        return Bond(number, strongest, None, others, _split(names, part))
    others = tree[-2].probability if len(tree) > 1 else None
    return Bond(number, strongest, tree[-1], others, parts)


def bond_words(bond: Bond) -> str:
    """The weakest link in a sentence."""
    large, small = bond.parts
    more = len(small) - _MOST_NAMES
    named = f" ({', '.join(small[:_MOST_NAMES])}{f' and {more} more' if more > 0 else ''})"
    maps = "map" if len(small) == 1 else "maps"
    # Rounded down: it is a least value.
    least = "" if bond.others is None else f"pairs of {math.floor(1000 * bond.others) / 1000:.3f} or more"
    if bond.weakest is None:
        rest = f" All else hangs together by {least}." if least else ""
        return (
            f"No link of two maps alone holds {len(small)} {maps}{named} beside the other {len(large)}: "
            "what does is several pairs together, a fit that is not their best one, or what was known "
            f"before. Look there first.{rest}"
        )
    text = f"{bond.weakest.a} with {bond.weakest.b}, {bond.weakest.probability:.3f} alone"
    if bond.others is None:
        return f"The only link: {text}."
    return (
        f"The weakest link: {text}; all else hangs together by {least}. Without it the "
        f"component falls into {len(large)} and {len(small)} {maps}{named}."
    )


def link_words(name: str, bond: Bond) -> str:
    """What connects a map to the rest: its strongest link; and the weakest one where it is an end of that."""
    link = bond.strongest.get(name)
    if link is None:
        return "no pair alone"
    text = f"{link.other(name)}, {link.probability:.3f}"
    if bond.weakest is None or bond.others is None or name not in (bond.weakest.a, bond.weakest.b):
        return text
    if bond.weakest == link:
        return f"{text}: the weakest link"
    return f"{text}; the weakest link: {bond.weakest.other(name)}, {bond.weakest.probability:.3f}"


def is_as_placed(pair: Mapping[str, Any], story: Story) -> bool:
    """Whether two maps of one component lie as their best mode has them."""
    return _told_by(pair, story) is not None


def _told_by(pair: Mapping[str, Any], story: Story) -> int | None:
    """The component in which two maps lie as their best mode has them."""
    a, b = (story.found["maps"][story.index[pair[key]]] for key in "ab")
    if pair["T_a_b"] is None or pair["status"] == "forbidden" or a["component"] != b["component"]:
        return None
    T_a_b = se2.compose(se2.inverse(np.array(a["T_component_map"])), np.array(b["T_component_map"]))
    same = is_one_place(T_a_b, np.array(pair["T_a_b"]), story.centres[pair["b"]])
    return int(a["component"]) if same else None


def _split(names: Sequence[str], part: Mapping[str, int]) -> tuple[list[str], list[str]]:
    """The smallest part, and all others before it: before the last link that is the whole cut."""
    members: dict[int, list[str]] = {}
    for name in names:
        members.setdefault(part[name], []).append(name)
    small = min(reversed(members.values()), key=len)
    return [name for name in names if name not in set(small)], small
