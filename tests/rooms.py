"""Small maps that tests can merge in a blink: views of one building, drawn in frames of their own."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from unittest import mock

import numpy as np

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.map_io import write_map

RESOLUTION = 0.1

# Walls as (x0, y0, x1, y1) in metres: rooms of different sizes, so that only the true placement fits.
WALLS = [
    (0, 0, 14, 0.2),
    (0, 8, 14.2, 8.2),
    (0, 0, 0.2, 8),
    (14, 0, 14.2, 8),
    (4, 0, 4.2, 3),
    (4, 4, 4.2, 8),
    (0, 5, 2.5, 5.2),
    (7, 2, 10, 2.2),
    (9.8, 2, 10, 6),
    (11.5, 5.8, 14, 6),
    (6, 6.5, 6.2, 8),
    (12, 0, 12.2, 1.5),
]


def view(
    name: str, x_range: tuple[float, float], T_world_map: Sequence[float], resolution: float = RESOLUTION
) -> OccupancyGrid:
    """What a robot that saw the building between two x knows of it, in its own frame."""
    x0, x1 = x_range
    corners = np.array([(x0, -0.2), (x1, -0.2), (x1, 8.4), (x0, 8.4)])
    seen = se2.apply(se2.inverse(T_world_map), corners)
    low = np.floor(seen.min(axis=0) / resolution) * resolution
    width, height = np.ceil((seen.max(axis=0) - low) / resolution).astype(int)
    cols, rows = np.meshgrid(np.arange(width), np.arange(height))
    points = low + (np.stack([cols, rows], axis=-1) + 0.5) * resolution
    world = se2.apply(T_world_map, points)
    x, y = world[..., 0], world[..., 1]
    data = np.full((height, width), -1, dtype=np.int8)
    data[(x > x0) & (x < x1) & (y > 0) & (y < 8.2) & (x > 0) & (x < 14.2)] = 0
    for a, b, c, d in WALLS:
        data[(x > max(a, x0)) & (x < min(c, x1)) & (y >= b) & (y <= d)] = 100
    return OccupancyGrid(data, resolution, (float(low[0]), float(low[1]), 0.0), name)


TRUTH = {"left": (1.0, 2.0, 0.4), "middle": (6.0, 3.0, -2.0), "right": (9.0, 5.0, 1.3)}


def building() -> list[OccupancyGrid]:
    """Three views that overlap: left, middle, right; TRUTH has their frames."""
    ranges = {"left": (-0.5, 9.0), "middle": (2.0, 12.0), "right": (5.0, 15.0)}
    return [view(name, ranges[name], TRUTH[name]) for name in TRUTH]


def hall(name: str = "hall") -> OccupancyGrid:
    """A plain small hall that has nothing in common with the building."""
    data = np.zeros((30, 45), dtype=np.int8)
    data[[0, -1], :] = data[:, [0, -1]] = 100
    data[10:18, 20:31] = 100
    return OccupancyGrid(data, 0.1, (-1.0, 2.0, 0.0), name)


def two_way_room(name: str, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    """A closed, bare room that a half turn takes to itself."""
    data = np.full((220, 300), -1, dtype=np.int8)
    data[10:210, 10:290] = 100
    data[12:208, 12:288] = 0
    data[90:130, 140:160] = 100
    return OccupancyGrid(data, 0.05, origin, name)


def clutter(rng: np.random.Generator, name: str) -> OccupancyGrid:
    """Nothing but clutter, which costs much and merges with nothing: in pieces of three cells in a row, since
    single ones would be taken for specks."""
    pieces = np.where(rng.random((400, 133)) < 0.012, 100, 0)
    return OccupancyGrid(np.kron(pieces, np.ones((1, 3), dtype=int)), 0.05, name=name)


def blank(name: str = "blank") -> OccupancyGrid:
    return OccupancyGrid(np.full((20, 30), -1, dtype=np.int8), 0.1, (3.0, 4.0, 0.0), name)


def save(folder: Path, grids: Sequence[OccupancyGrid]) -> list[str]:
    """Writes maps into a folder; their yaml paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for grid in grids:
        write_map(folder / f"{grid.name}.yaml", grid)
    return [str(folder / f"{grid.name}.yaml") for grid in grids]


def relative_error(T_a: np.ndarray, T_b: np.ndarray, a: str, b: str) -> tuple[float, float]:
    """Metres and radians by which T_a_b misses the truth."""
    found = se2.compose(se2.inverse(T_a), T_b)
    true = se2.compose(se2.inverse(TRUTH[a]), TRUTH[b])
    miss = se2.compose(se2.inverse(true), found)
    return float(np.hypot(miss[0], miss[1])), abs(float(miss[2]))


def run_cli(*args: object) -> tuple[int, str, str]:
    """The command line in this process: exit code, stdout, stderr."""
    from mapmeld.cli import main

    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with (
        mock.patch.object(sys, "argv", ["mapmeld", *map(str, args)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as stop:
            code = stop.code
    return (code if isinstance(code, int) else 0 if code is None else 1), out.getvalue(), err.getvalue()


def assert_refused(outcome: tuple[int, str, str], *words: str) -> None:
    """Exit code 2, one line on stderr that has the words, nothing on stdout."""
    code, out, err = outcome
    assert (code, out) == (2, ""), (code, out, err)
    assert err.startswith("mapmeld: ")
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    for word in words:
        assert word in err, err
