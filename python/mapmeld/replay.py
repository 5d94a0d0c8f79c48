"""Recorded maps through the estimator, in the order of their time: how an estimate would have developed."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mapmeld.bag import Bag, GridMessage, PendingMap, RecordedMap
from mapmeld.estimate import Estimate, EstimatedComponent, RobotEstimate
from mapmeld.estimator import Estimator
from mapmeld.grid import OccupancyGrid
from mapmeld.map_inputs import BagTopic

_QUIET_NS = 20 * 10**9
"""Without a changed map for so long, maps count as done: a node's quiet_time by default."""


@dataclass(frozen=True, eq=False)
class Moment:
    """An estimate of a replay, without its maps.

    nanoseconds: when the last message that is in it was recorded, or when 20 s had gone by without a changed
        map. since_start: the same, in seconds from the
        start of the first bag.
    robots, components, registered_pairs, seconds: as in Estimate; the components have no `merged`.
    """

    nanoseconds: int
    since_start: float
    robots: tuple[RobotEstimate, ...]
    components: tuple[EstimatedComponent, ...]
    registered_pairs: int
    seconds: float


class Replay:
    """Feeds the maps of bags to an estimator. Iterating does the work: a Moment for each estimate.

    robots: topics of open bags. Several bags are replayed side by side, by the clocks of their recorders.
    step: seconds of the bags' time. An estimate is made at the end of each step in which a map changed; 0: at
        each new map. Maps count as done after 20 s without a changed one and at the end, which makes one more
        if it links anything.
    progress: hears (seconds done, seconds in all) of the bags' time.

    maps: the last map of each robot so far, by name. estimate: the last one, None before the first. seconds:
        from the start of the first bag to the end of the last.

    Iterating raises MapmeldError as Bag does, for messages that make no map.
    """

    def __init__(
        self,
        robots: Sequence[BagTopic],
        estimator: Estimator,
        step: float = 1.0,
        progress: Callable[[float, float], object] | None = None,
    ) -> None:
        self.estimate: Estimate | None = None
        self._robots = {(r.bag.path, r.topic): r for r in robots}
        self._estimator = estimator
        self._step = round(step * 1e9)
        self._progress = progress
        bags = {r.bag.path: r.bag for r in robots}
        self._bags = list(bags.values())
        self._start = min(bag.start for bag in self._bags)
        self._end = max(bag.end for bag in self._bags)
        self._pending: dict[str, tuple[BagTopic, PendingMap]] = {}
        self._known: dict[str, RecordedMap] = {}
        # When the maps changed, as long as they do not count as done.
        self._changed: int | None = None

    @property
    def maps(self) -> dict[str, OccupancyGrid]:
        return {name: known.grid for name, known in self._known.items()}

    @property
    def seconds(self) -> float:
        return (self._end - self._start) / 1e9

    def __iter__(self) -> Iterator[Moment]:
        latest = due = self._start
        for nanoseconds, robot, message in self._messages():
            if self._pending and nanoseconds > due and self._take_pending(latest):
                yield self._estimate(latest)
            if not self._pending:
                if self._changed is not None and nanoseconds > self._changed + _QUIET_NS:
                    yield from self._rested(self._changed + _QUIET_NS)
                due = self._end_of_step(nanoseconds)
            self._pending.setdefault(robot.name, (robot, PendingMap()))[1].add(message)
            latest = nanoseconds
        if self._take_pending(latest):
            yield self._estimate(latest, maps_are_done=True)
        elif self._changed is not None:
            yield from self._rested(latest)

    def _messages(self) -> Iterator[tuple[int, BagTopic, GridMessage]]:
        return heapq.merge(*map(self._messages_of, self._bags), key=lambda found: found[0])

    def _messages_of(self, bag: Bag) -> Iterator[tuple[int, BagTopic, GridMessage]]:
        robots = {topic: robot for (path, topic), robot in self._robots.items() if path == bag.path}
        for message in bag.messages(list(robots)):
            yield message.nanoseconds, robots[message.topic], message

    def _end_of_step(self, nanoseconds: int) -> int:
        if self._step == 0:
            return nanoseconds
        steps = -((self._start - nanoseconds) // self._step)
        return self._start + steps * self._step

    def _take_pending(self, nanoseconds: int) -> bool:
        """Tells the estimator what is pending; whether that changes anything."""
        changed = False
        for name, (robot, pending) in self._pending.items():
            before = self._known.get(name)
            now = robot.bag.decode(pending, name, before)
            if now is None:
                continue
            self._known[name] = now
            if before is None or not _is_same(before.grid, now.grid):
                self._estimator.update(now.grid)
                changed = True
        self._pending.clear()
        if self._progress is not None:
            self._progress((nanoseconds - self._start) / 1e9, self.seconds)
        if changed:
            self._changed = nanoseconds
        return changed

    def _rested(self, nanoseconds: int) -> Iterator[Moment]:
        """The estimate with the maps as they were, if that they are done links anything."""
        before = self.estimate
        moment = self._estimate(nanoseconds, maps_are_done=True)
        if before is None or [c.names for c in before.components] != [c.names for c in moment.components]:
            yield moment
        else:
            self.estimate = before

    def _estimate(self, nanoseconds: int, maps_are_done: bool = False) -> Moment:
        if maps_are_done:
            self._changed = None
        found = self.estimate = self._estimator.estimate(maps_are_done=maps_are_done)
        return Moment(
            nanoseconds,
            (nanoseconds - self._start) / 1e9,
            found.robots,
            tuple(replace(c, drawing=None) for c in found.components),
            found.registered_pairs,
            found.seconds,
        )


def _is_same(old: OccupancyGrid, new: OccupancyGrid) -> bool:
    return (
        old.resolution == new.resolution and old.origin == new.origin and np.array_equal(old.data, new.data)
    )
