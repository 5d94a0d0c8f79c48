"""Covariances of a merge, told in the frames that are held."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapmeld.frames import Held
from mapmeld.result import MergeResult, PlacedMap


def covariances_in_frames(
    result: MergeResult, held: Sequence[Held], before: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Covariances relative to the anchors of what is held, in the world of priors as they are;
    along the axes of the frames.

    The merge tells them relative to its components' references and along the axes of these. Of a robot
    that is
    held where the merge has it apart from the anchor, the last that was told stands.
    """
    placed = {m.name: m for m in result.maps}
    told: dict[str, NDArray[np.float64]] = {}
    for h in held:
        anchor = placed[h.anchor].component
        for name in h.poses:
            component = result.components[placed[name].component]
            if not component.in_world and name == h.anchor:
                covariance = np.zeros((3, 3))
            elif component.in_world:
                covariance = np.array(placed[name].covariance)
            elif placed[name].component == anchor:
                relative = _relative(placed[h.anchor], placed[name])
                covariance = _turned(relative, _turn(h, placed[name]))
            elif name not in before:
                covariance = _turned(np.array(placed[name].covariance), _turn(h, placed[name]))
            else:
                covariance = np.array(before[name])
            covariance.setflags(write=False)
            told[name] = covariance
    return told


def _relative(anchor: PlacedMap, placed: PlacedMap) -> NDArray[np.float64]:
    """Covariance relative to the anchor, along the axes of the component; what is known of the errors of two
    maps to the component's reference is taken to be independent."""
    assert anchor.T_component_map is not None
    assert placed.T_component_map is not None
    x, y, _ = placed.T_component_map - anchor.T_component_map
    lever = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
    return np.asarray(placed.covariance + lever @ anchor.covariance @ lever.T)


def _turn(held: Held, placed: PlacedMap) -> float:
    """The angle from the axes of a merge's component to those of the frame in which its map is held."""
    assert placed.T_component_map is not None
    return float(held.poses[placed.name][2] - placed.T_component_map[2])


def _turned(covariance: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)
