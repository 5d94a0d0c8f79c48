"""The large picture of a component, as layers that lie over each other in metres."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.palette import map_colour
from mapmeld.report_page import raster
from mapmeld.report_page.contest import AMID, DEEP, contest, near_to
from mapmeld.report_page.raster import Picture
from mapmeld.report_page.story import Layers, Story

_LARGE, _SMALL = 2000, 900
"""Most pixels a side of the first component's pictures, and of the others'."""
_COLOURS = 20
"""Colours of maps before they come again."""
_FAR = 0.25
"""An origin farther outside its component than this share of the component's size is not walked to."""
_WALL, _FLOOR = (38, 42, 48, 255), (255, 255, 255, 255)
STRENGTHS = [(240, 190, 60, 150), (226, 120, 0, 220), (214, 20, 40, 240)]
"""Red, green, blue and opacity of conflicts, by strength, from 1."""
_FEW_CONFLICTS = 0.02
"""Share of the walls up to which the strongest conflicts are drawn with their neighbours, to be seen."""
NINETY_FIVE_PERCENT = math.sqrt(5.991)
"""Standard deviations at which an ellipse holds 95 of 100, in two dimensions."""

Box = tuple[float, float, float, float]
"""Left, bottom, width, height, metres."""


@dataclass(frozen=True)
class Ellipse:
    """Half axes in metres, the first along `degrees`: 95 % of where the point may lie."""

    x: float
    y: float
    a: float
    b: float
    degrees: float


@dataclass(frozen=True)
class Member:
    """A map in its place. x, y: where its number stands: the origin of its local frame, or the middle of what
    it shows where that lies far out. ellipse: of that point, None for the map that lends its frame."""

    index: int
    name: str
    colour: str
    transform: str
    x: float
    y: float
    is_far: bool
    ellipse: Ellipse | None


@dataclass(frozen=True)
class View:
    """A component of several maps.

    strength: of the conflict in each cell of the merged map, as in Contest; STRENGTHS are the colours of 1, 2
    and 3. deep_cells, amid_cells: how many lie so. contradicting: share of each map's walls that
    lie amid the free floor of another, 0..1. box: what is seen. low: the pictures' lower left corner. size:
    of a number, metres. legs: of the virtual robot's way, in the order of the merge.
    """

    number: int
    members: list[Member]
    box: Box
    low: tuple[float, float]
    size: float
    resolution: float
    floor: Picture
    walls: Picture
    provenance: Picture
    conflicts: Picture
    strength: NDArray[np.uint8]
    deep_cells: int
    amid_cells: int
    contradicting: Mapping[str, float]
    legs: list[tuple[tuple[float, float], tuple[float, float]]]
    facts: Mapping[str, Any]


def views(story: Story) -> list[View]:
    """A view of every component of several maps, the largest first."""
    parts = enumerate(zip(story.found["components"], story.layers, strict=True))
    return [
        _view(k, c, layers, story)
        for k, (c, layers) in parts
        if layers is not None and (len(c["order"]) > 1 or len(story.found["components"]) == 1)
    ]


def _view(k: int, component: Mapping[str, Any], layers: Layers, story: Story) -> View:
    merged = layers.merged
    most = _LARGE if k == 0 else _SMALL
    x, y, _ = merged.origin
    width, height = merged.width * merged.resolution, merged.height * merged.resolution
    size = max(width, height)
    members = [_member(name, component, (x, y, width, height), story) for name in component["order"]]
    # A picture's last pixels may reach past the grid; numbers at the edge need room.
    pad = 0.04 * size
    left = min([x, *(m.x for m in members)]) - pad
    bottom = min([y, *(m.y for m in members)]) - pad
    right = max([x + width, *(m.x for m in members)]) + pad
    top = max([y + height, *(m.y for m in members)]) + pad

    cells, pixel = raster.classes(merged, most)
    clear = raster.CLEAR
    found = contest(layers, component["order"], story)
    return View(
        number=k,
        members=members,
        box=(left, bottom, right - left, top - bottom),
        low=(float(x), float(y)),
        size=0.011 * max(right - left, top - bottom),
        resolution=merged.resolution,
        floor=raster.picture((cells > 0).astype(np.uint8), pixel, [clear, _FLOOR]),
        walls=raster.picture((cells == 2).astype(np.uint8), pixel, [clear, _WALL]),
        provenance=_provenance(layers, component["order"], story, most, pixel),
        conflicts=_conflicts(layers, found.strength, most, pixel),
        strength=found.strength,
        deep_cells=int((found.strength == DEEP).sum()),
        amid_cells=int((found.strength == AMID).sum()),
        contradicting=found.shares,
        legs=[((a.x, a.y), (b.x, b.y)) for a, b in pairwise(members)],
        facts=component,
    )


