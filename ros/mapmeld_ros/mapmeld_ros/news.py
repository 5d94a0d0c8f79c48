"""What has changed from one estimate to the next, as lines for the log."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from mapmeld_msgs.msg import MergeEstimate, RobotPlacement

from mapmeld_ros.result_message import WAITING

# What an estimate says of a robot that is where it is whatever its walls say.
_HELD_ANYWAY = frozenset({"pinned", "prior"})


@dataclass(frozen=True)
class Line:
    """A line for the log. is_warning: somebody should look at it."""

    text: str
    is_warning: bool = False


def contradiction(placed: RobotPlacement) -> str:
    """What the walls say against a pin or a known pose; empty when they do not contradict it."""
    if placed.status not in _HELD_ANYWAY:
        return ""
    return str(placed.reason).partition("; ")[2]


class News:
    """Compares each estimate with the one before. Robots that wait are not told of."""

    def __init__(self) -> None:
        self._robots: dict[str, RobotPlacement] = {}
        self._mates: dict[str, frozenset[str]] = {}

    def of(self, msg: MergeEstimate) -> list[Line]:
        """One line for each change."""
        robots = {r.robot: r for r in msg.robots if r.status != WAITING}
        mates = {n: frozenset(c.robots) for c in msg.components for n in c.robots}
        lines = list(self._lines(robots, mates))
        self._robots, self._mates = robots, mates
        return lines

    def _lines(
        self, robots: Mapping[str, RobotPlacement], mates: Mapping[str, frozenset[str]]
    ) -> Iterator[Line]:
        stayed = {n for n, r in robots.items() if self._is_in_same_frame(r)}
        moved = {n for n in stayed if robots[n].placements > self._robots[n].placements}
        # A pin moves along whoever is linked: the frame is what moved, and one line says so.
        shifted: set[str] = set()
        for names in set(mates.values()):
            here = names & stayed
            if len(here) > 1 and here <= moved:
                shifted |= here
                frame = robots[min(here)].component_frame
                yield Line(f"{frame!r} moved: {_listed(here)} lie elsewhere in it, together or one by one")
        for name, r in robots.items():
            old = self._robots.get(name)
            lost = (self._mates.get(name, frozenset()) & robots.keys()) - mates.get(name, frozenset())
            gained = mates.get(name, frozenset()) - self._mates.get(name, frozenset()) - {name}
            if r.status == "pinned" and (old is None or old.status != "pinned"):
                yield Line(f"robot {name!r} is pinned at {_pose(r)}")
            elif old is not None and old.status == "pinned" and r.status != "pinned":
                yield Line(f"robot {name!r} is no longer pinned: {_standing(r)}")
            elif lost and name not in stayed:
                yield Line(f"robot {name!r} is split from {_listed(lost)}: {_standing(r)}")
            elif gained and name not in stayed:
                yield Line(f"robot {name!r} is linked with {_listed(gained)}: {_standing(r)}")
            elif name in moved - shifted:
                yield Line(f"robot {name!r} moved to {_pose(r)}: {_standing(r)}")
            elif old is None or (old.status != r.status and not gained and not lost):
                yield Line(f"robot {name!r}: {_standing(r)}")
            yield from _on_contradiction(name, contradiction(r), "" if old is None else contradiction(old))

    def _is_in_same_frame(self, robot: RobotPlacement) -> bool:
        old = self._robots.get(robot.robot)
        return old is not None and robot.has_pose and old.component_frame == robot.component_frame


def _on_contradiction(name: str, said: str, before: str) -> Iterator[Line]:
    if said and not before:
        yield Line(f"robot {name!r}: its pose contradicts the walls: {said}", is_warning=True)
    elif before and not said:
        yield Line(f"robot {name!r}: its pose no longer contradicts the walls")


def _standing(r: RobotPlacement) -> str:
    return f"{r.status}, probability {r.probability:.2f}, in {r.component_frame!r} ({r.reason})"


def _pose(r: RobotPlacement) -> str:
    p, q = r.pose.pose.position, r.pose.pose.orientation
    yaw = 2 * math.atan2(q.z, q.w)
    yaw = math.atan2(math.sin(yaw), math.cos(yaw))
    return f"x {p.x:.2f} m, y {p.y:.2f} m, yaw {yaw:.3f} rad in {r.component_frame!r}"


def _listed(names: set[str] | frozenset[str]) -> str:
    return ", ".join(repr(n) for n in sorted(names))
