"""The node map_merge: parameters, lifecycle and wiring."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from builtin_interfaces.msg import Time
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from mapmeld.errors import MapmeldError
from mapmeld_ros import parameters as node_parameters
from mapmeld_ros.active import Active
from mapmeld_ros.known_poses import AXES, SIGMAS, parameter_name
from mapmeld_ros.publishing import Publishing
from mapmeld_ros.services import Services
from mapmeld_ros.session import MergeSession


class MapMerge(LifecycleNode):
    """Merges the maps of robots: a drop-in for multirobot_map_merge, with places that can be trusted.

    Unconfigured it has parameters only. Configured it has its publishers and services; active it listens to
    robots, estimates and publishes. With the parameter autostart it becomes active by itself.

    kwargs: as of rclpy's Node, but the name; a component container passes its context so.
    """

    def __init__(self, node_name: str = "map_merge", **kwargs: Any) -> None:
        # Before the node is made: what fails on the way is destroyed.
        self._session: MergeSession | None = None
        self._publishing: Publishing | None = None
        self._answers: Services | None = None
        self._active: Active | None = None
        self._is_declaring = False
        # Poses of robots have names that nobody knows before the robots come.
        super().__init__(node_name, allow_undeclared_parameters=True, **kwargs)
        self._in_effect = node_parameters.declare(self)
        for name, value in vars(self._in_effect).items():
            if problem := node_parameters.problem(name, value):
                raise ValueError(f"parameter {problem}")
        # Those of a file or the command line are nowhere else before somebody asks for them by name.
        self._warn_of_unknown(self._parameter_overrides)
        self.add_on_set_parameters_callback(self._may_set)
        self.add_post_set_parameters_callback(self._was_set)
        if self._in_effect.autostart:
            # From the executor, so that a container or a test has the node before it does anything.
            self._start_timer = self.create_timer(
                0.0, self._start, clock=Clock(clock_type=ClockType.STEADY_TIME)
            )

    @property
    def parameters(self) -> node_parameters.Parameters:
        """The values in effect."""
        return self._in_effect

    def stamp(self) -> Time:
        """The time now, as messages have it: of the simulation with use_sim_time."""
        return self.get_clock().now().to_msg()

    def known_pose_parameter(self, name: str) -> Any:
        """The value of a parameter that only some robots have; None when it is not set."""
        if not self.has_parameter(name):
            # What a file or the command line says of it takes effect when it is declared.
            self._is_declaring = True
            try:
                self.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True))
            finally:
                self._is_declaring = False
        return self.get_parameter(name).value

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._in_effect = node_parameters.read(self)
        try:
            self._session = MergeSession(self._in_effect, self.known_pose_parameter)
        except MapmeldError as error:
            self.get_logger().error(
                f"config_file: {error}; the node stays unconfigured: set config_file right and configure it "
                "(ros2 lifecycle set), or start it anew"
            )
            return TransitionCallbackReturn.FAILURE
        self._publishing = Publishing(
            self, self._in_effect.merged_map_topic, self._in_effect.publish_tf == "static"
        )
        self._answers = Services(self, self._session, self._estimate, self._re_estimate)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        assert self._session is not None
        assert self._publishing is not None
        self._active = Active(self, self._session, self._publishing)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._clean_up()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._clean_up()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._clean_up()
        return super().on_error(state)

    def destroy_node(self) -> None:
        self._clean_up()
        super().destroy_node()

    def _start(self) -> None:
        self._start_timer.cancel()
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def _deactivate(self) -> None:
        if self._active is not None:
            self._active.stop()
            self._active = None

    def _clean_up(self) -> None:
        self._deactivate()
        for part in (self._answers, self._publishing):
            if part is not None:
                part.close()
        self._session = self._publishing = self._answers = None

    def _estimate(self, maps_are_done: bool = False) -> bool:
        if self._active is None:
            return False
        self._active.request_estimate(maps_are_done=maps_are_done)
        return True

    def _re_estimate(self) -> bool:
        return self._estimate(maps_are_done=True)

    def _may_set(self, changes: list[Parameter[Any]]) -> SetParametersResult:
        for change in changes:
            if problem := node_parameters.problem(change.name, change.value):
                return SetParametersResult(successful=False, reason=problem)
            is_fixed = change.name in vars(self._in_effect) and change.name not in node_parameters.LIVE
            if is_fixed and self._session is not None:
                reason = f"{change.name}: can be set while the node is unconfigured; clean it up first"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True, reason="")

    def _was_set(self, changes: list[Parameter[Any]]) -> None:
        if self._is_declaring:
            return
        self._in_effect = node_parameters.read(self)
        names = {change.name for change in changes}
        self._warn_of_unknown(names)
        if self._active is None or self._session is None:
            return
        for robot in self._session.robots.all():
            if names & {parameter_name(robot.name, what) for what in (*AXES, *SIGMAS)}:
                self._active.pose_changed(robot.name)

    def _warn_of_unknown(self, names: Iterable[str]) -> None:
        for name in sorted(names):
            if sentence := node_parameters.unknown(name):
                self.get_logger().warning(sentence)
