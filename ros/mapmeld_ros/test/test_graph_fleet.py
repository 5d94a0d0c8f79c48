"""Robots that come, go and come back; those that belong nowhere; a node that is killed."""

from __future__ import annotations

import signal

import numpy as np

import rooms
from graph import Fleet, Graph


def publish_building(graph: Graph, fleet: Fleet, *names: str) -> None:
    for grid in rooms.building():
        if not names or grid.name in names:
            graph.publish(fleet, grid)


def test_a_robot_that_cannot_be_placed_is_published_alone_and_never_in_the_world(graph: Graph) -> None:
    graph.hear_map("/map_2")
    fleet = graph.fleet()
    graph.node()
    publish_building(graph, fleet, "left", "middle")
    graph.wait_status(left="merged", middle="merged")
    graph.publish(fleet, rooms.hall())
    graph.publish(fleet, rooms.blank())
    estimate = graph.wait_status(hall="no evidence", blank="blank", left="merged")
    robots = {r.robot: r for r in estimate.robots}
    assert sorted(robots) == ["blank", "hall", "left", "middle"]

    hall = robots["hall"]
    assert (hall.component_frame, hall.component) == ("world_hall", 1)
    assert estimate.components[1].map_topic == "/map_2"
    assert not estimate.components[1].is_world
    assert "no " in hall.reason
    alone = graph.wait_map("/map_2")
    assert alone.header.frame_id == "world_hall"
    assert np.count_nonzero(np.array(alone.data) == 100) == np.count_nonzero(rooms.hall().data == 100)
    graph.wait("its transform", lambda: "hall/map" in graph.tree())
    assert graph.tree()["hall/map"][0] == "world_hall"

    blank = robots["blank"]
    assert not blank.has_pose
    assert blank.component == -1
    assert "blank/map" not in graph.tree()
    # The merged map has nothing of either.
    assert graph.maps["/map"][-1].header.frame_id == "world"


def test_components_become_one_when_something_links_them(graph: Graph) -> None:
    graph.hear_map("/map_2")
    fleet = graph.fleet()
    graph.node()
    # Left and right alone share too little to be told apart from chance.
    strip = rooms.view("right", (10.5, 15.0), rooms.TRUTH["right"])
    publish_building(graph, fleet, "left")
    graph.publish(fleet, strip)
    estimate = graph.wait_status(left="no evidence", right="no evidence")
    assert len(estimate.components) == 2
    assert graph.wait_map("/map_2").header.frame_id.startswith("world_")

    publish_building(graph, fleet, "middle")
    graph.publish(fleet, rooms.view("right", (5.0, 15.0), rooms.TRUTH["right"]))
    graph.wait_status(left="merged", middle="merged", right="merged")
    graph.wait("one tree", lambda: {parent for parent, _ in graph.tree().values()} == {"world"})
    graph.wait("that its own topic ends", lambda: not graph.ros.count_publishers("/map_2"))


def test_robots_join_leave_and_come_back(graph: Graph) -> None:
    staying, going = graph.fleet("staying"), graph.fleet("going")
    node = graph.node(robot_timeout=1.0)
    publish_building(graph, staying, "left")
    graph.wait_status(left="no evidence")
    publish_building(graph, going, "middle")
    graph.wait_status(left="merged", middle="merged")
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    tree = graph.tree()

    going.do(do="silence", topic="/middle/map")
    graph.wait("that it leaves", lambda: [r.robot for r in graph.estimates[-1].robots] == ["left"])
    assert "robot 'middle' leaves" in node.said()
    graph.wait("its transform to go", lambda: list(graph.tree()) == ["left/map"])
    # A latched map is as good as new: the one that is silent but there stays.
    graph.spin(1.5)
    assert [r.robot for r in graph.estimates[-1].robots] == ["left"]

    publish_building(graph, going, "middle")
    graph.wait_status(left="merged", middle="merged")
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    for frame, (parent, pose) in graph.tree().items():
        assert parent == "world"
        np.testing.assert_allclose(pose, tree[frame][1], atol=0.05)


def test_a_publisher_that_is_killed_twenty_times_is_one_robot(graph: Graph) -> None:
    staying = graph.fleet("staying")
    graph.node()
    publish_building(graph, staying, "left", "right")
    grids = {g.name: g for g in rooms.building()}
    fleet = graph.fleet("killed")
    graph.publish(fleet, grids["middle"])
    graph.wait_status(left="merged", middle="merged", right="merged")
    graph.wait("three transforms", lambda: len(graph.tree()) == 3)
    graph.spin(0.5)
    tree, newest = graph.tree(), graph.maps["/map"][-1]
    for k in range(20):
        if k % 5 == 4:
            # The whole process, and without a good-bye.
            fleet.popen.kill()
            fleet.stop()
            graph.processes.remove(fleet)
            fleet = graph.fleet("killed")
        else:
            fleet.do(do="silence", topic="/middle/map")
        graph.publish(fleet, grids["middle"])
        graph.spin(0.2)
    estimate = graph.wait_status(left="merged", middle="merged", right="merged")
    assert sorted(r.robot for r in estimate.robots) == ["left", "middle", "right"]
    assert graph.tree() == tree
    assert graph.maps["/map"][-1] == newest


def test_a_node_that_is_killed_twenty_times_says_the_same(graph: Graph) -> None:
    fleet = graph.fleet()
    publish_building(graph, fleet)
    results = []
    for k in range(20):
        graph.estimates.clear()
        graph.links["/tf_static"].clear()
        node = graph.node(f"node{k}")
        graph.wait_status(left="merged", middle="merged", right="merged")
        graph.wait("three transforms", lambda: len(graph.tree()) == 3)
        results.append(graph.tree())
        if k % 2:
            node.popen.kill()
            node.stop()
        else:
            assert node.stop(signal.SIGINT if k % 4 else signal.SIGTERM) == 0
        graph.processes.remove(node)
        assert "Traceback" not in node.said(), node.said()
    a, b = "left/map", "middle/map"
    for tree in results:
        assert sorted(tree) == ["left/map", "middle/map", "right/map"]
        metres, radians = rooms.relative_error(np.array(tree[a][1]), np.array(tree[b][1]), "left", "middle")
        assert metres < 0.1
        assert radians < 0.02
