"""What /diagnostics says: the node as a whole, and every robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mapmeld_msgs.msg import MergeEstimate, RobotPlacement

from mapmeld_ros.news import contradiction
from mapmeld_ros.result_message import WAITING
from mapmeld_ros.robots import Robot

_GOOD = frozenset({"merged", "prior", "pinned"})


def diagnostics_message(
    node: str,
    msg: MergeEstimate,
    robots: Sequence[Robot],
    problems: Mapping[str, str],
    error: str,
    now: float,
    stamp: Time,
) -> DiagnosticArray:
    """The state of the node called `node` and of its robots.

    msg: the newest estimate. problems: what else is wrong, robot to sentence. error: why the last estimate
        failed.
    now: of the clock that Robot.heard is told by.
    """
    result = DiagnosticArray()
    result.header.stamp = stamp
    placements = {p.robot: p for p in msg.robots}
    result.status = [_whole(node, msg, robots, error)]
    for robot in robots:
        placed = placements.get(robot.name)
        problem = problems.get(robot.name, "")
        result.status.append(_of_robot(node, robot, placed, problem, now, is_alone=len(robots) == 1))
    return result


def _whole(node: str, msg: MergeEstimate, robots: Sequence[Robot], error: str) -> DiagnosticStatus:
    status = DiagnosticStatus(name=f"{node}: map merge", hardware_id=node, level=DiagnosticStatus.OK)
    against = [p.robot for p in msg.robots if contradiction(p)]
    status.message = f"{_counted(len(robots), 'robot')} in {_counted(len(msg.components), 'map')}"
    if error:
        status.level, status.message = DiagnosticStatus.ERROR, f"the last estimate failed: {error}"
    elif not robots:
        status.level, status.message = DiagnosticStatus.WARN, "no robot's map topic found yet"
    elif against:
        status.level = DiagnosticStatus.WARN
        status.message += f"; poses that contradict the walls: {', '.join(against)}"
    status.values = _values(estimate_seconds=f"{msg.seconds:.3f}", registered_pairs=str(msg.registered_pairs))
    return status


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _of_robot(
    node: str, robot: Robot, placed: RobotPlacement | None, problem: str, now: float, *, is_alone: bool
) -> DiagnosticStatus:
    word = placed.status if placed is not None else WAITING
    status = DiagnosticStatus(name=f"{node}: robot {robot.name}", hardware_id=robot.name)
    against = contradiction(placed) if placed is not None else ""
    # Who is alone has nobody to share walls with.
    is_placed = word in _GOOD or (is_alone and word == "no evidence")
    is_good = is_placed and not robot.bad and not problem and not against
    status.level = DiagnosticStatus.OK if is_good else DiagnosticStatus.WARN
    said = [word]
    if robot.bad:
        said.append(f"newest message not used: {robot.bad}")
    if problem:
        said.append(problem)
    if against:
        said.append(f"its pose contradicts the walls: {against}")
    status.message = "; ".join(said)
    values = {
        "topic": robot.topic,
        "map_frame": robot.frame,
        "seconds_since_message": f"{now - robot.heard:.1f}",
    }
    if placed is not None:
        values |= {"probability": f"{placed.probability:.3f}", "reason": placed.reason}
        values |= {"component_frame": placed.component_frame, "placements": str(placed.placements)}
    status.values = _values(**values)
    return status


def _values(**values: str) -> list[KeyValue]:
    return [KeyValue(key=key, value=value) for key, value in values.items()]
