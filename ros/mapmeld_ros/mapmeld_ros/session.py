"""What the node knows and does, without the graph: robots, their known poses, estimates, merged maps."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg

from mapmeld import Estimate, Estimator, OccupancyGrid, Prior, load_config
from mapmeld.config import effective_config, overlay
from mapmeld.errors import MapmeldError
from mapmeld.holding import Hold
from mapmeld_ros.components import ComponentNames, Named
from mapmeld_ros.known_poses import BadKnownPose, KnownPose, known_pose, legacy_pose
from mapmeld_ros.merged_maps import MergedMaps, is_same
from mapmeld_ros.parameters import Parameters
from mapmeld_ros.robots import Robots

# Doubt that no link has to be below.
_LEAST_DOUBT = 1e-9


class Refused(Exception):
    """A request that cannot be met; the message says why and what to do."""


@dataclass(frozen=True)
class Known:
    """An estimate and the names of its components."""

    estimate: Estimate
    names: tuple[Named, ...]


class MergeSession:
    """Robots that join, send maps and leave, over one estimator.

    get_parameter: the value of a parameter by name, None for one that is not set. Raises ConfigError for a
    config_file that cannot be used.
    """

    def __init__(self, parameters: Parameters, get_parameter: Callable[[str], Any]) -> None:
        self._parameters = parameters
        self._get_parameter = get_parameter
        options = merge_options(parameters)
        self.estimator = Estimator(options, hold(parameters))
        self.robots = Robots(parameters.max_map_cells)
        self.merged = MergedMaps(options)
        self._names = ComponentNames(parameters.world_frame)
        # Robots that are pinned, by users or because their known poses are exact.
        self._pinned: set[str] = set()
        self._pinned_by_user: set[str] = set()
        # Robots whose known poses stand, and exact ones that users freed robots from.
        self._posed: set[str] = set()
        self._freed: dict[str, KnownPose] = {}
        self._doubts: dict[str, str] = {}
        self._is_settled = False
        self._known = Known(Estimate((), (), None, 0, 0.0), ())

    @property
    def is_settled(self) -> bool:
        """Whether the estimator has been told of the first maps."""
        return self._is_settled

    @property
    def known(self) -> Known:
        """The newest estimate; one without robots before the first."""
        return self._known

    def take_doubts(self) -> dict[str, str]:
        """What known poses that were placed since the last call say that may not be meant, by robot."""
        doubts, self._doubts = self._doubts, {}
        return doubts

    def take_estimate(self, estimate: Estimate) -> Known:
        """Makes an estimate the newest one."""
        self._known = Known(estimate, self._names.name(estimate))
        return self._known

    def settle(self) -> None:
        """Tells the estimator of the first maps, in the order of the robots' names.

        Without known poses the world is the map frame of the robot that comes first: so it is the same
        robot's after every start, whichever message was faster. Raises BadKnownPose after all have been told.
        """
        self._is_settled = True
        problems = []
        for name, grid in sorted(self.grids().items()):
            self.estimator.update(grid)
            try:
                self.place_known(name)
            except BadKnownPose as error:
                problems.append(str(error))
        if problems:
            raise BadKnownPose("; ".join(problems))

    def take_map(self, name: str, msg: OccupancyGridMsg, now: float) -> bool:
        """Takes a whole map; False when nothing has changed or the robot has left.

        Raises BadMessage and BadKnownPose.
        """
        return self._take(name, lambda: self.robots.take_map(name, msg, now))

    def take_update(self, name: str, msg: OccupancyGridUpdate, now: float) -> bool:
        """Takes a part of a map; False when nothing has changed or there is no whole one.

        Raises BadMessage.
        """
        return self._take(name, lambda: self.robots.take_update(name, msg, now))

    def leave(self, name: str) -> None:
        """Forgets a robot and its pin."""
        robot = self.robots.leave(name)
        self._pinned_by_user.discard(name)
        self._pinned.discard(name)
        self._posed.discard(name)
        self._freed.pop(name, None)
        if robot is not None and robot.grid is not None and self._is_settled:
            self.estimator.remove(name)

    def place_known(self, name: str) -> KnownPose | None:
        """Tells the estimator the robot's known pose, if it has one and no user pinned the robot or freed it
        from that one.

        Raises BadKnownPose, which says too what becomes of the robot: an earlier pose stays.
        """
        robot = self.robots.get(name)
        if robot is None or robot.grid is None or name in self._pinned_by_user:
            return None
        try:
            found = self._known_pose(name)
        except BadKnownPose as error:
            rest = "its earlier pose stays" if name in self._posed else "its map is placed by its walls"
            raise BadKnownPose(f"{error}; {rest}") from None
        if found is not None and self._freed.get(name) == found:
            return None
        self._freed.pop(name, None)
        if found is None:
            self._posed.discard(name)
            self._let_go(name)
            self.estimator.set_prior(name, None)
            return None
        self._posed.add(name)
        if found.doubt:
            self._doubts[name] = found.doubt
        is_legacy = self._parameters.legacy_init_poses
        pose = legacy_pose(found.pose, robot.grid) if is_legacy else found.pose
        if found.sigma is None:
            self.estimator.set_prior(name, None)
            self.estimator.pin(name, pose)
            self._pinned.add(name)
        else:
            self._let_go(name)
            self.estimator.set_prior(name, Prior(pose, found.sigma))
        return found

    def pin(self, name: str, pose: tuple[float, float, float] | None) -> tuple[float, float, float]:
        """Pins a robot at T_world_map, None: where it stands; that pose. Raises Refused."""
        self._robot_with_map(name)
        if pose is None:
            pose = self._pose_in_world(name)
        try:
            self.estimator.pin(name, pose)
        except MapmeldError as error:
            raise Refused(str(error)) from None
        self._pinned.add(name)
        self._pinned_by_user.add(name)
        return pose

    def unpin(self, name: str) -> None:
        """Lets the walls place a robot, and its known pose where that has standard deviations. Raises
        Refused."""
        self._robot_with_map(name)
        if name not in self._pinned:
            raise Refused(f"{name!r} is not pinned")
        self._let_go(name)
        self._posed.discard(name)
        # Its walls are what places it if its known pose is of no use.
        with contextlib.suppress(BadKnownPose):
            known = self._known_pose(name)
            if known is not None and known.sigma is None:
                # Nothing but another pose pins it again, least of all its own map that grows.
                self._freed[name] = known
            self.place_known(name)

    def grids(self) -> dict[str, OccupancyGrid]:
        """The robots' newest maps, those that joined first in front."""
        return {r.name: r.grid for r in self.robots.all() if r.grid is not None}

    def merge(self) -> list[tuple[Named, OccupancyGrid]]:
        """The merged maps that have changed since the last call."""
        known = self._known
        return self.merged.changed(known.estimate, known.names, self.grids())

    def _take(self, name: str, take: Callable[[], OccupancyGrid | None]) -> bool:
        before = self.robots.get(name)
        grid = take()
        if grid is None or before is None:
            return False
        if before.grid is not None and is_same(before.grid, grid):
            return False
        if not self._is_settled:
            return True
        self.estimator.update(grid)
        # Legacy poses are about the corner of the grid.
        is_legacy = self._parameters.legacy_init_poses
        if before.grid is None or (is_legacy and before.grid.origin != grid.origin):
            self.place_known(name)
        return True

    def _known_pose(self, name: str) -> KnownPose | None:
        p = self._parameters
        if not p.known_init_poses:
            return None
        return known_pose(name, self._get_parameter, p.init_pose_sigma_xy, p.init_pose_sigma_yaw)

    def _let_go(self, name: str) -> None:
        if name in self._pinned:
            self.estimator.unpin(name)
        self._pinned.discard(name)
        self._pinned_by_user.discard(name)

    def _robot_with_map(self, name: str) -> None:
        robot = self.robots.get(name)
        if robot is None:
            known = ", ".join(r.name for r in self.robots.all()) or "none"
            raise Refused(f"no robot is called {name!r}; there are: {known}")
        if robot.grid is None:
            raise Refused(f"{name!r} has sent no good map yet; wait for one")

    def _pose_in_world(self, name: str) -> tuple[float, float, float]:
        known = self._known
        for r in known.estimate.robots:
            if r.name != name or r.component is None or r.T_world_map is None:
                continue
            if known.estimate.components[r.component].is_world:
                x, y, theta = (float(v) for v in r.T_world_map)
                return x, y, theta
        raise Refused(f"{name!r} is not placed in the world yet; give x, y and yaw")


def hold(parameters: Parameters) -> Hold:
    """How clear a new link must be while maps grow, by estimation_confidence as in merge_options."""
    doubt = (1.0 - Hold().join) ** parameters.estimation_confidence
    # Nothing is told as likely as one, which the doubt would make of it in floating point.
    return Hold(join=1.0 - max(doubt, _LEAST_DOUBT))


def merge_options(parameters: Parameters) -> Mapping[str, Any]:
    """The options of the merge: config_file's, and what estimation_confidence asks.

    Confidence c leaves (1 - p)^c of doubt, where p is the option evidence.min_probability: 1 is p itself.
    """
    options = load_config(parameters.config_file) if parameters.config_file else {}
    usual = effective_config(options)["evidence"]["min_probability"]
    wanted = 1.0 - (1.0 - usual) ** parameters.estimation_confidence
    if parameters.estimation_confidence == 1.0:
        return options
    return overlay(options, {"evidence": {"min_probability": wanted}})
