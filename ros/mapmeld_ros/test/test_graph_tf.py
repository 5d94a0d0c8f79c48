"""The TF tree: prefixed frames, namespaced trees, and what cannot be one tree."""

from __future__ import annotations

import rooms
from graph import Graph, Process


def wait_listening(graph: Graph, node: Process) -> None:
    """Until the node has heard what is latched; how long a node takes to start is not asked here."""
    graph.wait("an active node", lambda: "active: waits" in node.said())
    graph.spin(1.0)


def test_namespaced_robots_get_the_transform_in_their_own_trees(graph: Graph) -> None:
    """Robots with equal frame names, each with a tf topic of its own, as nav2 starts them."""
    for name in ("left", "middle"):
        graph.hear_tf(f"/{name}/tf_static")
        graph.hear_tf(f"/{name}/tf")
    fleet = graph.fleet()
    graph.node()
    for grid in rooms.building()[:2]:
        fleet.do(do="tf", topic=f"/{grid.name}/tf", parent="map", child="odom")
        graph.publish(fleet, grid, frame="map")
    graph.wait_status(left="merged", middle="merged")
    for name in ("left", "middle"):
        graph.wait(f"the tree of {name}", lambda name=name: graph.tree(f"/{name}/tf_static"))
        assert list(graph.tree(f"/{name}/tf_static")) == ["map"]
        assert graph.tree(f"/{name}/tf_static")["map"][0] == "world"
    assert graph.tree() == {}
    # The robots' own transforms are nobody else's: map -> odom comes from the robot alone.
    for topic in ("/tf", "/left/tf", "/middle/tf"):
        for msg in graph.links[topic]:
            assert [t.child_frame_id for t in msg.transforms] == ["odom"]


def test_one_frame_that_two_robots_claim_is_said_and_has_one_parent(graph: Graph) -> None:
    fleet = graph.fleet()
    node = graph.node()
    for grid in rooms.building()[:2]:
        graph.publish(fleet, grid, frame="map")
    graph.wait_status(left="merged", middle="merged")
    graph.wait("the transform", graph.tree)
    assert list(graph.tree()) == ["map"]
    assert "its map frame 'map' is also that of" in node.said()


def test_a_map_frame_called_like_the_world_is_said(graph: Graph) -> None:
    fleet = graph.fleet()
    node = graph.node(world_frame="map")
    graph.publish(fleet, rooms.hall(), frame="map")
    graph.wait_map()
    assert "give the parameter world_frame another value" in node.said()
    assert graph.tree() == {}


def test_transforms_on_tf_are_repeated_with_new_stamps(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(publish_tf="dynamic")
    graph.publish(fleet, rooms.hall())
    graph.wait("some transforms", lambda: len(graph.links["/tf"]) >= 4)
    stamps = [(t.header.stamp.sec, t.header.stamp.nanosec) for m in graph.links["/tf"] for t in m.transforms]
    assert stamps == sorted(set(stamps))
    assert graph.tree("/tf_static") == {}


def test_transforms_may_be_off(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(publish_tf="off")
    graph.publish(fleet, rooms.hall())
    graph.wait_map()
    graph.spin(0.5)
    assert graph.tree() == {}


def test_static_transforms_are_published_when_they_change_and_not_else(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node()
    left, middle, _ = rooms.building()
    graph.publish(fleet, left)
    graph.publish(fleet, middle)
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    graph.spin(0.5)
    sent = len(graph.links["/tf_static"])
    for _ in range(10):
        graph.publish(fleet, middle)
        graph.spin(0.1)
    assert len(graph.links["/tf_static"]) == sent


def test_a_frame_that_somebody_else_leads_to_is_left_to_them(graph: Graph) -> None:
    """As with the static_transform_publishers that people ran beside multirobot_map_merge."""
    fleet = graph.fleet()
    node = graph.node()
    left, middle, _ = rooms.building()
    fleet.do(do="tf", topic="/tf_static", parent="world", child="left/map", durability="transient_local")
    wait_listening(graph, node)
    graph.links["/tf_static"].clear()
    graph.publish(fleet, left)
    graph.publish(fleet, middle)
    graph.wait_status(left="merged", middle="merged")
    graph.wait("the other transform", graph.tree)
    graph.spin(0.5)
    graph.wait(
        "the problem", lambda: "somebody else publishes a static transform from 'world'" in node.said()
    )
    graph.wait("the other transform alone", lambda: list(graph.tree()) == ["middle/map"])

    # When they stop, the node takes over.
    fleet.do(do="silence", topic="/tf_static")
    graph.wait("both transforms", lambda: sorted(graph.tree()) == ["left/map", "middle/map"])


def test_one_foreign_publisher_that_stops_is_forgotten_while_another_stays(graph: Graph) -> None:
    """Every robot_state_publisher publishes static transforms, and goes on doing so."""
    fleet, describing = graph.fleet("conflicting"), graph.fleet("describing")
    node = graph.node()
    left, middle, _ = rooms.building()
    latched = {"topic": "/tf_static", "durability": "transient_local"}
    describing.do(do="tf", parent="elsewhere", child="middle/map", **latched)
    fleet.do(do="tf", parent="world", child="left/map", **latched)
    wait_listening(graph, node)
    graph.publish(describing, left)
    graph.publish(describing, middle)
    graph.wait_status(left="merged", middle="merged")
    graph.wait(
        "the problems", lambda: "'left/map'; stop" in node.said() and "'middle/map'; stop" in node.said()
    )

    # What comes from here on is not what they have published.
    def heard() -> set[str]:
        return {t.child_frame_id for m in graph.links["/tf_static"] for t in m.transforms}

    graph.wait("what they publish", lambda: {"left/map", "middle/map"} <= heard())
    graph.links["/tf_static"].clear()
    fleet.do(do="silence", topic="/tf_static")
    graph.wait("the transform", lambda: "left/map" in graph.tree())
    graph.spin(1.5)
    # The other one is still heard, and its frame never got a second parent.
    sent = [{t.child_frame_id for t in m.transforms} for m in graph.links["/tf_static"]]
    assert all("middle/map" not in children for children in sent), sent


def test_own_transforms_that_change_are_not_taken_for_somebody_elses(graph: Graph) -> None:
    from mapmeld_msgs.srv import PinRobot

    fleet = graph.fleet()
    node = graph.node()
    graph.publish(fleet, rooms.hall())
    graph.wait("a transform", graph.tree)
    for x in (1.0, 2.0, 3.0):
        assert graph.call(PinRobot, "/map_merge/pin", robot="hall", x=x).success
        graph.wait("the pin", lambda x=x: graph.tree()["hall/map"] == ("world", (x, 0.0, 0.0)))
    graph.spin(1.0)
    assert "somebody else" not in node.said()
    assert graph.tree()["hall/map"] == ("world", (3.0, 0.0, 0.0))
