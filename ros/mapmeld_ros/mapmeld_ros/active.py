"""What the node does while it is active: finds robots, takes their maps, publishes what comes of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING

from map_msgs.msg import OccupancyGridUpdate
from mapmeld_msgs.msg import MergeEstimate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from mapmeld import Estimate
from mapmeld.grid_message import BadMessage
from mapmeld.missing_class import lacking_class
from mapmeld.true_size import wrong_sizes
from mapmeld_ros.discovery import MAP_TYPE, find_robots, in_namespace
from mapmeld_ros.estimation import EstimationWorker
from mapmeld_ros.known_poses import BadKnownPose
from mapmeld_ros.listening import RobotListener
from mapmeld_ros.merged_maps import MergeWorker
from mapmeld_ros.news import News
from mapmeld_ros.own_topics import ForeignPublishers
from mapmeld_ros.publishing import Publishing
from mapmeld_ros.result_message import estimate_message
from mapmeld_ros.session import MergeSession
from mapmeld_ros.status_message import diagnostics_message
from mapmeld_ros.throttle import Throttle
from mapmeld_ros.tree import Tree

if TYPE_CHECKING:
    from mapmeld_ros.node import MapMerge

# How often the node looks after the robots that it knows: their publishers' quality of service, their
# silence.
_TICK_SECONDS = 0.5
# Right after the start the graph is still being found: for so long, robots are looked for at every tick, and
# the ticks are shorter.
_EAGER_SECONDS = 10.0
_EAGER_TICK_SECONDS = 0.1
# How long after the first map the first estimate waits for those of other robots.
_SETTLE_SECONDS = 0.4
# How long after the last change of a robot's pose parameters it takes effect: people set them one by one.
_POSE_SECONDS = 2.0
_TF_SECONDS = 0.1
_DIAGNOSTICS_SECONDS = 1.0


class Active:
    """Listens and publishes from its making until stop()."""

    def __init__(self, node: MapMerge, session: MergeSession, publishing: Publishing) -> None:
        self._node, self._session, self._publishing = node, session, publishing
        self._log = node.get_logger()
        self._throttle = Throttle()
        # Of maps that are told to be of a wrong size, by name.
        self._sizes: dict[str, float] = {}
        self._listeners: dict[str, RobotListener] = {}
        self._tree = Tree(node, session, publishing, lambda robot, said: self._warn((robot, "tf"), said))
        self._news = News()
        self._foreign = ForeignPublishers(node)
        # When the changed poses of robots take effect.
        self._poses_due: dict[str, float] = {}
        self._error = ""
        self._estimate_lock = threading.Lock()
        self._settles: float | None = None
        # When a map changed last; none since the maps were taken for done.
        self._changed: float | None = time.monotonic()
        self._started = time.monotonic()
        self._discovered = float("-inf")
        self._diagnosed = float("-inf")
        self._estimation = EstimationWorker(
            session.estimator,
            lambda: node.parameters.estimation_rate,
            lambda: node.parameters.estimation_timeout,
            self._take_estimate,
            self._estimate_failed,
        )
        self._merging = MergeWorker(
            lambda: node.parameters.merging_rate, self._publish_maps, self._merge_failed
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers = [node.create_timer(_EAGER_TICK_SECONDS, self._tick, clock=steady)]
        if node.parameters.publish_tf == "dynamic":
            self._timers.append(
                node.create_timer(_TF_SECONDS, lambda: publishing.again(node.stamp()), clock=steady)
            )
        self._estimation.start()
        self._merging.start()
        self._log.info(
            f"active: waits for topics {self._awaited()!r} of type {MAP_TYPE}; the merged map is on "
            f"{node.resolve_topic_name(node.parameters.merged_map_topic)} in {node.parameters.world_frame!r}"
        )
        # What was known before a pause.
        for robot in session.robots.all():
            self._listen(robot.name, robot.topic)
        self._publish_estimate()
        if session.is_settled:
            # Known poses may have been set during the pause.
            for robot in session.robots.all():
                self.place_known(robot.name)
            self._estimation.request(now=True)
        elif session.grids():
            self._settles = time.monotonic()
        self._tick()

    def stop(self) -> None:
        """Ends everything; the robots and their maps stay known."""
        for timer in self._timers:
            self._node.destroy_timer(timer)
        for listener in self._listeners.values():
            listener.close()
        self._tree.close()
        self._estimation.stop()
        self._merging.stop()

    def request_estimate(self, *, maps_are_done: bool) -> None:
        """Estimates at once."""
        self._estimation.request(now=True, maps_are_done=maps_are_done)

    def pose_changed(self, robot: str) -> None:
        """Takes the robot's known pose some time after the last change of its parameters."""
        self._poses_due[robot] = time.monotonic() + _POSE_SECONDS

    def place_known(self, robot: str) -> None:
        """Takes the robot's known pose as its parameters have it now."""
        try:
            self._session.place_known(robot)
        except BadKnownPose as error:
            self._log.error(f"robot {robot!r}: {error}")
        self._estimation.request(now=True)

    def _tick(self) -> None:
        now = time.monotonic()
        eager = now - self._started < _EAGER_SECONDS
        if not eager:
            self._timers[0].timer_period_ns = int(1e9 * _TICK_SECONDS)
        if eager or now - self._discovered >= 1.0 / self._node.parameters.discovery_rate:
            self._discovered = now
            self._discover(now)
        if self._settles is not None and now >= self._settles:
            self._settle()
        for name in [r for r, due in self._poses_due.items() if due <= now]:
            del self._poses_due[name]
            self.place_known(name)
        for name, doubt in self._session.take_doubts().items():
            self._log.warning(f"robot {name!r}: {doubt}")
        for sentence in self._foreign.new(self._publishing.own_map_topics()):
            self._log.warning(sentence)
        quiet = self._node.parameters.quiet_time
        if self._changed is not None and 0 < quiet <= now - self._changed:
            self._changed = None
            self._estimation.request(maps_are_done=True)
        publishers = {name: listener.follow() for name, listener in self._listeners.items()}
        for robot in self._session.robots.silent(now, self._node.parameters.robot_timeout):
            if not publishers.get(robot.name):
                self._leave(robot.name, now - robot.heard)
        self._tree.follow(self._node.get_topic_names_and_types())
        if now - self._diagnosed >= _DIAGNOSTICS_SECONDS:
            self._diagnosed = now
            self._publish_diagnostics(now)

    def _settle(self) -> None:
        self._settles = None
        try:
            self._session.settle()
        except BadKnownPose as error:
            self._log.error(str(error))
        self._estimation.request(now=True)

    def _awaited(self) -> str:
        p = self._node.parameters
        among = f" whose name contains {p.robot_namespace!r}" if p.robot_namespace else ""
        return f"<robot>/{p.robot_map_topic.strip('/')}{among}"

    def _discover(self, now: float) -> None:
        p = self._node.parameters
        found = find_robots(
            self._node.get_topic_names_and_types(),
            p.robot_map_topic,
            p.robot_namespace,
            self._publishing.own_map_topics(),
        )
        for name, topic in found.items():
            # Somebody who only listens, a display say, is no robot.
            if name not in self._listeners and self._node.count_publishers(topic):
                if self._session.robots.join(name, topic, now):
                    self._log.info(f"robot {name!r} joins: {topic}")
                self._listen(name, topic)
                self._publish_estimate()

    def _listen(self, name: str, topic: str) -> None:
        self._listeners[name] = RobotListener(
            self._node,
            topic,
            in_namespace(name, self._node.parameters.robot_map_updates_topic),
            lambda msg: self._take_map(name, msg),
            lambda msg: self._take_update(name, msg),
            lambda sentence: self._warn((name, "qos"), f"robot {name!r}: {sentence}"),
        )
        self._listeners[name].follow()

    def _leave(self, name: str, seconds: float) -> None:
        self._log.warning(f"robot {name!r} leaves: no map and no publisher for {seconds:.0f} s")
        self._listeners.pop(name).close()
        self._session.leave(name)
        self._estimation.request(now=True)
        self._merging.request()

    def _take_map(self, name: str, msg: OccupancyGridMsg) -> None:
        self._take(name, "map", lambda: self._session.take_map(name, msg, time.monotonic()))

    def _take_update(self, name: str, msg: OccupancyGridUpdate) -> None:
        self._take(name, "map update", lambda: self._session.take_update(name, msg, time.monotonic()))

    def _take(self, name: str, kind: str, take: Callable[[], bool]) -> None:
        before = self._session.robots.get(name)
        try:
            has_changed = take()
        except BadMessage as error:
            self._warn(
                (name, error.field), f"robot {name!r}: {kind} not used: {error}; its last good map stays"
            )
            return
        except BadKnownPose as error:
            self._log.error(f"robot {name!r}: {error}")
            has_changed = True
        if has_changed:
            now = self._session.robots.get(name)
            if now is not None and (g := now.grid) is not None:
                if before is not None and before.grid is None:
                    size = f"{g.width} x {g.height} cells of {g.resolution:.3g} m"
                    self._log.info(f"robot {name!r} is heard: {size} in the frame {now.frame!r}")
                if (lack := lacking_class(g)) is not None:
                    self._warn((name, "cells"), f"robot {name!r}: its map {lack}")
            self._changed = time.monotonic()
            if self._session.is_settled:
                self._estimation.request()
                self._merging.request()
            elif self._settles is None:
                self._settles = time.monotonic() + _SETTLE_SECONDS

    def _take_estimate(self, estimate: Estimate) -> None:
        self._error = ""
        self._session.take_estimate(estimate)
        self._tree.publish()
        self._publish_estimate()
        for line in self._news.of(self._message()):
            # rclpy wants one severity from one line of code.
            if line.is_warning:
                self._log.warning(line.text)
            else:
                self._log.info(line.text)
        if estimate.result is not None:
            wrong = wrong_sizes(estimate.result.pairs)
            for w in wrong:
                if self._sizes.get(w.name) != round(w.scale, 2):
                    self._log.warning(str(w))
            self._sizes = {w.name: round(w.scale, 2) for w in wrong}
        self._merging.request()

    def _publish_estimate(self) -> None:
        # What is latched is what was known last, whichever thread publishes.
        with self._estimate_lock:
            self._publishing.estimate(self._message())

    def _message(self) -> MergeEstimate:
        known, p = self._session.known, self._node.parameters
        msg = estimate_message(
            known.estimate,
            self._session.robots.all(),
            known.names,
            p.merged_map_topic,
            p.world_frame,
            self._node.stamp(),
        )
        for component in msg.components:
            component.map_topic = self._node.resolve_topic_name(component.map_topic)
        return msg

    def _publish_maps(self) -> None:
        names = self._session.known.names
        self._publishing.maps(self._session.merge(), {named.number for named in names}, self._node.stamp())
        for frame, problem in self._session.merged.problems.items():
            self._warn(("merge", frame), f"the merged map in {frame!r} is not up to date: {problem}")

    def _publish_diagnostics(self, now: float) -> None:
        self._publishing.diagnostics(
            diagnostics_message(
                self._node.get_name(),
                self._message(),
                self._session.robots.all(),
                self._tree.problems,
                self._error,
                now,
                self._node.stamp(),
            )
        )

    def _estimate_failed(self, error: Exception) -> None:
        self._error = str(error) or type(error).__name__
        self._warn("estimate", f"the estimate failed, the last one stays: {self._error}")

    def _merge_failed(self, error: Exception) -> None:
        self._warn("merge", f"the merged map could not be made: {str(error) or type(error).__name__}")

    def _warn(self, key: Hashable, sentence: str) -> None:
        if self._throttle.passes(key, time.monotonic()):
            self._log.warning(sentence)
