"""Known poses, priors and pins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from mapmeld_msgs.srv import PinRobot, UnpinRobot
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

import rooms
from graph import Graph
from mapmeld import se2


def init_pose(robot: str, x: float, y: float, yaw: float, **sigma: float) -> dict[str, float]:
    values = {"x": x, "y": y, "z": 0.0, "yaw": yaw, **sigma}
    return {f"/{robot}/map_merge/init_pose_{key}": float(value) for key, value in values.items()}


def assert_at(
    graph: Graph, robot: str, pose: tuple[float, float, float], metres: float, radians: float
) -> None:
    parent, found = graph.tree()[f"{robot}/map"]
    assert parent == "world"
    assert math.hypot(found[0] - pose[0], found[1] - pose[1]) < metres, (found, pose)
    assert abs(se2.wrap(found[2] - pose[2])) < radians, (found, pose)


def test_known_poses_are_metres_and_radians_with_their_yaw(graph: Graph) -> None:
    """The documentation of multirobot_map_merge: the map frame in the world frame. Both maps lie where it
    says."""
    fleet = graph.fleet()
    graph.node(**init_pose("left", 3.0, -1.0, 0.5), **init_pose("hall", -20.0, 4.0, -2.0))
    for grid in (rooms.building()[0], rooms.hall()):
        graph.publish(fleet, grid)
    estimate = graph.wait_status(left="pinned", hall="pinned")
    assert len(estimate.components) == 1
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    assert_at(graph, "left", (3.0, -1.0, 0.5), 1e-6, 1e-6)
    assert_at(graph, "hall", (-20.0, 4.0, -2.0), 1e-6, 1e-6)
    # Both maps are in the merged map, in the world frame.
    msg = graph.wait_map(accept=lambda m: m.info.width * m.info.resolution > 15)
    from mapmeld_ros.conversions import grid_from_message

    merged = grid_from_message(msg, "")
    walls = merged.cell_centers(*np.nonzero(merged.data == 100))
    for grid, T in ((rooms.building()[0], (3.0, -1.0, 0.5)), (rooms.hall(), (-20.0, 4.0, -2.0))):
        for row, col in np.argwhere(grid.data == 100)[::50]:
            at = se2.apply(T, grid.cell_centers(np.array([row]), np.array([col])))
            assert np.hypot(*(walls - at).T).min() < 0.15


def test_the_old_behaviour_is_a_flag(graph: Graph) -> None:
    """In cells, inverted, about the grid's corner."""
    fleet = graph.fleet()
    graph.node(legacy_init_poses=True, **init_pose("hall", 100.0, 20.0, math.pi / 2))
    hall = rooms.hall()
    graph.publish(fleet, hall)
    graph.wait_status(hall="pinned")
    graph.wait("the transform", graph.tree)
    corner = se2.apply(graph.tree()["hall/map"][1], np.array([hall.origin[:2]]))
    expected = se2.apply(se2.inverse((10.0, 2.0, math.pi / 2)), np.zeros((1, 2)))
    np.testing.assert_allclose(corner, expected, atol=1e-6)


def test_known_and_unknown_poses_are_mixed(graph: Graph) -> None:
    """Left is known, the middle is found by its walls, in the same world; the hall belongs nowhere."""
    fleet = graph.fleet()
    graph.node(**init_pose("left", *rooms.TRUTH["left"]))
    for grid in (*rooms.building()[:2], rooms.hall()):
        graph.publish(fleet, grid)
    graph.wait_status(left="pinned", middle="merged", hall="no evidence")
    graph.wait("three transforms", lambda: len(graph.tree()) == 3)
    assert_at(graph, "left", rooms.TRUTH["left"], 1e-6, 1e-6)
    assert_at(graph, "middle", rooms.TRUTH["middle"], 0.15, 0.03)
    assert graph.tree()["hall/map"][0] == "world_hall"


def test_a_prior_is_evidence_that_walls_correct(graph: Graph) -> None:
    """Half a metre and 0.1 rad off, and said to be uncertain by so much: the walls decide."""
    fleet = graph.fleet()
    x, y, yaw = rooms.TRUTH["middle"]
    graph.node(
        **init_pose("left", *rooms.TRUTH["left"]),
        **init_pose("middle", x + 0.4, y - 0.3, yaw + 0.1, sigma_xy=0.5, sigma_yaw=0.15),
        **init_pose("hall", -30.0, 0.0, 1.0, sigma_xy=0.5, sigma_yaw=0.1),
    )
    for grid in (*rooms.building()[:2], rooms.hall()):
        graph.publish(fleet, grid)
    graph.wait_status(left="pinned", middle="merged", hall="prior")
    graph.wait("three transforms", lambda: len(graph.tree()) == 3)
    assert_at(graph, "middle", rooms.TRUTH["middle"], 0.15, 0.03)
    # No wall says anything of the hall: it stands where it was said to, in the world.
    assert_at(graph, "hall", (-30.0, 0.0, 1.0), 0.01, 0.01)
    (hall,) = [r for r in graph.estimates[-1].robots if r.robot == "hall"]
    covariance = np.array(hall.pose.covariance).reshape(6, 6)
    assert covariance[0, 0] == pytest.approx(0.25, rel=0.2)
    assert covariance[5, 5] == pytest.approx(0.01, rel=0.2)


