"""Known poses, as multirobot_map_merge documents them and as its code takes them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mapmeld import OccupancyGrid, se2
from mapmeld_ros.known_poses import BadKnownPose, KnownPose, known_pose, legacy_pose


def found(
    values: dict[str, Any], robot: str = "robot1", sigmas: tuple[float, float] = (0.0, 0.0)
) -> KnownPose | None:
    prefix = "/map_merge" if robot == "/" else f"/{robot}/map_merge"
    given = {f"{prefix}/init_pose_{key}": value for key, value in values.items()}
    return known_pose(robot, given.get, *sigmas)


def test_a_pose_is_metres_and_radians_and_exact_by_default() -> None:
    assert found({"x": 1, "y": -2.5, "z": 0.0, "yaw": 0.7}) == KnownPose((1.0, -2.5, 0.7), None)
    assert found({"x": 1.0, "y": 2.0, "yaw": 0.0}, robot="/") == KnownPose((1.0, 2.0, 0.0), None)
    assert found({}) is None


def test_standard_deviations_make_it_evidence() -> None:
    values = {"x": 1.0, "y": 2.0, "yaw": 0.5}
    assert found(values, sigmas=(0.3, 0.1)).sigma == (0.3, 0.3, 0.1)
    assert found({**values, "sigma_xy": 1, "sigma_yaw": 0.2}, sigmas=(0.3, 0.1)).sigma == (1.0, 1.0, 0.2)
    # A robot may be exact among others that are not.
    assert found({**values, "sigma_xy": 0.0}, sigmas=(0.3, 0.1)).sigma is None


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"x": 1.0}, "init_pose_y"),
        ({"y": 1.0, "yaw": 0.0}, "init_pose_x"),
        ({"x": 1.0, "y": 2.0}, "init_pose_yaw"),
        ({"x": 1.0, "y": "2", "yaw": 0.0}, "init_pose_y"),
        ({"x": math.nan, "y": 2.0, "yaw": 0.0}, "init_pose_x"),
        ({"x": True, "y": 2.0, "yaw": 0.0}, "init_pose_x"),
        ({"x": 1.0, "y": 2.0, "yaw": 0.0, "sigma_xy": -0.3, "sigma_yaw": 0.1}, "init_pose_sigma_xy"),
        ({"x": 1.0, "y": 2.0, "yaw": 0.0, "sigma_xy": 0.3, "sigma_yaw": -0.1}, "init_pose_sigma_yaw"),
    ],
)
def test_half_a_pose_is_an_error_that_names_the_parameter(values: dict[str, Any], name: str) -> None:
    with pytest.raises(BadKnownPose, match=f"/robot1/map_merge/{name}"):
        found(values)


def test_the_legacy_pose_is_in_cells_inverted_and_about_the_corner() -> None:
    grid = OccupancyGrid(np.zeros((4, 4), dtype=np.int8), 0.5, (-10.0, 3.0, 0.0))
    # The corner of the grid goes to the world by the inverse of (4 cells, 0, 90 degrees).
    T = legacy_pose((4.0, 0.0, math.pi / 2), grid)
    corner = se2.apply(T, np.array([[-10.0, 3.0]]))
    np.testing.assert_allclose(
        corner, se2.apply(se2.inverse((2.0, 0.0, math.pi / 2)), np.zeros((1, 2))), atol=1e-12
    )
    np.testing.assert_allclose(corner, [[0.0, 2.0]], atol=1e-12)
    assert math.isclose(T[2], -math.pi / 2)
