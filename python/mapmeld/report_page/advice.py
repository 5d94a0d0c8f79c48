"""What would help a map that was left out, as far as that can be said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.reasons import Lack
from mapmeld.report_page.pairs import lack
from mapmeld.report_page.raster import OCCUPIED_FROM
from mapmeld.report_page.story import Story

_TRUSTED = 0.2
"""Probability from which the place of a best mode is worth naming."""
_NEAR_M = 0.25
_FREE_M = 0.3
"""Standard deviation of a pose, metres, from which a direction counts as held by nothing."""
_ELSEWHERE = (
    "Nothing says where it meets the others. Drive it, or one of them, through ground that both then show, "
    "until a quarter of its walls, in two directions, are in the other's map."
)


def advice(placed: Mapping[str, Any], story: Story) -> str:
    """What would help; placed: the map as result.json has it."""
    name, status = placed["name"], placed["status"]
    if status == "blank":
        return "Check the topic and the thresholds of its yaml; if the robot had not driven yet, drive it."
    if status == "ambiguous":
        return (
            "Drive it on to where its places would look different, or give a further map that overlaps both. "
            "Where it is known from where it started, say so (a prior or a pin) instead."
        )
    forbidden = [p for p in story.found["pairs"] if name in (p["a"], p["b"]) and p["status"] == "forbidden"]
    if forbidden:
        others = ", ".join(_other(p, name) for p in forbidden)
        return (
            f"It was told not to match {others}, and nothing puts it where their walls match best, not by "
            "way of other maps either. Merge without that to see where it would lie."
        )
    own = [p for p in story.found["pairs"] if name in (p["a"], p["b"]) and p["T_a_b"] is not None]
    if not own:
        return _ELSEWHERE
    best = max(own, key=lambda p: p["probability"])
    if best["probability"] < _TRUSTED:
        return f"{_closest(best, name)} That place is more likely wrong than right. {_ELSEWHERE}"
    where = _where(best, name, story)
    other = _other(best, name)
    if best["status"] == "merged":
        return (
            f"{_closest(best, name)} These two alone would merge; with the maps that {other} lies with, it "
            "does not fit well enough. Look at the two alone (a merge of just them), and drive it once more "
            f"through ground that {other} and another map show."
        )
    match lack(best, story):
        case Lack.DIRECTION:
            hint = (
                f"Drive either of them on{where} until both show walls that run across: a crossing, a door "
                "or the end of the corridor."
            )
        case Lack.CONFLICTS:
            hint = (
                "Either the building changed between the two, or that place is wrong. Drive it once more "
                f"where it would meet {other}{where}."
            )
        case Lack.RIVAL:
            hint = f"Drive it on from what both show{where}, past the part that looks like another one."
        case _:
            hint = f"Drive it, or {other}, on from what both show{where}."
    return f"{_closest(best, name)}{_loose(best, name)} {hint}"


def _closest(pair: Mapping[str, Any], name: str) -> str:
    return f"As it fits best, it shares {pair['shared_length']:.1f} m of wall with {_other(pair, name)}."


def _loose(pair: Mapping[str, Any], name: str) -> str:
    """The direction along which nothing holds the best mode, in the frame of its first map."""
    covariance = np.array(pair["covariance"], dtype=np.float64)[:2, :2]
    variances, axes = np.linalg.eigh(covariance)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    if deviations[1] < _FREE_M or deviations[1] < 3 * deviations[0]:
        return ""
    degrees = math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180
    frame = "its own frame" if pair["a"] == name else f"the frame of {pair['a']}"
    return (
        f" Along {degrees:.0f} degrees of {frame} little holds it (standard deviation {deviations[1]:.1f} m)."
    )


def _where(pair: Mapping[str, Any], name: str, story: Story) -> str:
    """Around which point of the map's frame the walls lie that both would show."""
    T = np.array(pair["T_a_b"])
    if pair["a"] == name:
        own, other, T_own_other = story.grids[pair["a"]], story.grids[pair["b"]], T
    else:
        own, other, T_own_other = story.grids[pair["b"]], story.grids[pair["a"]], se2.inverse(T)
    points = _walls(own)
    theirs = se2.apply(T_own_other, _walls(other))
    cells = np.floor(theirs / _NEAR_M).astype(np.int64)
    steps = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    near = np.unique(_keys((cells[:, None] + steps[None]).reshape(-1, 2)))
    common = points[np.isin(_keys(np.floor(points / _NEAR_M).astype(np.int64)), near)]
    if len(common) == 0:
        return ""
    x, y = np.median(common, axis=0)
    return f", around ({x:.1f}, {y:.1f}) m of its own frame"


def _walls(grid: OccupancyGrid) -> np.ndarray[Any, np.dtype[np.float64]]:
    rows, cols = np.nonzero(grid.data >= OCCUPIED_FROM)
    return np.asarray(grid.cell_centers(rows, cols))


def _keys(cells: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """One number a cell."""
    return np.asarray((cells[:, 0] << 32) + cells[:, 1])


def _other(pair: Mapping[str, Any], name: str) -> str:
    return str(pair["b"] if pair["a"] == name else pair["a"])
