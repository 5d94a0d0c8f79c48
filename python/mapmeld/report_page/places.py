"""The places that an ambiguous map may have."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.config import least_probability
from mapmeld.one_place import is_one_place
from mapmeld.report_page.story import Story

_MOST = 6


@dataclass(frozen=True)
class Place:
    """Beside which map, and where: T, x, y, theta in the frame of that map's component."""

    beside: str
    component: int
    T: NDArray[np.float64]
    probability: float


def places(name: str, story: Story) -> list[Place]:
    """Where the hypotheses put a map beside others, the likeliest first; those that are one place, once."""
    found: list[Place] = []
    for h in story.found["hypotheses"]:
        own = next((m for m in h["maps"] if m["name"] == name), None)
        beside = [m for m in h["maps"] if own and m["component"] == own["component"] and m["name"] != name]
        if own is None or not beside:
            continue
        # The others may lie in another frame there: what stays is the place beside one of them.
        first = beside[0]
        T_first_own = se2.compose(
            se2.inverse(np.array(first["T_component_map"])), np.array(own["T_component_map"])
        )
        T = se2.compose(story.pose(first["name"]), T_first_own)
        component = story.found["maps"][story.index[first["name"]]]["component"]
        at = next((k for k, p in enumerate(found) if _is_same(p, component, T, story.centres[name])), None)
        if at is None:
            found.append(Place(first["name"], component, T, h["probability"]))
        else:
            p = found[at]
            found[at] = Place(p.beside, p.component, p.T, p.probability + h["probability"])
    return sorted(found, key=lambda p: -p.probability)


def places_words(name: str, story: Story) -> str:
    """The places as a list, or that only one is likely."""
    found = places(name, story)
    asked = least_probability(story.found["config"], len(story.found["maps"]))
    if not found:
        return "No arrangement that was kept puts it beside another map."
    if len(found) == 1:
        return f"Only one place is likely, {_words(found[0])}, but not likely enough: {asked:g} is asked for."
    more = len(found) - _MOST
    rest = f"; and {more} more" if more > 0 else ""
    return f"{len(found)} places: {'; '.join(_words(p) for p in found[:_MOST])}{rest}."


def _words(p: Place) -> str:
    x, y = (round(float(v), 1) + 0.0 for v in p.T[:2])
    degrees = round(math.degrees(float(p.T[2]))) + 0
    return (
        f"beside {p.beside} at ({x:.1f}, {y:.1f}) m, {degrees} degrees in the frame of component "
        f"{p.component} (probability {p.probability:.2f})"
    )


def _is_same(place: Place, component: int, T: NDArray[np.float64], centre: tuple[float, float]) -> bool:
    return place.component == component and is_one_place(T, place.T, centre)
