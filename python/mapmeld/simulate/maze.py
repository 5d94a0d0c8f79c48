"""The maze world: an arena of 1.2 m panels on a lattice, as robot test arenas have."""

from __future__ import annotations

import numpy as np

from mapmeld.errors import ConfigError
from mapmeld.simulate.floorplan import Floorplan

PANEL = 1.2
"""Length of a panel, side of a lattice cell, in metres."""
DEFAULT_SIZE = (12.0, 15.6)

_EXTEND = 0.55
"""Share of panels that continue an earlier one, which makes corridors and T junctions of single panels."""

Cell = tuple[int, int]
Edge = tuple[Cell, Cell]


def maze(
    rng: np.random.Generator, size: tuple[float, float] | None, density: float, thickness: float
) -> Floorplan:
    """A maze arena with its lower left corner at the world's origin.

    Panels are taken at random from the lattice edges that a random spanning tree of the lattice cells leaves
    over, so every cell stays reachable from every other one, whatever the density.

    size: width and height in metres, rounded to whole panels. Raises ConfigError below two panels a side.
    density: share of those edges that get a panel, 0 to 1.
    """
    width, height = size or DEFAULT_SIZE
    columns, rows = round(width / PANEL), round(height / PANEL)
    if columns < 2 or rows < 2:
        raise ConfigError(f"size: a maze needs at least two panels of {PANEL} m a side, got {size}")
    plan = Floorplan(thickness)
    plan.room(0.0, 0.0, columns * PANEL, rows * PANEL)
    for edge in _panels(rng, _spare_edges(rng, columns, rows), density):
        (x0, y0), (x1, y1) = _posts(edge)
        if x0 == x1:
            plan.wall_y(x0 * PANEL, y0 * PANEL, y1 * PANEL)
        else:
            plan.wall_x(y0 * PANEL, x0 * PANEL, x1 * PANEL)
    return plan


def _spare_edges(rng: np.random.Generator, columns: int, rows: int) -> list[Edge]:
    """The edges between neighbouring cells that a random spanning tree (Kruskal) does not need."""
    edges: list[Edge] = [((c, r), (c + 1, r)) for r in range(rows) for c in range(columns - 1)]
    edges += [((c, r), (c, r + 1)) for r in range(rows - 1) for c in range(columns)]
    parent = {(c, r): (c, r) for r in range(rows) for c in range(columns)}

    def root(cell: Cell) -> Cell:
        while parent[cell] != cell:
            parent[cell] = parent[parent[cell]]
            cell = parent[cell]
        return cell

    spare = []
    for k in rng.permutation(len(edges)):
        a, b = (root(cell) for cell in edges[k])
        if a == b:
            spare.append(edges[k])
        parent[a] = b
    return spare


def _panels(rng: np.random.Generator, spare: list[Edge], density: float) -> list[Edge]:
    """Takes the share `density` of the spare edges, often next to one that is taken already."""
    taken: list[Edge] = []
    posts: set[Cell] = set()
    left = list(spare)
    for _ in range(round(density * len(spare))):
        touching = [k for k, edge in enumerate(left) if not posts.isdisjoint(_posts(edge))]
        if touching and rng.random() < _EXTEND:
            choice = touching[int(rng.integers(len(touching)))]
        else:
            choice = int(rng.integers(len(left)))
        edge = left.pop(choice)
        taken.append(edge)
        posts.update(_posts(edge))
    return taken


def _posts(edge: Edge) -> tuple[Cell, Cell]:
    """The two lattice points between which the panel on the edge between two cells stands."""
    (c0, r0), (c1, _) = edge
    if c1 > c0:
        return (c1, r0), (c1, r0 + 1)
    return (c0, r0 + 1), (c0 + 1, r0 + 1)
