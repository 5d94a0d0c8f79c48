"""The robots that the node knows and their newest good maps."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from builtin_interfaces.msg import Time
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg

from mapmeld import OccupancyGrid
from mapmeld.grid_message import BadMessage, apply_updates
from mapmeld_ros.conversions import MAX_CELLS, grid_from_message


@dataclass(frozen=True)
class Robot:
    """One robot. grid, frame and stamp are those of its newest good map; None and empty before the first.

    heard: when a message of it, good or bad, came last, or when it joined; seconds of a steady clock.
    bad: why its newest message was not used; empty when it was.
    """

    name: str
    topic: str
    heard: float
    grid: OccupancyGrid | None = None
    frame: str = ""
    stamp: Time = field(default_factory=Time)
    bad: str = ""


class Robots:
    """All robots by name, in the order in which they joined. Threads may share it."""

    def __init__(self, max_cells: int = MAX_CELLS) -> None:
        self._max_cells = max_cells
        self._robots: dict[str, Robot] = {}
        self._lock = threading.Lock()

    def join(self, name: str, topic: str, now: float) -> bool:
        """Adds a robot; False for one that is known."""
        with self._lock:
            if name in self._robots:
                return False
            self._robots[name] = Robot(name, topic, now)
            return True

    def leave(self, name: str) -> Robot | None:
        """Forgets a robot; what was known of it."""
        with self._lock:
            return self._robots.pop(name, None)

    def get(self, name: str) -> Robot | None:
        with self._lock:
            return self._robots.get(name)

    def all(self) -> tuple[Robot, ...]:
        with self._lock:
            return tuple(self._robots.values())

    def take_map(self, name: str, msg: OccupancyGridMsg, now: float) -> OccupancyGrid | None:
        """The robot's new grid; None for a robot that has left. Raises BadMessage, and keeps the last good
        map."""
        return self._take(name, msg, now, lambda robot: grid_from_message(msg, name, self._max_cells))

    def take_update(self, name: str, msg: OccupancyGridUpdate, now: float) -> OccupancyGrid | None:
        """The robot's grid with a part replaced; None for a robot that has left or has no whole map yet.

        An update without a frame is of the map as it is. Raises BadMessage.
        """

        def updated(robot: Robot) -> OccupancyGrid | None:
            return None if robot.grid is None else apply_updates(robot.grid, [msg])

        return self._take(name, msg, now, updated)

    def silent(self, now: float, timeout: float) -> list[Robot]:
        """Those not heard for `timeout` seconds; none when that is 0."""
        return [r for r in self.all() if timeout > 0 and now - r.heard > timeout]

    def _take(
        self,
        name: str,
        msg: OccupancyGridMsg | OccupancyGridUpdate,
        now: float,
        convert: Callable[[Robot], OccupancyGrid | None],
    ) -> OccupancyGrid | None:
        robot = self.get(name)
        if robot is None:
            return None
        try:
            frame = msg.header.frame_id
            if not frame and isinstance(msg, OccupancyGridUpdate):
                frame = robot.frame
            if robot.grid is not None and frame.strip("/") != robot.frame.strip("/"):
                raise BadMessage(
                    "header.frame_id",
                    f"{frame!r}, was {robot.frame!r}; a robot's map frame cannot change while it is known",
                )
            grid = convert(robot)
        except BadMessage as error:
            self._put(replace(robot, heard=now, bad=str(error)))
            raise
        if grid is None:
            return None
        self._put(replace(robot, heard=now, bad="", grid=grid, frame=frame, stamp=msg.header.stamp))
        return grid

    def _put(self, robot: Robot) -> None:
        with self._lock:
            # It may have left meanwhile.
            if robot.name in self._robots:
                self._robots[robot.name] = robot