def _provenance(layers: Layers, order: Sequence[str], story: Story, most: int, pixel: float) -> Picture:
    """Each known cell in the colour of the map that it is from: floor faint, walls full."""
    colour_of = np.array([0, *(1 + story.index[name] % _COLOURS for name in order)], dtype=np.uint8)
    cells = colour_of[layers.provenance + 1]
    cells[(layers.merged.data >= raster.OCCUPIED_FROM) & (cells > 0)] += _COLOURS
    colours = [map_colour(i) for i in range(_COLOURS)]
    floors = [raster.colour_bytes(c, 0.35) for c in colours]
    palette = [raster.CLEAR, *floors, *(raster.colour_bytes(c) for c in colours)]
    return raster.picture(raster.shrunk(cells, most), pixel, palette)


def _conflicts(layers: Layers, strength: NDArray[np.uint8], most: int, pixel: float) -> Picture:
    """Single cells would not be seen, so the strongest take their neighbours. Where these are many they are
    seen without, and would hide all walls so."""
    cells, amid = strength.copy(), strength == AMID
    if amid.sum() <= _FEW_CONFLICTS * (layers.merged.data >= raster.OCCUPIED_FROM).sum():
        cells[near_to(amid, 1)] = AMID
    return raster.picture(raster.shrunk(cells, most), pixel, [raster.CLEAR, *STRENGTHS])


def _member(name: str, component: Mapping[str, Any], box: Box, story: Story) -> Member:
    index = story.index[name]
    T = story.pose(name)
    x, y, width, height = box
    reach = _FAR * max(width, height)
    is_far = not (x - reach <= T[0] <= x + width + reach and y - reach <= T[1] <= y + height + reach)
    point = np.array(story.centres[name] if is_far else (0.0, 0.0))
    px, py = se2.apply(T, point)
    lends = name == component["reference"]
    ellipse = None if lends else _ellipse(T, point, story.found["maps"][index]["covariance"])
    return Member(
        index, name, css_colour(index), placed(T, story.grids[name].origin), px, py, is_far, ellipse
    )


def _ellipse(T: NDArray[np.float64], point: NDArray[np.float64], covariance: Any) -> Ellipse:
    """Where a point of a map may lie: the map turns about its origin, so points far from it are less sure."""
    C = np.array(covariance, dtype=np.float64)
    c, s = math.cos(T[2]), math.sin(T[2])
    J = np.array([[1.0, 0.0, -s * point[0] - c * point[1]], [0.0, 1.0, c * point[0] - s * point[1]]])
    variances, axes = np.linalg.eigh(J @ C @ J.T)
    b, a = (NINETY_FIVE_PERCENT * math.sqrt(max(v, 0.0)) for v in variances.tolist())
    x, y = se2.apply(T, point)
    return Ellipse(float(x), float(y), a, b, math.degrees(math.atan2(axes[1, 1], axes[0, 1])))


def placed(T: NDArray[np.float64], origin: Sequence[float]) -> str:
    """SVG's transform of a map's picture, whose lower left corner is the grid's, into the frame of T."""
    x, y, theta = se2.compose(T, origin).tolist()
    c, s = math.cos(theta), math.sin(theta)
    return f"matrix({c:.6f} {s:.6f} {-s:.6f} {c:.6f} {x:.4f} {y:.4f})"


def css_colour(index: int) -> str:
    """The colour of a map."""
    r, g, b, _ = raster.colour_bytes(map_colour(index))
    return f"#{r:02x}{g:02x}{b:02x}"
