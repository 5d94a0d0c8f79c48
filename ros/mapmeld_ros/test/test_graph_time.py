"""Time over the graph: maps that are still, a simulation's clock, estimates that newer maps overtake."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

import rooms
from graph import Graph
from mapmeld import OccupancyGrid


def test_a_link_that_is_not_clear_is_told_once_the_maps_are_still(graph: Graph) -> None:
    """Enough for a merge of finished maps, too little while maps may grow."""
    fleet = graph.fleet()
    graph.node(quiet_time=6.0)
    left = rooms.view("left", (-0.5, 9.0), rooms.TRUTH["left"])
    right = rooms.view("right", (6.0, 15.0), rooms.TRUTH["right"])
    graph.publish(fleet, left)
    graph.publish(fleet, right)
    estimate = graph.wait_status(left="ambiguous", right="ambiguous")
    assert len(estimate.components) == 2

    # Maps that change all the time are not still, whether they show more or not.
    count = len(graph.estimates)
    for k in range(20):
        data = np.array(left.data)
        data[0, 0] = -1 if k % 2 else 0
        graph.publish(fleet, OccupancyGrid(data, left.resolution, left.origin, "left"))
        graph.spin(0.4)
    during = graph.estimates[count:]
    assert during
    assert {r.status for e in during for r in e.robots} == {"ambiguous"}

    graph.wait_status(left="merged", right="merged")
    graph.wait("both in the world", lambda: {p for p, _ in graph.tree().values()} == {"world"})
    metres, radians = rooms.relative_error(
        np.array(graph.tree()["left/map"][1]), np.array(graph.tree()["right/map"][1]), "left", "right"
    )
    assert metres < 0.1
    assert radians < 0.02

    # What was told is held when they grow again.
    graph.publish(fleet, rooms.view("right", (5.6, 15.0), rooms.TRUTH["right"]))
    count = len(graph.estimates)
    graph.wait("another estimate", lambda: len(graph.estimates) > count)
    assert {r.status for r in graph.estimates[-1].robots} == {"merged"}


def started_clock(graph: Graph) -> tuple[list[float], Callable[[], None]]:
    """Publishes /clock a hundred times a second: the time in seconds, and what stops it."""
    publisher = graph.ros.create_publisher(Clock, "/clock", QoSProfile(depth=1))
    now = [1000.0]

    def tick() -> None:
        now[0] += 0.01
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = int(now[0]), int(now[0] % 1 * 1e9)
        publisher.publish(msg)

    timer = graph.ros.create_timer(0.01, tick)
    return now, timer.cancel


def test_a_simulation_s_clock_stamps_what_is_published_and_nothing_waits_for_it(graph: Graph) -> None:
    graph.hear_tf("/tf")
    fleet = graph.fleet()
    graph.node(use_sim_time=True, publish_tf="dynamic")
    # Before the simulation runs: no clock, but maps are merged.
    left, middle, right = rooms.building()
    graph.publish(fleet, left)
    graph.wait_status(left="no evidence")
    assert graph.estimates[-1].header.stamp.sec == 0

    now, stop = started_clock(graph)
    graph.wait("transforms of the simulation's time", lambda: stamp(graph) >= 1000)
    graph.publish(fleet, middle)
    graph.wait_status(left="merged", middle="merged")
    msg = graph.wait_map(accept=lambda m: m.header.stamp.sec > 0)
    for seconds in (msg.header.stamp.sec, graph.estimates[-1].header.stamp.sec, stamp(graph)):
        assert 1000 <= seconds <= now[0]

    # A simulation that pauses stops no merge: the last robot comes while time stands still.
    stop()
    graph.spin(0.5)
    count = len(graph.links["/tf"])
    graph.publish(fleet, right)
    graph.wait_status(left="merged", middle="merged", right="merged")
    assert 1000 <= graph.estimates[-1].header.stamp.sec <= now[0]
    graph.wait("transforms", lambda: len(graph.links["/tf"]) > count + 5)


def stamp(graph: Graph) -> int:
    """Of the newest transform on /tf, seconds."""
    return graph.links["/tf"][-1].transforms[0].header.stamp.sec if graph.links["/tf"] else -1


def test_an_estimate_that_newer_maps_overtake_gives_way(graph: Graph, tmp_path: Path) -> None:
    """Many maps of nothing but clutter, on one core and with many poses led uphill, take seconds. The robot
    that is blank when their estimate begins is never told so: it has a map before that ends."""
    rng = np.random.default_rng(3)
    fleet = graph.fleet()
    slow = tmp_path / "slow.yaml"
    slow.write_text("threads: 1\nregistration: {shortlist: 200}\n", encoding="utf-8")
    graph.node(estimation_timeout=0.1, config_file=str(slow))
    graph.publish(fleet, rooms.blank("last"))
    for k in range(38):
        graph.publish(fleet, rooms.clutter(rng, f"robot{k:02}"))
    graph.wait("all to have joined", lambda: graph.estimates and len(graph.estimates[-1].robots) == 39)
    graph.spin(0.5)
    before = [r.status for e in graph.estimates for r in e.robots if r.robot == "last"]
    graph.publish(fleet, rooms.hall("last"))
    graph.wait_status(last="no evidence", robot37="no evidence")
    full = [
        e for e in graph.estimates if all(r.status != "waiting" for r in e.robots) and len(e.robots) == 39
    ]
    statuses = [r.status for e in full for r in e.robots if r.robot == "last"]
    assert set(before) <= {"waiting", "blank"}
    assert statuses == ["no evidence"] * len(statuses)
