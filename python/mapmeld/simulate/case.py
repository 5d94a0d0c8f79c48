"""A whole simulated case: the world, every robot's map, and the truth; and the folder it is written to."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapmeld import se2
from mapmeld.grid import OccupancyGrid
from mapmeld.simulate.drift import drifted
from mapmeld.simulate.free_space import FreeSpace
from mapmeld.simulate.lidar import Lidar, RayCaster
from mapmeld.simulate.options import SimulateOptions
from mapmeld.simulate.path import choose_homes, default_path_length, default_region_radius, drive
from mapmeld.simulate.streams import Purpose, stream
from mapmeld.simulate.tracing import trace_map
from mapmeld.simulate.truth import RobotRun, truth_record
from mapmeld.simulate.world import build_world


@dataclass(frozen=True)
class SimulatedCase:
    """A simulated case.

    options: what it was made from.
    world: the true world in the world frame.
    maps: one map a robot, each in a random frame of its own.
    paths: T_world_robot at each scan, one array of shape (scans, 3) a robot, metres and radians.
    truth: the content of truth.json: T_world_map of each map, T_a_b and overlaps of each pair, the options.
    """

    options: SimulateOptions
    world: OccupancyGrid
    maps: tuple[OccupancyGrid, ...]
    paths: tuple[NDArray[np.float64], ...]
    truth: dict[str, object]


def simulate(options: SimulateOptions) -> SimulatedCase:
    """Simulates a case: a world, robots that drive and scan it, a map of each in its own frame, the truth.

    The same options give the same case, bit for bit.

    Raises ConfigError for options that do not fit the world, MapFileError for a world file that cannot be
    read, MapmeldError for a world without room for the robots.
    """
    world = build_world(options)
    space = FreeSpace(world, options.robot_radius)
    caster = RayCaster(world)
    radius = options.region_radius or default_region_radius(space, options.robots)
    length = options.path_length or default_path_length(radius)
    homes = choose_homes(space, options.robots, radius, stream(options.seed, Purpose.HOMES))
    runs = [_run(options, k, space, caster, homes[k], radius, length) for k in range(options.robots)]
    return SimulatedCase(
        options=options,
        world=world,
        maps=tuple(run.grid for run in runs),
        paths=tuple(run.true_poses for run in runs),
        truth=truth_record(options, runs),
    )


def write_case(
    case: SimulatedCase, folder: str | Path, *, image_format: Literal["pgm", "png"] = "pgm"
) -> Path:
    """Writes the maps (NN_name.yaml and image) and truth.json; returns the folder, made if need be.

    image_format: "pgm" or "png".
    """
    from mapmeld.map_io import write_map

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for grid in case.maps:
        write_map(folder / f"{grid.name}.yaml", grid, image_format=image_format)
    text = json.dumps(case.truth, indent=1) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8", newline="\n")
    return folder


def _run(
    options: SimulateOptions,
    k: int,
    space: FreeSpace,
    caster: RayCaster,
    home: int,
    radius: float,
    length: float,
) -> RobotRun:
    """Robot k: its path, its scans, the path its odometry believes in, its map."""
    lidar = Lidar(
        options.beams, options.field_of_view, options.max_range, options.range_noise, options.dropout
    )
    poses = drive(
        space,
        home,
        radius,
        length,
        options.scan_spacing,
        options.scan_turn,
        stream(options.seed, Purpose.PATH, k),
    )
    ranges = lidar.scan(caster, poses, stream(options.seed, Purpose.LIDAR, k))
    believed = poses
    if options.drift:
        believed = drifted(poses, options.drift, stream(options.seed, Purpose.DRIFT, k))
    frame = stream(options.seed, Purpose.FRAME, k)
    # Somewhere within ten metres of the robot's start, at any yaw: the frame says nothing about the place.
    # Rounded as truth.json is, so that the file is exact.
    x, y = poses[0, :2] + frame.uniform(-10.0, 10.0, 2)
    T_world_map = np.round([x, y, frame.uniform(-math.pi, math.pi)], 6)
    offset_u, offset_v, axes = (float(v) for v in frame.uniform(size=3))
    T_map_world = se2.inverse(T_world_map)
    map_poses = np.column_stack([se2.apply(T_map_world, believed[:, :2]), believed[:, 2] + T_map_world[2]])
    grid = trace_map(
        map_poses,
        ranges,
        lidar.angles,
        options.max_range,
        options.resolutions[k % len(options.resolutions)],
        name=f"{k:02d}_r{k}",
        axes_yaw=math.pi * (2.0 * axes - 1.0) if options.origin_yaw else 0.0,
        offset=(offset_u, offset_v),
        margin=options.margin,
    )
    return RobotRun(grid, T_world_map, poses, map_poses, ranges, lidar.angles)
