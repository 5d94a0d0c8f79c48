"""Writes real bags of every format for the tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mapmeld.grid import OccupancyGrid
from rooms import building, hall

START = 1_700_000_000.0
"""When the bags begin, seconds since the epoch: 2023-11-14T22:13:20Z."""

GRID, UPDATE, TEXT = "nav_msgs/msg/OccupancyGrid", "map_msgs/msg/OccupancyGridUpdate", "std_msgs/msg/String"
FORMATS = (
    "rosbag1",
    "rosbag1-bz2",
    "rosbag1-lz4",
    "sqlite3",
    "sqlite3-message",
    "sqlite3-file",
    "mcap",
    "mcap-message",
    "mcap-file",
    "mcap-storage",
)


class Record(NamedTuple):
    """A message: seconds from the bag's start, topic, type, and what makes it from the types of a ROS."""

    seconds: float
    topic: str
    type: str
    make: Callable[[Typestore], Any]


def store_of(kind: str) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC if kind.startswith("rosbag1") else Stores.ROS2_HUMBLE)
    if UPDATE not in store.types:
        text = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data\n"
        store.register(get_types_from_msg(text, UPDATE))
    return store


def header(store: Typestore, frame: str = "map", seconds: float = START) -> Any:
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=int(seconds), nanosec=0)
    kind = types["std_msgs/msg/Header"]
    if "seq" in kind.__dataclass_fields__:
        return kind(seq=0, stamp=stamp, frame_id=frame)
    return kind(stamp=stamp, frame_id=frame)


def message(store: Typestore, grid: OccupancyGrid, frame: str = "map") -> Any:
    """A grid as a nav_msgs/OccupancyGrid of the store."""
    types = store.types
    x, y, theta = grid.origin
    orientation = types["geometry_msgs/msg/Quaternion"](
        x=0.0, y=0.0, z=math.sin(theta / 2), w=math.cos(theta / 2)
    )
    origin = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=orientation
    )
    info = types["nav_msgs/msg/MapMetaData"](
        map_load_time=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0),
        resolution=grid.resolution,
        width=grid.width,
        height=grid.height,
        origin=origin,
    )
    return types[GRID](header=header(store, frame), info=info, data=grid.data.reshape(-1).copy())


def grid_record(
    seconds: float, topic: str, grid: OccupancyGrid, change: Callable[[Any], object] | None = None
) -> Record:
    """A map; `change` spoils the message."""

    def make(store: Typestore) -> Any:
        made = message(store, grid)
        if change is not None:
            change(made)
        return made

    return Record(seconds, topic, GRID, make)


def update_record(
    seconds: float, topic: str, x: int, y: int, cells: np.ndarray, frame: str = "map"
) -> Record:
    """A change of the map of a topic, on the topic that is for this."""
    height, width = cells.shape
    data = cells.astype(np.int8).reshape(-1)
    return Record(
        seconds,
        f"{topic}_updates",
        UPDATE,
        lambda store: store.types[UPDATE](
            header=header(store, frame), x=x, y=y, width=width, height=height, data=data
        ),
    )


def text_record(seconds: float, topic: str = "/chatter") -> Record:
    return Record(seconds, topic, TEXT, lambda store: store.types[TEXT](data="hello"))


def write_bag(path: Path, records: Sequence[Record], kind: str = "mcap") -> Path:
    """Writes a bag in one of FORMATS. Times are those of the recorder; headers all say START."""
    store = store_of(kind)
    family, _, compression = kind.partition("-")
    path.parent.mkdir(parents=True, exist_ok=True)
    writer: Any
    if family == "rosbag1":
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[family.upper()])
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for record in records:
            key = record.topic, record.type
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=store)
            serialize = store.serialize_ros1 if family == "rosbag1" else store.serialize_cdr
            raw = serialize(record.make(store), record.type)
            writer.write(connections[key], round((START + record.seconds) * 1e9), raw)
    return path


def bag_path(folder: Path, kind: str, name: str = "run") -> Path:
    return folder / (f"{name}.bag" if kind.startswith("rosbag1") else name)


def team(prefix: str = "", seconds: float = 5.0) -> list[Record]:
    """Three robots that first know little and then their part of the building."""
    robots = [(f"{prefix}/robot{i}/map", grid) for i, grid in enumerate(building(), 1)]
    early = [grid_record(1.0 + i / 10, topic, hall()) for i, (topic, _) in enumerate(robots)]
    late = [grid_record(seconds + i / 10, topic, grid) for i, (topic, grid) in enumerate(robots)]
    return [text_record(0.0), *early, *late, text_record(60.0)]
