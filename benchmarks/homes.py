"""Cases of nine homes that no weight was fitted to: robots that drive in floor plans of scanned houses.

    pip download --no-deps ir-sim && unzip ir_sim-*.whl 'irsim/world/map/*'
    python benchmarks/homes.py irsim/world/map/binary_map_generator_hm3d target/homes
    MAPMELD_SHARED=target/homes python benchmarks/trust.py --only pairs same whole

The plans (Habitat-Matterport 3D, as the package ir-sim draws them) show the floor that a robot can reach in
white and all else hatched; their scale is not told, and 0.025 metres a pixel makes them 19 metres wide. The
worlds are real, the robots, their scanners and their drift are simulated. What was refused here led to the
generated home and to how floor in common counts: it is no blind test of those.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mapmeld import OccupancyGrid
from mapmeld.grid import FREE, OCCUPIED
from mapmeld.map_io import write_map
from mapmeld.simulate import SimulateOptions, simulate, write_case
from mapmeld.simulate.raster import dilate

PIXEL = 0.025
"""Metres."""
HATCH = 15
"""Pixels from a line within which all that is white between two lines of a hatch lies."""
RUNS = ((4.0, 0.0), (6.0, 1.0))
"""How far the robots of a case go, metres, and how much they drift."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plans", type=Path, help="folder of hm3d_1.png and others")
    parser.add_argument("output", type=Path, help="folder for the cases, new")
    args = parser.parse_args(argv)
    plans = sorted(args.plans.glob("hm3d_*.png"))
    if not plans:
        sys.exit(f"{args.plans}: no hm3d_*.png; the package ir-sim on PyPI has them in irsim/world/map")
    if args.output.exists():
        sys.exit(f"{args.output} is there already; name another folder")
    (args.output / "world").mkdir(parents=True)
    for k, plan in enumerate(plans, start=1):
        world = args.output / "world" / f"home{k}.yaml"
        with Image.open(plan) as drawing:
            floor = floor_of(np.asarray(drawing.convert("L")) > 100)
        data = np.where(floor, FREE, OCCUPIED).astype(np.int8)[::-1]
        write_map(world, OccupancyGrid(np.ascontiguousarray(data), PIXEL, (0.0, 0.0, 0.0), world.stem))
        for seed, (radius, drift) in enumerate(RUNS):
            options = SimulateOptions(
                world=str(world), seed=seed, robots=5, drift=drift, region_radius=radius
            )
            write_case(simulate(options), args.output / "data" / f"{world.stem}_s{seed}")


def floor_of(white: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What is floor of what is white in a drawing: no margins, nothing between the lines of a hatch."""
    rows, columns = white.all(axis=1), white.all(axis=0)
    white = white & ~rows[:, None] & ~columns
    white[[0, -1]] = False
    white[:, [0, -1]] = False
    floor = ~dilate(~white, HATCH)
    while True:
        grown = dilate(floor, 1) & white
        if np.array_equal(grown, floor):
            return floor
        floor = grown


if __name__ == "__main__":
    main()
