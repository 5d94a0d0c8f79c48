"""Where the robots start and how they drive: goals at random, paths planned, poses at every scan."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.simulate.free_space import FreeSpace

_SPREAD = 1.0
"""Sum of the areas of all regions over the free area, where the region radius is derived."""
_LEAST_RADIUS = 1.5
_NEAREST, _FARTHEST = 1.2, 2.0
"""Distance of a start from the nearest earlier one, in region radii."""
_CANDIDATES = 5
"""Random places from which the one farthest from what is visited is taken."""


def default_region_radius(space: FreeSpace, robots: int) -> float:
    """The radius in metres for which regions overlap in part, for that many robots."""
    return max(_LEAST_RADIUS, math.sqrt(_SPREAD * space.area / (math.pi * robots)))


def default_path_length(radius: float) -> float:
    """The way in metres that shows a robot most of a region of that radius."""
    return 9.0 * radius


def choose_homes(space: FreeSpace, robots: int, radius: float, rng: np.random.Generator) -> list[int]:
    """The nodes the robots start from: each within reach of an earlier one, but not next to any.

    A team spreads out from where it began: every region overlaps one more, and pairs far apart have nothing
    in common. Once the world is full, the others start wherever there is most room.
    """
    nodes = np.flatnonzero(space.passable)
    homes = [int(rng.choice(nodes))]
    nearest = np.full(space.passable.size, np.inf)
    while len(homes) < robots:
        nearest = np.minimum(nearest, space.distances(homes[-1], _FARTHEST * radius).ravel())
        band = np.flatnonzero(np.isfinite(nearest) & (nearest >= _NEAREST * radius))
        if len(band):
            homes.append(int(rng.choice(band)))
        else:
            candidates = rng.choice(nodes, _CANDIDATES)
            homes.append(_most_remote(space, candidates, space.points(np.array(homes))))
    return homes


def drive(
    space: FreeSpace,
    home: int,
    radius: float,
    length: float,
    spacing: float,
    turn: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Poses at every scan, shape (n, 3), T_world_robot as (x, y, theta), theta unwrapped.

    The robot turns on the spot, then drives straight, and so on from goal to goal in its region.

    radius: of the region around the node `home`, along free paths, metres.
    length: how far it drives, metres. spacing, turn: largest step between poses, metres and radians.

    Raises MapmeldError if the region has no other node to drive to.
    """
    region = np.flatnonzero(np.isfinite(space.distances(home, radius)))
    if len(region) < 2:
        raise MapmeldError("the world has no room to drive in; lower robot_radius or raise region_radius")
    node = home
    x, y = space.points(np.array([node]))[0]
    poses = [np.array([[x, y, rng.uniform(-math.pi, math.pi)]])]
    driven = 0.0
    while driven < length:
        visited = np.concatenate(poses)[:, :2]
        goal = _most_remote(space, rng.choice(region, _CANDIDATES), visited)
        if goal == node:
            continue
        route = space.straightened(space.shortest_path(node, goal))
        for point in space.points(np.array(route))[1:]:
            leg = _leg(poses[-1][-1], point, length - driven, spacing, turn)
            driven += float(np.hypot(*(leg[-1, :2] - poses[-1][-1, :2])))
            poses.append(leg)
            if driven >= length - 1e-9:
                return np.concatenate(poses)
        node = goal
    return np.concatenate(poses)


def _leg(
    pose: NDArray[np.float64], point: NDArray[np.float64], budget: float, spacing: float, turn: float
) -> NDArray[np.float64]:
    """Poses of a turn towards a point and the drive there, at most `budget` metres; without the first."""
    delta = point - pose[:2]
    distance = float(np.hypot(*delta))
    angle = se2.wrap(math.atan2(delta[1], delta[0]) - pose[2])
    turns = max(1, math.ceil(abs(angle) / turn - 1e-9))
    headings = pose[2] + angle * np.arange(1, turns + 1) / turns
    turning = np.column_stack([np.tile(pose[:2], (turns, 1)), headings])
    share = min(1.0, budget / distance)
    steps = max(1, math.ceil(share * distance / spacing - 1e-9))
    along = pose[:2] + share * delta * (np.arange(1, steps + 1) / steps)[:, None]
    return np.concatenate([turning, np.column_stack([along, np.full(steps, headings[-1])])])


def _most_remote(space: FreeSpace, nodes: NDArray[np.intp], points: NDArray[np.float64]) -> int:
    """The one of the nodes whose nearest of the points is farthest away."""
    gap = space.points(nodes)[:, None, :] - points[None, :, :]
    return int(nodes[int(np.argmax(np.hypot(gap[..., 0], gap[..., 1]).min(axis=1)))])