def test_known_init_poses_false_leaves_them_aside(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(known_init_poses=False, **init_pose("hall", 7.0, 8.0, 1.0))
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="no evidence")


def test_half_a_pose_is_named_and_the_walls_place_the_robot(graph: Graph) -> None:
    fleet = graph.fleet()
    node = graph.node(**{"/hall/map_merge/init_pose_x": 1.0})
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="no evidence")
    assert "/hall/map_merge/init_pose_y: is missing" in node.said()


def test_a_known_pose_may_change_while_the_node_runs(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(**init_pose("hall", 1.0, 2.0, 0.0))
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="pinned")
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=5.0)
    answer = graph.call(
        SetParameters,
        "/map_merge/set_parameters",
        parameters=[Parameter(name="/hall/map_merge/init_pose_x", value=value)],
    )
    assert answer.results[0].successful, answer
    graph.wait("the new pose", lambda: graph.tree().get("hall/map") == ("world", (5.0, 2.0, 0.0)))


def test_a_known_pose_may_change_during_a_pause(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(**init_pose("hall", 1.0, 2.0, 0.0))
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="pinned")
    service, pause = "/map_merge/change_state", Transition.TRANSITION_DEACTIVATE
    assert graph.call(ChangeState, service, transition=Transition(id=pause)).success
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=5.0)
    changes = [Parameter(name="/hall/map_merge/init_pose_x", value=value)]
    answer = graph.call(SetParameters, "/map_merge/set_parameters", parameters=changes)
    assert answer.results[0].successful, answer
    go_on = Transition(id=Transition.TRANSITION_ACTIVATE)
    assert graph.call(ChangeState, service, transition=go_on).success
    graph.wait("the new pose", lambda: graph.tree().get("hall/map") == ("world", (5.0, 2.0, 0.0)))


def test_a_known_pose_gives_the_same_world_after_twenty_restarts(graph: Graph) -> None:
    """Maps that are there before the node, and are heard in whatever order."""
    fleet = graph.fleet()
    pose = (3.0, -1.0, 0.5)
    for grid in rooms.building():
        graph.publish(fleet, grid)
    trees = []
    for k in range(20):
        graph.estimates.clear()
        graph.links["/tf_static"].clear()
        node = graph.node(f"node{k}", **init_pose("right", *pose))
        graph.wait_status(left="merged", middle="merged", right="pinned")
        graph.wait("three transforms", lambda: len(graph.tree()) == 3)
        assert_at(graph, "right", pose, 1e-6, 1e-6)
        trees.append(graph.tree())
        assert node.stop() == 0
        graph.processes.remove(node)
    for tree in trees:
        for frame, (parent, found) in trees[0].items():
            assert tree[frame][0] == parent == "world"
            np.testing.assert_allclose(tree[frame][1], found, atol=0.02)


def test_pin_and_unpin(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node()
    for grid in rooms.building()[:2]:
        graph.publish(fleet, grid)
    graph.wait_status(left="merged", middle="merged")
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)

    refused = graph.call(PinRobot, "/map_merge/pin", robot="nobody", x=1.0)
    assert not refused.success
    assert "left, middle" in refused.message
    refused = graph.call(UnpinRobot, "/map_merge/unpin", robot="left")
    assert (refused.success, refused.message) == (False, "'left' is not pinned")
    refused = graph.call(PinRobot, "/map_merge/pin", robot="left", x=math.nan)
    assert not refused.success
    assert "finite" in refused.message

    answer = graph.call(PinRobot, "/map_merge/pin", robot="/left", x=10.0, y=-5.0, yaw=1.0)
    assert answer.success, answer.message
    graph.wait_status(left="pinned", middle="merged")
    graph.wait("the pin", lambda: graph.tree()["left/map"] == ("world", pytest.approx((10.0, -5.0, 1.0))))
    # The middle follows: its walls still say where it lies to the left.
    graph.wait("that the other follows", lambda: follows(graph))

    answer = graph.call(PinRobot, "/map_merge/pin", robot="middle", at_current_pose=True)
    assert answer.success, answer.message
    graph.wait_status(left="pinned", middle="pinned")
    answer = graph.call(UnpinRobot, "/map_merge/unpin", robot="left")
    assert answer.success, answer.message
    graph.wait_status(left="merged", middle="pinned")


def follows(graph: Graph) -> bool:
    tree = graph.tree()
    left, middle = (np.array(tree[f"{name}/map"][1]) for name in ("left", "middle"))
    metres, radians = rooms.relative_error(left, middle, "left", "middle")
    return metres < 0.1 and radians < 0.02
