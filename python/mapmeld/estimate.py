"""What an estimator is told beside maps, and what it tells: where every robot is, as far as its maps say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_yaml import one_line
from mapmeld.result import MergeResult

if TYPE_CHECKING:
    from mapmeld.drawing import Drawing


@dataclass(frozen=True)
class Prior:
    """What is known of a map's pose in the world before any wall is compared: a Gaussian.

    T_world_map: (x, y, theta), metres and radians: takes map coordinates to the world frame. All priors and
        pins of one estimator are told in the same world frame.
    sigma: standard deviations (sx, sy, stheta) of its error along the world's axes, metres and radians,
        positive.

    Raises MapmeldError for anything but three finite numbers, and for a sigma that is not positive.
    """

    T_world_map: tuple[float, float, float]
    sigma: tuple[float, float, float]

    def __init__(self, T_world_map: Sequence[float], sigma: Sequence[float]) -> None:
        object.__setattr__(self, "T_world_map", checked_pose(T_world_map, "prior: T_world_map"))
        deviations = _three(sigma, "prior: sigma", "(sx, sy, stheta)")
        if min(deviations) <= 0:
            raise MapmeldError(f"prior: sigma must be positive, got {deviations}; pin a pose that is exact")
        object.__setattr__(self, "sigma", deviations)


@dataclass(frozen=True, eq=False)
class RunnerUp:
    """The next best place of a robot's map.

    T_world_map: float64 (3,), takes map coordinates to the frame of `component`, an index into the estimate's
        components: the robot's own one, or, of a robot whose place among others is not sure, theirs.
    probability: 0..1.
    """

    T_world_map: NDArray[np.float64]
    probability: float
    component: int


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """Where a robot's map lies.

    component: index into the estimate's components; None for a blank map.
    T_world_map: (x, y, theta), float64 (3,), metres and radians: takes map coordinates to the component's
        frame. None for a blank map: what cannot be placed is never told as the identity.
    covariance: float64 (3, 3), of (x, y, theta): relative to the component's anchor, whose own is zero; in a
        world that priors give, of the pose in that world. None for a blank map.
    probability: that the map lies there, 0..1; of an ambiguous map that of its likeliest place among others.
    status: "merged", "prior" (placed by its prior alone), "pinned", "ambiguous" (it belongs to others, but
        more than one place is probable), "no evidence" (no other map shares enough walls with it) or "blank".
        Robots that are ambiguous or without evidence are components of their own.
    reason: why it stands so, a sentence with its numbers.
    runner_up: the next best place, if some hypothesis has one.
    placements: how often the map was put somewhere else by more than noise: into the frame of others, or
        elsewhere in a frame. 0 for a robot that is its component's anchor from the start.
    """

    name: str
    component: int | None
    T_world_map: NDArray[np.float64] | None
    covariance: NDArray[np.float64] | None
    probability: float
    status: str
    reason: str
    runner_up: RunnerUp | None
    placements: int


@dataclass(frozen=True, eq=False)
class EstimatedComponent:
    """Robots that are linked: their maps lie in one frame.

    names: sorted. anchor: the robot whose held pose defines the frame. is_world: true for the one component
        that lives in the world frame.
    drawing: draws `merged` when somebody looks at it; None where there is nothing to draw it from.
    """

    names: tuple[str, ...]
    anchor: str
    is_world: bool
    drawing: Drawing | None = field(default=None, repr=False)

    @property
    def merged(self) -> OccupancyGrid | None:
        """The fused map in the component's frame: yaw 0, its origin on whole multiples of the resolution, so
        that a later, larger map has the old one's cells at whole-cell offsets. It is drawn at the first look.
        None when it cannot be drawn, see `problem`."""
        return None if self.drawing is None else self.drawing.merged

    @property
    def problem(self) -> str | None:
        """Why there is no fused map: pins may put maps too far apart for one. None when there is one."""
        return None if self.drawing is None else self.drawing.problem


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where all robots are, as far as their maps say.

    robots: sorted by name; every robot known, none left out. components: those of most maps first.
    result: what the merge itself said of the maps as they are, without memory; None when there is no map.
    registered_pairs: how many pairs of maps had to be registered for this estimate; the others were known.
    seconds: wall time.
    """

    robots: tuple[RobotEstimate, ...]
    components: tuple[EstimatedComponent, ...]
    result: MergeResult | None
    registered_pairs: int
    seconds: float

    def robot(self, name: str) -> RobotEstimate:
        """The robot of that name. Raises MapmeldError when there is none."""
        for robot in self.robots:
            if robot.name == name:
                return robot
        raise MapmeldError(one_line(f"estimate: no robot is called {name!r}"))


def checked_pose(values: Any, what: str) -> tuple[float, float, float]:
    """(x, y, theta) as three finite numbers. Raises MapmeldError, naming `what`."""
    return _three(values, what, "(x, y, theta)")


def _three(values: Any, what: str, form: str) -> tuple[float, float, float]:
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not all(math.isfinite(v) for v in numbers):
        raise MapmeldError(one_line(f"{what} must be three finite numbers {form}, got {values!r}"))
    return numbers
