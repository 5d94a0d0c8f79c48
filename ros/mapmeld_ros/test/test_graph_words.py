"""What the node says of itself: in the log, on /diagnostics and to those who look."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mapmeld_msgs.srv import PinRobot, SaveMaps, UnpinRobot
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

import rooms
from graph import Graph, Process
from mapmeld import OccupancyGrid, read_map


def set_double(graph: Graph, name: str, value: float) -> None:
    said = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    answer = graph.call(
        SetParameters, "/map_merge/set_parameters", parameters=[Parameter(name=name, value=said)]
    )
    assert answer.results[0].successful, answer


def wait_said(graph: Graph, node: Process, *words: str) -> None:
    for sentence in words:
        graph.wait(f"{sentence!r} in the log", lambda sentence=sentence: sentence in node.said())


def recorded(data: Path, case: str) -> list[OccupancyGrid]:
    maps = [read_map(data / case / f"{name}.yaml") for name in ("00_r0", "01_r1")]
    return [OccupancyGrid(g.data, g.resolution, g.origin, f"robot{k}") for k, g in enumerate(maps, start=1)]


def test_a_map_of_another_size_raises_a_warning(graph: Graph, shared_data: Path) -> None:
    node = graph.node()
    fleet = graph.fleet()
    first, second = recorded(shared_data, "seattle_ov50")
    larger = OccupancyGrid(second.data, 1.03 * second.resolution, second.origin, second.name)
    for grid in (first, larger):
        graph.publish(fleet, grid)
    wait_said(graph, node, "map robot2 would fit robot1 better at 0.97 times its size")


def test_a_map_without_floor_raises_a_warning(graph: Graph, shared_data: Path) -> None:
    node = graph.node()
    first, _ = recorded(shared_data, "seattle_ov50")
    walls = np.where(first.data >= 65, first.data, -1).astype(np.int8)
    graph.publish(graph.fleet(), OccupancyGrid(walls, first.resolution, first.origin, first.name))
    wait_said(graph, node, "robot 'robot1': its map has no free cell")


def test_exact_poses_that_contradict_the_walls_raise_an_alarm(graph: Graph, shared_data: Path) -> None:
    said: list[DiagnosticArray] = []
    graph.ros.create_subscription(DiagnosticArray, "/diagnostics", said.append, 10)
    poses = {"robot1": (10.0, 5.0, 0.5), "robot2": (0.0, 0.0, 1.57)}
    node = graph.node(
        **{
            f"/{robot}/map_merge/init_pose_{axis}": value
            for robot, pose in poses.items()
            for axis, value in zip(("x", "y", "yaw"), pose, strict=True)
        }
    )
    fleet = graph.fleet()
    for grid in recorded(shared_data, "intel_ov30"):
        graph.publish(fleet, grid)
    graph.wait_status(robot1="pinned", robot2="pinned")

    def levels() -> set[bytes]:
        return {s.level for s in said[-1].status} if said and len(said[-1].status) == 3 else set()

    graph.wait("warnings", lambda: levels() == {DiagnosticStatus.WARN})
    assert "contradict the walls: robot1, robot2" in said[-1].status[0].message
    wait_said(graph, node, "robot 'robot2': its pose contradicts the walls: the walls that it shares with")
    assert node.said().count("robot 'robot2': its pose contradicts") == 1
    assert graph.call(UnpinRobot, "/map_merge/unpin", robot="robot2").success
    graph.wait_status(robot1="pinned", robot2="merged")
    wait_said(graph, node, "robot 'robot2': its pose no longer contradicts the walls")
    graph.wait("no warning", lambda: levels() == {DiagnosticStatus.OK})


def test_a_pose_that_is_set_one_by_one_takes_effect_as_a_whole(graph: Graph) -> None:
    node = graph.node()
    fleet = graph.fleet()
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="no evidence")
    graph.estimates.clear()
    for what, value in {"x": 4.0, "y": 1.0, "yaw": 0.3, "sigma_xy": 0.5, "sigma_yaw": 0.1}.items():
        set_double(graph, f"/hall/map_merge/init_pose_{what}", value)
        graph.spin(0.5)
    graph.wait_status(hall="prior")
    assert not [e for e in graph.estimates if e.robots[0].status == "pinned"]
    assert "is missing" not in node.said()
    set_double(graph, "/hall/map_merge/init_pose_sigma_yaw", 0.0)
    graph.wait_status(hall="pinned")
    wait_said(graph, node, "init_pose_sigma_yaw: is 0 while sigma_xy is not")


def test_the_log_tells_what_changes(graph: Graph) -> None:
    node = graph.node()
    wait_said(graph, node, "active: waits for topics '<robot>/map' of type nav_msgs/msg/OccupancyGrid")
    fleet = graph.fleet()
    left, middle, _ = rooms.building()
    graph.publish(fleet, left)
    wait_said(graph, node, "robot 'left' is heard: ", "robot 'left': no evidence")
    graph.wait_status(left="no evidence")
    graph.publish(fleet, middle)
    graph.wait_status(left="merged", middle="merged")
    wait_said(graph, node, "robot 'middle' is linked with 'left': merged, probability ")
    assert graph.call(PinRobot, "/map_merge/pin", robot="left", x=10.0, y=-5.0, yaw=1.0).success
    wait_said(graph, node, "robot 'left' is pinned at x 10.00 m, y -5.00 m, yaw 1.000 rad in 'world'")
    assert graph.call(UnpinRobot, "/map_merge/unpin", robot="left").success
    wait_said(graph, node, "robot 'left' is no longer pinned: merged")
    # The world stays where the pin put it.
    graph.spin(0.5)
    assert graph.tree()["left/map"] == ("world", pytest.approx((10.0, -5.0, 1.0), abs=0.05))


def test_both_robots_are_pinned_to_part_a_wrong_merge(graph: Graph) -> None:
    graph.node()
    fleet = graph.fleet()
    for grid in rooms.building()[:2]:
        graph.publish(fleet, grid)
    graph.wait_status(left="merged", middle="merged")
    for robot, x in (("left", 0.0), ("middle", 30.0)):
        assert graph.call(PinRobot, "/map_merge/pin", robot=robot, x=x).success
    graph.wait_status(left="pinned", middle="pinned")
    graph.wait("both places", lambda: graph.tree().get("middle/map") == ("world", (30.0, 0.0, 0.0)))
    assert graph.tree()["left/map"] == ("world", (0.0, 0.0, 0.0))


def test_parameters_that_it_does_not_know_are_named(graph: Graph) -> None:
    node = graph.node(merge_rate=1.0, **{"/hall/map_merge/init_pose_yw": 1.0})
    wait_said(
        graph,
        node,
        "parameter merge_rate: is not known and has no effect; is merging_rate meant?",
        "parameter /hall/map_merge/init_pose_yw: is not known and has no effect; "
        "is /hall/map_merge/init_pose_yaw meant?",
    )
    set_double(graph, "world_fram", 1.0)
    wait_said(graph, node, "parameter world_fram: is not known and has no effect; is world_frame meant?")
    assert node.said().count("is not known") == 3


def test_an_integer_for_a_double_is_told_how_to_write_it(graph: Graph) -> None:
    node = graph.node(merging_rate=4)
    assert node.popen.wait(20) == 2
    graph.processes.remove(node)
    assert "parameter merging_rate: takes a double; write 4.0 instead of 4" in node.said()
    node.stop()


def test_a_missing_config_file_leaves_the_node_unconfigured_and_says_so(graph: Graph) -> None:
    node = graph.node(config_file=str(graph.folder / "none.yaml"))
    wait_said(graph, node, "none.yaml", "the node stays unconfigured")


def test_others_on_the_merged_maps_topic_are_named_once(graph: Graph) -> None:
    node = graph.node()
    fleet = graph.fleet()
    graph.publish(fleet, rooms.hall(), topic="/map", frame="map")
    wait_said(graph, node, "/map: node '/robots' publishes there too")
    graph.spin(1.5)
    assert node.said().count("publishes there too") == 1


def look(graph: Graph, *args: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mapmeld_ros.look", *args]
    return subprocess.run(command, env=graph.environment, capture_output=True, text=True, timeout=60)


def test_look_prints_robots_and_maps_or_what_to_do(graph: Graph) -> None:
    nothing = look(graph, "--timeout", "1")
    assert (nothing.returncode, nothing.stdout) == (1, "")
    assert "/map_merge/estimate: no estimate in 1 s" in nothing.stderr
    graph.node()
    fleet = graph.fleet()
    for grid in (*rooms.building()[:2], rooms.hall()):
        graph.publish(fleet, grid)
    estimate = graph.wait_status(left="merged", middle="merged", hall="no evidence")
    assert [c.map_topic for c in estimate.components] == ["/map", "/map_2"]
    graph.wait_map()
    seen = look(graph)
    assert seen.returncode == 0, seen.stderr
    assert "middle: merged, probability " in seen.stdout
    assert "held by left: probability " in seen.stdout
    assert "cells of 0.1 m, of left, middle" in seen.stdout
    assert "cells of 0.1 m, of hall" in seen.stdout


def test_one_robot_alone_is_no_warning_and_counted_right(graph: Graph) -> None:
    said: list[DiagnosticArray] = []
    graph.ros.create_subscription(DiagnosticArray, "/diagnostics", said.append, 10)
    graph.node()
    fleet = graph.fleet()
    graph.publish(fleet, rooms.hall())
    graph.wait_status(hall="no evidence")
    graph.wait(
        "two states", lambda: [s.level for s in said[-1].status] == [DiagnosticStatus.OK] * 2 if said else 0
    )
    assert said[-1].status[0].message == "1 robot in 1 map"


def test_save_names_the_field_and_the_absolute_path(graph: Graph) -> None:
    graph.node()
    fleet = graph.fleet()
    graph.publish(fleet, rooms.hall())
    graph.wait_map()
    folder = graph.folder / "saved"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    refused = graph.call(SaveMaps, "/map_merge/save", folder=str(folder))
    assert "the field force: true" in refused.message
    assert "--force" not in refused.message
