"""Where a robot's centre can be: a coarse lattice over the world, with distances and shortest paths."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.grid import FREE, OccupancyGrid
from mapmeld.simulate.raster import dilate

_SPACING = 0.1
"""Spacing of the lattice in metres (a finer one where the world's cells are coarser)."""
_SQRT2 = math.sqrt(2.0)
_NEAR_WALL_COST = 3.0
"""Cost of a lattice step close to a wall; keeps paths in the middle of corridors."""


class FreeSpace:
    """The passable nodes of a lattice. Nodes are flat indices into it; its border is never passable.

    passable: shape (height, width), bool: the largest connected part of the nodes that keep robot_radius from
        everything that is not known to be free.

    Raises MapmeldError for a world without such a node.
    """

    def __init__(self, world: OccupancyGrid, robot_radius: float) -> None:
        stride = max(1, round(_SPACING / world.resolution))
        blocked = np.pad(world.data != FREE, 1, constant_values=True)
        radius = math.ceil(robot_radius / world.resolution)
        blocked = dilate(blocked, radius)
        near_wall = dilate(blocked, math.ceil(robot_radius / world.resolution))
        # Node (r, c) stands for the world cell (r * stride, c * stride) - 1 of the unpadded grid.
        passable = ~blocked[::stride, ::stride]
        passable[[0, -1], :] = False
        passable[:, [0, -1]] = False
        self.spacing = stride * world.resolution
        self._origin = world.origin
        self._first = -0.5 * world.resolution
        self.shape = passable.shape
        self.passable = _largest_part(passable)
        if not self.passable.any():
            raise MapmeldError(
                f"world {world.name!r}: no free cell is {robot_radius} m from all walls; lower robot_radius"
            )
        near = near_wall[::stride, ::stride]
        cost = np.where(near, _NEAR_WALL_COST, 1.0)
        cost[~self.passable] = math.inf
        self._cost = [float(v) for v in cost.ravel()]

    @property
    def area(self) -> float:
        """Area of the passable nodes in square metres."""
        return float(self.passable.sum()) * self.spacing**2

    def points(self, nodes: NDArray[np.intp]) -> NDArray[np.float64]:
        """World coordinates in metres, shape (n, 2), of nodes."""
        rows, cols = np.divmod(nodes, self.shape[1])
        local = self._first + self.spacing * np.stack([cols, rows], axis=-1)
        return se2.apply(self._origin, local)

    def distances(self, start: int, limit: float) -> NDArray[np.float64]:
        """Length in metres of the way from a node to every node, shape of `passable`, inf beyond the limit.

        Wavefronts that go straight and diagonally in turn: octagons, within about 10 % of the true length.
        """
        return _wavefronts(self.passable, start, limit / self.spacing) * self.spacing

    def shortest_path(self, start: int, goal: int) -> list[int]:
        """Nodes from start to goal, both included, on the cheapest way (A*). Both must be passable."""
        width, cost = self.shape[1], self._cost
        steps = [(d, 1.0) for d in (-width, -1, 1, width)]
        steps += [(d, _SQRT2) for d in (-width - 1, -width + 1, width - 1, width + 1)]
        goal_row, goal_col = divmod(goal, width)
        spent = {start: 0.0}
        parent = {start: start}
        done: set[int] = set()
        queue = [(0.0, start)]
        while queue:
            _, node = heapq.heappop(queue)
            if node == goal:
                break
            if node in done:
                continue
            done.add(node)
            base = spent[node]
            for offset, length in steps:
                other = node + offset
                total = base + length * cost[other]
                if total < spent.get(other, math.inf):
                    spent[other], parent[other] = total, node
                    row, col = divmod(other, width)
                    dr, dc = abs(row - goal_row), abs(col - goal_col)
                    rest = max(dr, dc) + (_SQRT2 - 1.0) * min(dr, dc)
                    heapq.heappush(queue, (total + rest, other))
        path = [goal]
        while path[-1] != start:
            path.append(parent[path[-1]])
        return path[::-1]

    def straightened(self, path: list[int]) -> list[int]:
        """The nodes of a path that remain when every way that is clear in a straight line goes straight."""
        kept, at = [path[0]], 0
        while at < len(path) - 1:
            ahead = len(path) - 1
            while ahead > at + 1 and not self._clear(path[at], path[ahead]):
                ahead -= max(1, (ahead - at) // 8)
            at = max(ahead, at + 1)
            kept.append(path[at])
        return kept

    def _clear(self, a: int, b: int) -> bool:
        (r0, c0), (r1, c1) = divmod(a, self.shape[1]), divmod(b, self.shape[1])
        count = 2 * max(abs(r1 - r0), abs(c1 - c0)) + 1
        rows = np.rint(np.linspace(r0, r1, count)).astype(np.intp)
        cols = np.rint(np.linspace(c0, c1, count)).astype(np.intp)
        return bool(self.passable[rows, cols].all())


def _wavefronts(passable: NDArray[np.bool_], start: int, limit: float) -> NDArray[np.float64]:
    """Distance in lattice steps from the node `start`, inf where there is no way or beyond the limit."""
    width = passable.shape[1]
    straight = np.array([-width, -1, 1, width])
    around = np.concatenate([straight, [-width - 1, -width + 1, width - 1, width + 1]])
    distance = np.full(passable.size, np.inf)
    open_nodes = passable.ravel().copy()
    front = np.array([start], dtype=np.intp)
    distance[start], open_nodes[start] = 0.0, False
    step = 0
    while len(front) and step < limit:
        step += 1
        diagonal = step % 2 == 1
        neighbours = (front[:, None] + (around if diagonal else straight)[None, :]).ravel()
        reached = np.unique(neighbours[open_nodes[neighbours]])
        distance[reached], open_nodes[reached] = step, False
        # After a straight step the old front stays: some of its diagonal neighbours may have no other way.
        front = reached if diagonal else np.concatenate([front, reached])
    return distance.reshape(passable.shape)


def _largest_part(passable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected part."""
    left = passable.copy()
    best = np.zeros_like(passable)
    size = 0
    while int(left.sum()) > size:
        part = np.isfinite(_wavefronts(left, int(np.argmax(left)), math.inf))
        if int(part.sum()) > size:
            best, size = part, int(part.sum())
        left &= ~part
    return best
