"""The maps that a command is given, saved and recorded, and what they are called."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mapmeld.bag import Bag, is_bag
from mapmeld.bag_time import BagTime, parse_bag_time
from mapmeld.bag_topics import guess_topics, named_topics, robot_names
from mapmeld.errors import MapFileError, MapmeldError
from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.map_file import MapFile
from mapmeld.map_io import check_is_yaml, read_map
from mapmeld.map_names import saved_names
from mapmeld.map_yaml import one_line
from mapmeld.missing_class import lacking_class


class BagTopic(NamedTuple):
    """A robot in a bag: the topic of its maps, and its name. given: the user named the topic."""

    bag: Bag
    topic: str
    name: str
    given: bool


@dataclass
class MapInputs:
    """Maps that were read, and from which files. notes: where each recorded map comes from. warnings: what
    the user must know."""

    grids: list[OccupancyGrid] = field(default_factory=list)
    files: list[MapFile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def check_paths(paths: Sequence[Path]) -> None:
    """Raises MapmeldError for a path that is given twice, and for a file that is neither a yaml nor a bag."""
    saved_names(paths)
    for path in paths:
        if not is_bag(path):
            check_is_yaml(path)


def check_bag_options(
    paths: Sequence[Path], topics: str | None, at: str | None
) -> tuple[list[str] | None, BagTime | None]:
    """--topics and --at, read. Raises MapmeldError for a time that is none, and where there is no bag."""
    given = [flag for flag, value in (("--topics", topics), ("--at", at)) if value is not None]
    if given and not any(is_bag(path) for path in paths):
        raise MapmeldError(f"{given[0]}: is about bags, and there is none among the maps; leave it out")
    names = None if topics is None else [topic.strip() for topic in topics.split(",") if topic.strip()]
    if names == []:
        raise MapmeldError("--topics: names no topic; write /robot1/map,/robot2/map")
    return names, None if at is None else parse_bag_time(at)


def read_inputs(
    paths: Sequence[Path],
    topics: Sequence[str] | None = None,
    at: BagTime | None = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> MapInputs:
    """Reads saved maps (yaml), called as saved_names says, and of bags the last map of each robot, in the
    order of the paths.

    topics: those of the bags that hold the maps; None: guessed. at: the last map at or before it. A topic
    that was named and has no map by then is an error, one that was guessed a warning.

    Raises MapmeldError, naming file and field, for input that cannot be used, and if no map is left.
    """
    inputs = MapInputs()
    with open_bags([p for p in paths if is_bag(p)]) as bags:
        saved = saved_names([p for p in paths if not is_bag(p)])
        robots = choose_robots(bags, topics, inputs.warnings, taken=list(saved.values()))
        jobs: list[Path | BagTopic] = []
        for path in paths:
            jobs += [path] if path in saved else [r for r in robots if r.bag.path == path]
        _tell_late(bags, at, inputs)
        for done, job in enumerate(jobs):
            if progress is not None:
                progress("read", done, len(jobs))
            if isinstance(job, BagTopic):
                _read_last(job, at, inputs)
            else:
                inputs.grids.append(read_map(job, saved[job]))
                inputs.files.append(MapFile(job))
    if not inputs.grids:
        raise MapFileError(one_line("; ".join(inputs.warnings)))
    inputs.warnings += _told_twice(inputs.grids)
    lacks = ((g.name, lacking_class(g)) for g in inputs.grids)
    inputs.warnings += [f"map {name} {lack}" for name, lack in lacks if lack is not None]
    return inputs


def _told_twice(grids: Sequence[OccupancyGrid]) -> list[str]:
    """A sentence for each map that has the cells of another: it would merge with it, and tell nothing."""
    first: dict[tuple[float, int, int], list[OccupancyGrid]] = {}
    lines = []
    for grid in grids:
        alike = first.setdefault((grid.resolution, grid.width, grid.height), [])
        twin = next((g for g in alike if np.array_equal(g.data, grid.data)), None)
        if twin is None:
            alike.append(grid)
        elif (grid.data != UNKNOWN).any():
            lines.append(f"maps {twin.name} and {grid.name} are the same, cell by cell; give every map once")
    return lines


@contextlib.contextmanager
def open_bags(paths: Sequence[Path]) -> Iterator[list[Bag]]:
    """The bags at `paths`, open."""
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(Bag(path)) for path in paths]


def choose_robots(
    bags: Sequence[Bag], topics: Sequence[str] | None, warnings: list[str], taken: Sequence[str] = ()
) -> list[BagTopic]:
    """The robots in the bags, with names of their own: one that occurs twice, or is `taken`, gets that of its
    bag in front. Adds to the warnings what a guess left out."""
    choices = [guess_topics(bag) for bag in bags] if topics is None else named_topics(bags, topics)
    robots = [
        BagTopic(bag, topic, name, topics is not None)
        for bag, choice in zip(bags, choices, strict=True)
        for topic, name in zip(choice.topics, robot_names(bag, choice.topics), strict=True)
    ]
    for bag, choice in zip(bags, choices, strict=True):
        warnings += [f"{bag.path}: {text}, and is not taken; --topics takes it" for text in choice.left_out]
    count = Counter([*taken, *(r.name for r in robots)])
    robots = [r._replace(name=f"{r.bag.name}/{r.name}") if count[r.name] > 1 else r for r in robots]
    for name, times in Counter([*taken, *(r.name for r in robots)]).items():
        if times > 1:
            twice = ", ".join(str(r.bag.path) for r in robots if r.name == name)
            raise MapFileError(
                one_line(f"{twice}: two maps would be called {name!r}; rename a file, names tell maps apart")
            )
    return robots


def _tell_late(bags: Sequence[Bag], at: BagTime | None, inputs: MapInputs) -> None:
    for bag in bags:
        if at is not None and bag.grids and at.in_bag(bag.start) > bag.end:
            inputs.warnings.append(
                f"{bag.path}: ends at {bag.time(bag.end)}, before {at.text}; its last maps are taken"
            )


def _read_last(robot: BagTopic, at: BagTime | None, inputs: MapInputs) -> None:
    bag = robot.bag
    found = bag.last_map(robot.topic, robot.name, None if at is None else at.in_bag(bag.start))
    if found is not None:
        inputs.grids.append(found.grid)
        inputs.files.append(MapFile(bag.path, robot.topic, found.nanoseconds))
        updates = f", {found.updates} updates" if found.updates else ""
        inputs.notes.append(
            f"{robot.name}: {robot.topic} of {bag.path}, at {bag.time(found.nanoseconds)}{updates}"
        )
        return
    by_then = "" if at is None else f" by {at.text}"
    first = bag.first_time(robot.topic)
    if first is None:
        hint = "none was recorded"
    elif at is not None and first > at.in_bag(bag.start):
        hint = f"the first is at {bag.time(first)}"
    else:
        hint = "the last one has no cells"
    problem = f"{bag.path}: {robot.topic} has no map{by_then}; {hint}"
    if robot.given:
        raise MapFileError(one_line(problem))
    inputs.warnings.append(f"{problem}; {robot.name} is left out")
