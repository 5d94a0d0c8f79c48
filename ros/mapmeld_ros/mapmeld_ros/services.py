"""The node's services: save, re-estimate, pin and unpin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mapmeld_msgs.srv import PinRobot, SaveMaps, UnpinRobot
from rclpy.node import Node
from std_srvs.srv import Trigger

from mapmeld.errors import MapmeldError
from mapmeld_ros.discovery import robot_name
from mapmeld_ros.saving import save
from mapmeld_ros.session import MergeSession, Refused


class Services:
    """Answers on ~/save, ~/re_estimate, ~/pin and ~/unpin.

    estimate: asks for an estimate at once. re_estimate: the same, taking the maps for done. Both are False
    while the node is not active.
    """

    def __init__(
        self,
        node: Node,
        session: MergeSession,
        estimate: Callable[[], bool],
        re_estimate: Callable[[], bool],
    ) -> None:
        self._node, self._session = node, session
        self._estimate, self._re_estimate = estimate, re_estimate
        self._services = [
            node.create_service(SaveMaps, "~/save", self._save),
            node.create_service(Trigger, "~/re_estimate", self._trigger),
            node.create_service(PinRobot, "~/pin", self._pin),
            node.create_service(UnpinRobot, "~/unpin", self._unpin),
        ]

    def close(self) -> None:
        for service in self._services:
            self._node.destroy_service(service)

    def _save(self, request: SaveMaps.Request, response: SaveMaps.Response) -> SaveMaps.Response:
        session = self._session
        try:
            response.files = save(
                request.folder, request.force, session.known, session.merged.by_frame(), session.robots.all()
            )
            response.success, response.message = (
                True,
                f"wrote {len(response.files)} files to {Path(request.folder).absolute()}",
            )
        except (Refused, MapmeldError) as error:
            # Here the command line's option is a field.
            response.message = str(error).replace("--force", "the field force: true")
        return response

    def _trigger(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._re_estimate()
        response.message = "an estimate has begun" if response.success else "the node is not active"
        return response

    def _pin(self, request: PinRobot.Request, response: PinRobot.Response) -> PinRobot.Response:
        pose = None if request.at_current_pose else (request.x, request.y, request.yaw)
        try:
            x, y, yaw = self._session.pin(robot_name(request.robot), pose)
        except Refused as error:
            response.message = str(error)
            return response
        self._estimate()
        response.success = True
        response.message = f"{request.robot} is pinned at x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad"
        return response

    def _unpin(self, request: UnpinRobot.Request, response: UnpinRobot.Response) -> UnpinRobot.Response:
        try:
            self._session.unpin(robot_name(request.robot))
        except Refused as error:
            response.message = str(error)
            return response
        self._estimate()
        response.success, response.message = True, f"{request.robot} is placed by its walls"
        return response
