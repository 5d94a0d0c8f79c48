"""What becomes of a merge when maps are drawn otherwise: two maps of a building, one or both of them changed.

    python benchmarks/conditions.py
    python benchmarks/conditions.py --every 4 --only "echoes" "coarser"

Recorded pairs that share a quarter of their walls, and pairs of different buildings, in $MAPMELD_SHARED/data
(by default ../shared/data as seen from the repository), merged as two maps alone. What a mapper, a scanner or
an image editor does to maps is done to them cell by cell, at random where it is; the truth stays. Prints
Markdown.
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import zlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

import bench_report
import mapmeld
import trust_cases
import trust_score
from mapmeld import OccupancyGrid
from trust_cases import MapFile, MapPair

Change = Callable[[OccupancyGrid, np.random.Generator], OccupancyGrid]
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
FURNITURE_M, FLOOR_M2 = 0.4, 15.0
"""Side of a piece of furniture, and floor that there is for each."""


def _with_cells(g: OccupancyGrid, cells: NDArray[np.generic], cell: float | None = None) -> OccupancyGrid:
    return OccupancyGrid(np.ascontiguousarray(cells, np.int8), cell or g.resolution, g.origin, g.name)


def _gaps(share: float, g: OccupancyGrid, rng: np.random.Generator) -> OccupancyGrid:
    return _with_cells(g, np.where(rng.random(g.data.shape) < share, UNKNOWN, g.data))


def _echoes(share: float, g: OccupancyGrid, rng: np.random.Generator) -> OccupancyGrid:
    is_echo = (rng.random(g.data.shape) < share) & (g.data >= 0)
    return _with_cells(g, np.where(is_echo, OCCUPIED, g.data))


def _undecided(g: OccupancyGrid, rng: np.random.Generator) -> OccupancyGrid:
    """Walls of 55 to 99 percent, floor of 0 to 44: what lies from 26 to 64 counts as unknown."""
    wall, floor = rng.integers(55, 100, g.data.shape), rng.integers(0, 45, g.data.shape)
    return _with_cells(g, np.where(g.data >= 65, wall, np.where(g.data >= 0, floor, UNKNOWN)))


def _blurred(g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    """Known cells take something of their neighbours, 50 of unknown ones: walls get grey rims."""
    percent = Image.fromarray(np.where(g.data < 0, 50, g.data).astype(np.uint8))
    blurred = np.asarray(percent.filter(ImageFilter.GaussianBlur(0.7)))
    return _with_cells(g, np.where(g.data < 0, UNKNOWN, blurred))


def _thinned(g: OccupancyGrid, rng: np.random.Generator) -> OccupancyGrid:
    is_gone = (g.data >= 65) & (rng.random(g.data.shape) < 0.5)
    return _with_cells(g, np.where(is_gone, FREE, g.data))


def _thicker(cells: int, g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    walls = Image.fromarray(np.uint8(255) * (g.data >= 65).astype(np.uint8))
    for _step in range(cells):
        walls = walls.filter(ImageFilter.MaxFilter(3))
    return _with_cells(g, np.where(np.asarray(walls) > 0, OCCUPIED, g.data))


def _coarser(times: int, g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    """Blocks of cells: occupied where one is, free where one is free."""
    high, wide = (-(-n // times) for n in g.data.shape)
    padded = np.full((high * times, wide * times), UNKNOWN, np.int8)
    padded[: g.height, : g.width] = g.data
    blocks = padded.reshape(high, times, wide, times).transpose(0, 2, 1, 3).reshape(high, wide, -1)
    is_free = ((blocks >= 0) & (blocks < 65)).any(axis=2)
    cells = np.where((blocks >= 65).any(axis=2), OCCUPIED, np.where(is_free, FREE, UNKNOWN))
    return _with_cells(g, cells, g.resolution * times)


def _finer(times: int, g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    return _with_cells(g, np.kron(g.data, np.ones((times, times), np.int8)), g.resolution / times)


def _turned(degrees: float, g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    """The same map, drawn on a raster that is turned about its corner."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[0, 0], [g.width, 0], [0, g.height], [g.width, g.height]]) @ turn
    low = corners.min(axis=0)
    wide, high = np.ceil(corners.max(axis=0) - low).astype(int)
    rows, columns = np.mgrid[0:high, 0:wide]
    at = np.floor((np.stack([columns, rows], axis=-1) + 0.5 + low) @ turn.T).astype(int)
    inside = (at >= 0).all(axis=-1) & (at < [g.width, g.height]).all(axis=-1)
    cells = np.full((high, wide), UNKNOWN, np.int8)
    cells[inside] = g.data[at[inside][:, 1], at[inside][:, 0]]
    x, y = mapmeld.se2.apply(g.origin, turn @ low * g.resolution)
    return OccupancyGrid(cells, g.resolution, (float(x), float(y), g.origin[2] + float(angle)), g.name)


