"""One map and one tree out of several robots, over a real graph."""

from __future__ import annotations

import numpy as np
import pytest

import rooms
from graph import Graph
from mapmeld import se2
from mapmeld.config import default_config
from mapmeld_ros.conversions import grid_from_message


def placed(graph: Graph, robot: str) -> np.ndarray:
    parent, pose = graph.tree()[f"{robot}/map"]
    assert parent == "world"
    return np.array(pose)


def assert_right(graph: Graph, a: str, b: str) -> None:
    metres, radians = rooms.relative_error(placed(graph, a), placed(graph, b), a, b)
    assert metres < 0.1
    assert radians < 0.02


def test_three_robots_are_one_map_and_one_tree(graph: Graph) -> None:
    fleet = graph.fleet()
    node = graph.node()
    for grid in rooms.building():
        graph.publish(fleet, grid)
    estimate = graph.wait_status(left="merged", middle="merged", right="merged")
    graph.wait("three transforms", lambda: len(graph.tree()) == 3)
    assert_right(graph, "left", "middle")
    assert_right(graph, "left", "right")

    assert [(list(c.robots), c.is_world, c.frame, c.map_topic) for c in estimate.components] == [
        (["left", "middle", "right"], True, "world", "/map")
    ]
    for robot in estimate.robots:
        assert robot.has_pose
        assert robot.component_frame == "world"
        assert default_config()["evidence"]["min_probability"] <= robot.probability <= 1.0
        assert robot.reason
        pose = robot.pose.pose
        assert (pose.position.x, pose.position.y) == tuple(placed(graph, robot.robot)[:2])

    # The map holds what all three saw: the outer walls of the whole building, at their places.
    msg = graph.wait_map(accept=lambda m: m.info.width * m.info.resolution > 14)
    assert msg.header.frame_id == "world"
    assert msg.header.stamp.sec > 0
    merged = grid_from_message(msg, "merged")
    truth = se2.compose(placed(graph, "left"), se2.inverse(rooms.TRUTH["left"]))
    rows, cols = np.nonzero(merged.data == 100)
    walls = merged.cell_centers(rows, cols)
    for point in [(0.1, 4.0), (14.1, 5.0), (7.0, 0.1), (7.0, 8.1), (9.9, 4.0)]:
        at = se2.apply(truth, np.array([point]))
        assert np.hypot(*(walls - at).T).min() < 0.2, point
    assert "WARN" not in node.said()


def test_latecomers_get_the_newest_map(graph: Graph) -> None:
    """The merged map, the estimate and the transforms are latched: reliable, transient_local, depth 1."""
    fleet = graph.fleet()
    graph.node()
    for grid in rooms.building():
        graph.publish(fleet, grid)
    graph.wait_status(left="merged", middle="merged", right="merged")
    newest = graph.wait_map(accept=lambda m: m.info.width * m.info.resolution > 14)
    graph.spin(0.3)
    newest = graph.maps["/map"][-1]
    late = []
    from nav_msgs.msg import OccupancyGrid

    from mapmeld_ros.qos import LATCHED

    graph.ros.create_subscription(OccupancyGrid, "/map", late.append, LATCHED)
    graph.wait("the map again", lambda: late)
    assert late[0] == newest
    (info,) = graph.ros.get_publishers_info_by_topic("/map")
    assert info.qos_profile.durability.name == "TRANSIENT_LOCAL"
    assert info.qos_profile.reliability.name == "RELIABLE"


@pytest.mark.parametrize("durability", ["volatile", "transient_local"])
@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
def test_every_publisher_is_heard(graph: Graph, durability: str, reliability: str) -> None:
    fleet = graph.fleet()
    grid = rooms.hall()
    qos = {"durability": durability, "reliability": reliability}
    graph.publish(fleet, grid, **qos)
    node = graph.node()
    if durability == "volatile" or reliability == "best_effort":
        # Such a publisher sends nothing again: what came before the node is gone.
        graph.wait("the robot", lambda: "joins" in node.said())
        graph.spin(0.5)
        graph.publish(fleet, grid)
    msg = graph.wait_map()
    assert (grid_from_message(msg, "").data == 100).sum() == (grid.data == 100).sum()
