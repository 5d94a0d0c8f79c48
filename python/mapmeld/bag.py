"""Recorded maps: reads the occupancy grids of a ROS bag, with the rosbags library."""

from __future__ import annotations

import contextlib
import heapq
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mapmeld.bag_time import since_start
from mapmeld.errors import MapFileError, MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.grid_message import apply_updates, grid_from_message, is_empty
from mapmeld.map_yaml import one_line

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

GRID_TYPE, UPDATE_TYPE = "nav_msgs/msg/OccupancyGrid", "map_msgs/msg/OccupancyGridUpdate"
UPDATES = "_updates"
"""What the topic of a map's updates has behind the map's own name."""

_UPDATE_DEFINITION = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data\n"
_ROS1, _ROS2 = (".bag",), (".mcap", ".db3")
_COMPRESSED = (".zst", ".zstd", ".lz4", ".gz")
_ZSTD = b"\x28\xb5\x2f\xfd"
_RESCUE = {
    ".bag": "rosbag reindex mends a recording that was cut off",
    ".mcap": "mcap recover mends a recording that was cut off",
    ".db3": "sqlite3's .recover mends a recording that was cut off",
}


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a .bag, .mcap or .db3 file, or a folder that holds parts of one."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or bool(_parts(path))
    name = path.with_suffix("").name if path.suffix in _COMPRESSED else path.name
    return Path(name).suffix in _ROS1 + _ROS2


class RecordedMap(NamedTuple):
    """A map of a bag. nanoseconds: when it, or its last update, was recorded. updates: how many are in it.
    frame: its header's frame_id, in which its coordinates are given."""

    topic: str
    nanoseconds: int
    updates: int
    frame: str
    grid: OccupancyGrid


class GridMessage(NamedTuple):
    """A map or a map's update as it was recorded. topic: that of the map, also for an update."""

    nanoseconds: int
    topic: str
    type: str
    raw: bytes


@dataclass
class PendingMap:
    """What a topic said last, not yet decoded: a map, if there is one, and the updates after it."""

    full: GridMessage | None = None
    updates: list[GridMessage] = field(default_factory=list)

    def add(self, message: GridMessage) -> None:
        if message.type == GRID_TYPE:
            self.full = message
            self.updates.clear()
        else:
            self.updates.append(message)