def _refurnished(g: OccupancyGrid, rng: np.random.Generator) -> OccupancyGrid:
    cells, floor = g.data.copy(), np.argwhere(g.data == FREE)
    pieces = int(len(floor) * g.resolution**2 / FLOOR_M2)
    half = max(1, round(FURNITURE_M / g.resolution / 2))
    for row, col in floor[rng.integers(0, len(floor), pieces)]:
        cells[max(0, row - half) : row + half, max(0, col - half) : col + half] = OCCUPIED
    return _with_cells(g, cells)


def _without_floor(g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    return _with_cells(g, np.where(g.data >= 65, OCCUPIED, UNKNOWN))


def _without_unknown(g: OccupancyGrid, _: np.random.Generator) -> OccupancyGrid:
    return _with_cells(g, np.where(g.data >= 65, OCCUPIED, FREE))


UNCHANGED = "as they are"
CONDITIONS: dict[str, Change] = {
    UNCHANGED: lambda g, _: g,
    "1 % of cells unknown": partial(_gaps, 0.01),
    "2 % of cells unknown": partial(_gaps, 0.02),
    "10 % of cells unknown": partial(_gaps, 0.1),
    "40 % of cells unknown": partial(_gaps, 0.4),
    "undecided cells": _undecided,
    "grey rims of walls": _blurred,
    "0.5 % of cells echoes": partial(_echoes, 0.005),
    "1 % of cells echoes": partial(_echoes, 0.01),
    "2 % of cells echoes": partial(_echoes, 0.02),
    "half of the wall cells free": _thinned,
    "walls one cell thicker all round": partial(_thicker, 1),
    "walls three cells thicker all round": partial(_thicker, 3),
    "cells twice as coarse": partial(_coarser, 2),
    "cells three times as coarse": partial(_coarser, 3),
    "cells twice as fine": partial(_finer, 2),
    "raster turned by 7 degrees": partial(_turned, 7.0),
    "raster turned by 30 degrees": partial(_turned, 30.0),
    "furniture put everywhere": _refurnished,
    "no free cell": _without_floor,
    "no unknown cell": _without_unknown,
}


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--every", type=int, default=1, help="take every so manieth pair")
    parser.add_argument(
        "--only", nargs="+", help="conditions whose names contain one of these; all without it"
    )
    parser.add_argument("--jobs", type=int, default=bench_report.usable_cores(), help="processes")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)
    same = [p for f in trust_cases.folders(None) for p in trust_cases.pairs(f) if p.band == "many"]
    same, others = same[:: args.every], trust_cases.negatives(None)[:: args.every]
    chosen = [c for c in CONDITIONS if args.only is None or any(text in c for text in args.only)]
    rows = []
    with multiprocessing.Pool(args.jobs) as pool:
        for condition in chosen:
            bench_report.tell(condition)
            for maps in ("none",) if condition == UNCHANGED else ("one", "both"):
                became = partial(_became, condition, maps == "both")
                counts = collections.Counter(pool.map(became, same, chunksize=4))
                merged = sum(x != "apart" for x in pool.map(became, others, chunksize=4))
                told = [str(counts[x]) for x in ("right", "apart", "near", "wrong")]
                rows.append((condition, maps, str(len(same)), *told, f"{merged} of {len(others)}"))
    columns = ("maps", "changed", "pairs", "right", "apart", "near", "wrong", "different buildings merged")
    limits = ["near: neither right nor wrong by the bounds of the trust benchmark."]
    bench_report.write(
        bench_report.header("Conditions", limits) + "\n" + bench_report.table(columns, rows), args.output
    )


def _became(condition: str, both: bool, pair: MapPair) -> str:
    """What the merge of a pair is: right, wrong, near or apart; of different buildings wrong or apart."""
    a, b = _changed(condition if both else UNCHANGED, pair.a, "a"), _changed(condition, pair.b, "b")
    result = mapmeld.merge([a, b], seed=1, threads=1)
    found = trust_score.relative(result, 0, 1)
    if found is None:
        return "apart"
    if pair.T_a_b is None:
        return "wrong"
    center = trust_cases.centre(pair.b.path)
    verdict = trust_score.judge(found, pair.T_a_b, pair.rms_m, center, b.resolution)
    return "right" if verdict.right else "wrong" if verdict.wrong else "near"


def _changed(condition: str, file: MapFile, name: str) -> OccupancyGrid:
    """A map in some condition, each time the same."""
    seed = zlib.crc32(f"{condition} {file.case}/{file.name}".encode())
    return CONDITIONS[condition](trust_cases.grid(file.path, name), np.random.default_rng(seed))


if __name__ == "__main__":
    main()
