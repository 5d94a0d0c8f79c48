"""Holds everything that the node says of where robots are against the truth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Quaternion, Vector3
from mapmeld_msgs.msg import MergeEstimate
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

import bench_cases
from mapmeld import se2
from mapmeld.known_cells import known_cells
from mapmeld_ros.qos import ALL_LATCHED

WRONG_M, WRONG_DEG = 0.5, 5.0

Places = Mapping[str, tuple[str, np.ndarray]]
"""Robot to its frame and T_frame_map."""


class Witness:
    """Hears all transforms and estimates of a node, and judges each when it comes.

    Errors are those of the relative poses of robots in one frame: metres at the middle of the finished map's
    known cells, and degrees. Map frames are called <robot>/map.
    """

    def __init__(self, node: Node, case: bench_cases.Case) -> None:
        self._truth: dict[tuple[str, str], np.ndarray] = {
            (robot(p["a"]), robot(p["b"])): np.array(p["T_a_b"]) for p in case.truth["pairs"]
        }
        self._centres = {robot(g.name): np.array(known_cells(g).centre) for g in case.maps}
        self.when = ""
        """Goes with what is found from now on."""
        self.transforms = self.estimates = 0
        self.worst_m = self.worst_deg = 0.0
        self.wrong: list[str] = []
        self.seconds: list[float] = []
        self.newest: MergeEstimate | None = None
        node.create_subscription(TFMessage, "/tf_static", self._hear_transforms, ALL_LATCHED)
        node.create_subscription(TFMessage, "/tf", self._hear_transforms, QoSProfile(depth=1000))
        node.create_subscription(MergeEstimate, "/map_merge/estimate", self._hear_estimate, ALL_LATCHED)

    def said(self) -> str:
        """In short."""
        return (
            f"{self.transforms} transforms, {self.estimates} estimates, {len(self.wrong)} wrong, "
            f"worst {self.worst_m:.2f} m {self.worst_deg:.1f} deg"
        )

    def _hear_transforms(self, msg: TFMessage) -> None:
        self.transforms += len(msg.transforms)
        places = {}
        for t in msg.transforms:
            places[t.child_frame_id.removesuffix("/map")] = (
                t.header.frame_id,
                _pose(t.transform.translation, t.transform.rotation),
            )
        self._judge("transform", places)

    def _hear_estimate(self, msg: MergeEstimate) -> None:
        # What is published when a robot joins is the estimate from before.
        if self.newest is None or msg.seconds != self.newest.seconds:
            self.estimates += 1
            self.seconds.append(msg.seconds)
        self.newest = msg
        places = {
            r.robot: (r.component_frame, _pose(r.pose.pose.position, r.pose.pose.orientation))
            for r in msg.robots
            if r.has_pose
        }
        self._judge("estimate", places)

    def _judge(self, what: str, places: Places) -> None:
        for a, b in itertools.permutations(sorted(places), 2):
            if (a, b) not in self._truth or places[a][0] != places[b][0]:
                continue
            true, found = self._truth[a, b], se2.compose(se2.inverse(places[a][1]), places[b][1])
            centre = self._centres[b]
            metres = math.hypot(*(se2.apply(found, centre) - se2.apply(true, centre)))
            degrees = math.degrees(abs(se2.wrap(found[2] - true[2])))
            self.worst_m, self.worst_deg = max(self.worst_m, metres), max(self.worst_deg, degrees)
            if metres > WRONG_M or degrees > WRONG_DEG:
                self.wrong.append(
                    f"{self.when}, {what}: {a} to {b} is {metres:.2f} m, {degrees:.1f} degrees off"
                )


def robot(map_name: str) -> str:
    """Name of the robot that has a case's map: ROS allows none that begins with a digit."""
    return f"robot_{map_name}"


def _pose(at: Vector3 | Point, q: Quaternion) -> Any:
    return np.array([at.x, at.y, 2.0 * math.atan2(q.z, q.w)])