class Bag:
    """An open bag: rosbag1, or rosbag2 with sqlite3 or mcap, a folder or a single file. A context manager.

    name: of the folder, or of the file without suffix.
    files: those that the bag consists of.
    start, end: nanoseconds of the first and last message of any topic, by the clock of the recorder.
    types: the message type of each topic. grids: how many maps each nav_msgs/OccupancyGrid topic has.

    Entering raises MapFileError, naming the file, for a bag that is missing, damaged, cut off or of no known
    format, and if the library is not installed.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.name = self.path.resolve().name if self.path.is_dir() else self.path.stem
        self.files = [f for f in self.path.iterdir() if f.is_file()] if self.path.is_dir() else [self.path]
        self._is_ros1 = self.path.suffix in _ROS1 and not self.path.is_dir()
        self._stack = contextlib.ExitStack()
        self._readers: list[Any] = []

    def __enter__(self) -> Bag:
        if not self.path.exists():
            raise MapFileError(f"{self.path}: no such file; check the path of the bag")
        if self.path.suffix in _COMPRESSED:
            raise MapFileError(
                f"{self.path}: is a packed part of a bag; give the folder with its metadata.yaml"
            )
        for file in self.files:
            log = file.with_name(f"{file.name}-wal")
            if file.suffix == ".db3" and log.is_file() and log.stat().st_size:
                raise MapFileError(
                    f"{log}: holds messages that the database lacks, as when the recorder was killed; "
                    f"move them with: sqlite3 {file} 'PRAGMA wal_checkpoint(TRUNCATE)'"
                )
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
        except ModuleNotFoundError as error:
            raise MapFileError(
                f"{self.path}: reading bags needs the package rosbags, which is not installed; "
                "pip install rosbags"
            ) from error
        with contextlib.ExitStack() as stack, self._reading():
            for part in self._storages():
                reader = Reader1(part) if self._is_ros1 else Reader2(part)
                self._readers.append(stack.enter_context(reader))
            self._store = _typestore(ros1=self._is_ros1)
            self._connections = [c for r in self._readers for c in r.connections]
            told = [r for r in self._readers if r.message_count]
            self.start = min((r.start_time for r in told), default=0)
            self.end = max((r.end_time - 1 for r in told), default=0)
            self._stack = stack.pop_all()
        self.types: dict[str, str] = {}
        self.grids: dict[str, int] = {}
        for c in self._connections:
            self.types[c.topic] = c.msgtype
            if c.msgtype == GRID_TYPE:
                self.grids[c.topic] = self.grids.get(c.topic, 0) + c.msgcount
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        self._readers.clear()

    def last_map(self, topic: str, name: str, until: int | None = None) -> RecordedMap | None:
        """The last map of a topic at or before `until` (nanoseconds; None: the end), with the updates after
        it; None if there is none by then or it has no cells. Only what is needed is decoded.

        Raises MapFileError, naming bag, topic, time and field, for a message that makes no grid.
        """
        last = self.end if until is None else min(until, self.end)
        pending = PendingMap()
        for begin, end in _windows_backwards(self.start, last):
            window = PendingMap()
            for message in self.messages([topic], begin, end):
                window.add(message)
            window.updates += pending.updates
            pending = window
            if pending.full is not None:
                return self.decode(pending, name)
        return None

    def first_time(self, topic: str) -> int | None:
        """When the first map of a topic was recorded, nanoseconds."""
        times = (m.nanoseconds for m in self.messages([topic]) if m.type == GRID_TYPE)
        return next(times, None)

    def messages(
        self, topics: Sequence[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[GridMessage]:
        """Maps of the topics and their updates, in the order of time, from `begin` up to and with `end`."""
        wanted = {(t, GRID_TYPE): t for t in topics} | {(t + UPDATES, UPDATE_TYPE): t for t in topics}
        with self._reading(), contextlib.ExitStack() as stack:
            streams = []
            for reader in self._readers:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                self._refuse_foreign(connections)
                if connections:  # none would mean all
                    stream = reader.messages(connections, begin, None if end is None else end + 1)
                    streams.append(stack.enter_context(contextlib.closing(stream)))
            for connection, nanoseconds, raw in heapq.merge(*streams, key=lambda found: found[1]):
                topic = wanted[connection.topic, connection.msgtype]
                yield GridMessage(nanoseconds, topic, connection.msgtype, raw)

    def decode(self, pending: PendingMap, name: str, before: RecordedMap | None = None) -> RecordedMap | None:
        """What a topic said last, as a map; updates without a map change the one `before`. None without
        either, and for a map of no cells."""
        full, updates = pending.full, pending.updates
        if full is not None:
            message = self._message(full)
            if is_empty(message):
                return None
            try:
                grid = grid_from_message(message, name)
            except MapmeldError as error:
                raise self._located(full, error) from error
            before = RecordedMap(full.topic, full.nanoseconds, 0, message.header.frame_id, grid)
        if before is None or not updates:
            return before
        latest = updates[0]

        def decoded() -> Iterator[Any]:
            nonlocal latest
            for latest in updates:
                message = self._message(latest)
                frame = message.header.frame_id
                if frame.strip("/") not in ("", before.frame.strip("/")):
                    raise MapmeldError(
                        f"header.frame_id: is {frame!r}, the map's is {before.frame!r}; the update "
                        "belongs to another map"
                    )
                yield message

        try:
            grid = apply_updates(before.grid, decoded())
        except MapFileError:
            raise
        except MapmeldError as error:
            raise self._located(latest, error) from error
        return before._replace(
            nanoseconds=latest.nanoseconds, updates=before.updates + len(updates), grid=grid
        )

    def time(self, nanoseconds: int) -> str:
        """A moment of this bag, for people."""
        return since_start(nanoseconds, self.start)

    def _storages(self) -> list[Path]:
        """The bag itself or, where a folder has no metadata.yaml, its parts one by one."""
        if not self.path.is_dir() or (self.path / "metadata.yaml").exists():
            return [self.path]
        return _parts(self.path)

    def _message(self, message: GridMessage) -> Any:
        decode = self._store.deserialize_ros1 if self._is_ros1 else self._store.deserialize_cdr
        try:
            return decode(message.raw, message.type)
        # Damaged bytes surface as any of struct's, numpy's and the library's errors.
        except Exception as error:
            if bytes(message.raw[:4]) == _ZSTD:
                problem = "is packed, which only metadata.yaml tells; give the bag's folder"
            else:
                problem = f"cannot be decoded as {message.type}: {error}; the bag is damaged"
            raise self._located(message, problem) from error

    def _located(self, message: GridMessage, problem: object) -> MapFileError:
        """An error with the bag, topic and time of the message."""
        topic = message.topic + (UPDATES if message.type == UPDATE_TYPE else "")
        return MapFileError(
            one_line(f"{self.path}: {topic}, message at {self.time(message.nanoseconds)}: {problem}")
        )

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        """Turns whatever reading raises into one line about the bag."""
        try:
            yield
        except MapmeldError:
            raise
        # Damaged bytes surface as any of struct's, zstd's, sqlite's and the library's errors; where
        # they stand for a length, as a MemoryError.
        except Exception as error:
            names = (f.with_suffix("") if f.suffix in _COMPRESSED else f for f in self.files)
            suffix = next((n.suffix for n in names if n.suffix in _RESCUE), ".mcap")
            reason = str(error).rstrip(".") or type(error).__name__
            if isinstance(error, MemoryError):
                reason = "a part of it claims to be larger than the memory"
            raise MapFileError(
                one_line(f"{self.path}: cannot be read as a bag: {reason}; is it complete? {_RESCUE[suffix]}")
            ) from error

    def _refuse_foreign(self, connections: Sequence[Any]) -> None:
        for c in connections:
            encoding = getattr(c.ext, "serialization_format", "cdr")
            if encoding != "cdr":
                raise MapFileError(
                    f"{self.path}: {c.topic}: is encoded as {encoding!r}; only cdr can be read"
                )


def _parts(folder: Path) -> list[Path]:
    """Storage files in a folder."""
    return sorted(f for f in folder.iterdir() if f.suffix in _ROS2 and f.is_file())


def _typestore(*, ros1: bool) -> Typestore:
    """The definitions of what we read. Not those in the bag: sqlite bags before Iron have none, and an odd
    type among a bag's others must not keep us from its maps."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if UPDATE_TYPE not in store.types:
        store.register(get_types_from_msg(_UPDATE_DEFINITION, UPDATE_TYPE))
    return store


def _windows_backwards(start: int, last: int) -> Iterator[tuple[int, int]]:
    """Spans of time that end at `last` and reach back to `start`, each twice as long as the one after it: the
    last map is found without reading the bag from its start."""
    width = max((last - start) // 64, 10**9)
    while last >= start:
        begin = max(last - width, start)
        yield begin, last
        last, width = begin - 1, width * 2
