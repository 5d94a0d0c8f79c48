"""The alternative hypotheses: each as a small picture, and what differs from the first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.one_place import ONE_PLACE
from mapmeld.report_page.story import Story
from mapmeld.report_page.views import Box, placed

_MOST_NAMES = 8


@dataclass(frozen=True)
class Shape:
    """A map in the picture: its index, SVG's transform, and whether it lies elsewhere than in the first."""

    index: int
    transform: str
    moved: bool


@dataclass(frozen=True)
class HypothesisPicture:
    """rank: from 1. shapes: empty where nothing is merged. box: what is seen. difference: from the first, in
    words."""

    rank: int
    probability: float
    shapes: list[Shape]
    box: Box
    difference: str


def hypothesis_pictures(story: Story) -> list[HypothesisPicture]:
    """In the order of the result: the most probable first."""
    found = story.found["hypotheses"]
    boxes = {name: corners(grid) for name, grid in story.grids.items()}
    return [_draw(k, h, found[0], boxes, story) for k, h in enumerate(found)]


def _draw(
    k: int,
    hypothesis: Mapping[str, Any],
    first: Mapping[str, Any],
    boxes: Mapping[str, NDArray[np.float64]],
    story: Story,
) -> HypothesisPicture:
    changed = {} if k == 0 else changes(first, hypothesis, story)
    components: dict[int, list[Mapping[str, Any]]] = {}
    for m in hypothesis["maps"]:
        components.setdefault(m["component"], []).append(m)
    shapes = []
    left, top = 0.0, 0.0
    for members in sorted((c for c in components.values() if len(c) > 1), key=len, reverse=True):
        points = np.concatenate([se2.apply(m["T_component_map"], boxes[m["name"]]) for m in members])
        low, high = points.min(axis=0), points.max(axis=0)
        shift = np.array([left - low[0], -low[1], 0.0])
        for m in members:
            # Beside each other, each in its own frame: only x and y are moved.
            T = np.array(m["T_component_map"]) + shift
            grid = story.grids[m["name"]]
            shapes.append(Shape(story.index[m["name"]], placed(T, grid.origin), m["name"] in changed))
        left += float(high[0] - low[0]) * 1.06 + 1.0
        top = max(top, float(high[1] - low[1]))
    box = (0.0, 0.0, max(left, 1.0), max(top, 1.0))
    return HypothesisPicture(k + 1, hypothesis["probability"], shapes, box, _words(k, changed, components))


def _words(k: int, changed: Mapping[str, str], components: Mapping[int, list[Mapping[str, Any]]]) -> str:
    if k == 0:
        parts = [str(len(c)) for c in components.values() if len(c) > 1]
        return f"merges {' and '.join(parts)} maps" if parts else "every map alone"
    if not changed:
        return "the same places, within what counts as one"
    by_kind: dict[str, list[str]] = {}
    for name, what in changed.items():
        by_kind.setdefault(what, []).append(name)
    return "; ".join(f"{what}: {_listed(names)}" for what, names in by_kind.items())


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def changes(first: Mapping[str, Any], other: Mapping[str, Any], story: Story) -> dict[str, str]:
    """Maps that lie otherwise than in the first hypothesis, and how.

    Of each component of the first, the most that still lie so to each other have stayed; the rest has moved.
    """
    a, b = ({m["name"]: m for m in h["maps"]} for h in (first, other))
    names = [name for name in a if name in b]
    out = {name: "not placed" for name in a if name not in b}
    out |= {name: "placed" for name in b if name not in a}
    if not names:
        return out
    of_a, of_b = (np.array([h[n]["component"] for n in names]) for h in (a, b))
    kept = _is_same(names, a, b, story) & np.equal.outer(of_a, of_a) & np.equal.outer(of_b, of_b)
    for component in dict.fromkeys(of_a.tolist()):
        members = np.flatnonzero(of_a == component)
        stays = members[kept[np.ix_(members, members)].sum(axis=1).argmax()]
        for i in members:
            if kept[stays, i] and (len(members) > 1 or (of_b == of_b[i]).sum() == 1):
                continue
            beside = [k for k in np.flatnonzero(of_b == of_b[i]) if k != i]
            if of_b[i] == of_b[stays] and i != stays:
                out[names[i]] = "elsewhere"
            else:
                out[names[i]] = f"with {names[beside[0]]}" if beside else "alone"
    return out


def _is_same(names: list[str], a: Mapping[str, Any], b: Mapping[str, Any], story: Story) -> NDArray[np.bool_]:
    """Whether map j lies in one place, seen from map i, by both."""
    seen = []
    for h in (a, b):
        T = np.array([h[n]["T_component_map"] for n in names])
        middle = np.array([se2.apply(t, np.array(story.centres[n])) for t, n in zip(T, names, strict=True)])
        away = middle[None] - T[:, None, :2]
        c, s = np.cos(T[:, 2])[:, None], np.sin(T[:, 2])[:, None]
        local = np.stack([c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]], axis=-1)
        seen.append((local, T[None, :, 2] - T[:, None, 2]))
    (at_a, angle_a), (at_b, angle_b) = seen
    turn = np.abs((angle_a - angle_b + np.pi) % (2 * np.pi) - np.pi)
    return np.asarray((np.linalg.norm(at_a - at_b, axis=-1) <= ONE_PLACE[0]) & (turn <= ONE_PLACE[1]))


def corners(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Of the box around a map's known cells, map coordinates."""
    known = grid.data >= 0
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if rows.size == 0:
        return np.zeros((1, 2))
    x, y = (cols[0], cols[-1] + 1), (rows[0], rows[-1] + 1)
    corners = np.array([(i, j) for i in x for j in y]) * grid.resolution
    return se2.apply(grid.origin, corners)
