"""The node itself: parameters, lifecycle, services, diagnostics, several nodes in one process."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from mapmeld_msgs.srv import PinRobot, SaveMaps, UnpinRobot
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import Trigger

import rooms
from graph import Graph
from mapmeld import Estimate, read_map
from mapmeld.config import default_config
from mapmeld_ros.node import MapMerge
from mapmeld_ros.parameters import Parameters


def state(graph: Graph) -> str:
    return graph.call(GetState, "/map_merge/get_state").current_state.label


def change(graph: Graph, transition: int) -> bool:
    return graph.call(ChangeState, "/map_merge/change_state", transition=Transition(id=transition)).success


def test_a_node_without_a_file_has_the_defaults_of_multirobot_map_merge(graph: Graph) -> None:
    graph.program(["-m", "mapmeld_ros.map_merge", "--ros-args", "-r", "__ns:=/plain"])
    names = list(vars(Parameters()))
    answer = graph.call(GetParameters, "/plain/map_merge/get_parameters", names=names)
    found = {n: parameter_value_to_python(v) for n, v in zip(names, answer.values, strict=True)}
    assert found == vars(Parameters())


def test_topics_are_named_as_asked(graph: Graph) -> None:
    graph.hear_map("/site/whole")
    fleet = graph.fleet()
    graph.node(
        robot_map_topic="slam_map",
        robot_namespace="fleet",
        merged_map_topic="/site/whole",
        world_frame="site",
    )
    left, middle, _ = rooms.building()
    graph.publish(fleet, left, topic="/fleet/left/slam_map", frame="left_map")
    graph.publish(fleet, middle, topic="/middle/slam_map", frame="middle_map")
    graph.wait_map("/site/whole", lambda m: m.header.frame_id == "site")
    graph.wait_status(**{"fleet/left": "no evidence"})
    assert [r.robot for r in graph.estimates[-1].robots] == ["fleet/left"]
    graph.wait("the transform", graph.tree)
    assert graph.tree() == {"left_map": ("site", (0.0, 0.0, 0.0))}


def test_live_parameters_change_and_the_others_say_when_they_can(graph: Graph) -> None:
    graph.node()
    graph.wait("an active node", lambda: state(graph) == "active")

    def set_to(name: str, value: ParameterValue):
        parameters = [Parameter(name=name, value=value)]
        return graph.call(SetParameters, "/map_merge/set_parameters", parameters=parameters).results[0]

    rate = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=1.0)
    assert set_to("merging_rate", rate).successful
    refused = set_to("merging_rate", ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.0))
    assert not refused.successful
    refused = set_to("world_frame", ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="site"))
    assert (refused.successful, refused.reason.split(":")[0]) == (False, "world_frame")
    assert change(graph, Transition.TRANSITION_DEACTIVATE)
    assert change(graph, Transition.TRANSITION_CLEANUP)
    assert set_to(
        "world_frame", ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="site")
    ).successful


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"merging_rate": -1.0}, "merging_rate"),
        ({"publish_tf": "sometimes"}, "publish_tf"),
        ({"world_frame": ""}, "world_frame"),
        ({"estimation_rate": "fast"}, "estimation_rate"),
    ],
)
def test_a_parameter_that_makes_no_sense_ends_the_start_with_its_name(
    graph: Graph, parameters: dict[str, object], words: str
) -> None:
    node = graph.node(**parameters)
    assert node.popen.wait(20) == 2
    graph.processes.remove(node)
    assert words in node.said()
    assert "Traceback" not in node.said()
    node.stop()


def test_lifecycle(graph: Graph) -> None:
    """Without autostart a manager decides; a pause keeps the robots, a clean-up forgets them."""
    fleet = graph.fleet()
    graph.publish(fleet, rooms.building()[0])
    graph.node(autostart=False)
    assert state(graph) == "unconfigured"
    graph.spin(1.0)
    assert graph.maps["/map"] == []
    assert change(graph, Transition.TRANSITION_CONFIGURE)
    assert state(graph) == "inactive"
    assert not graph.call(Trigger, "/map_merge/re_estimate").success
    assert change(graph, Transition.TRANSITION_ACTIVATE)
    graph.wait_map()

    assert change(graph, Transition.TRANSITION_DEACTIVATE)
    count = len(graph.maps["/map"])
    more = rooms.building()[0].data.copy()
    more[10, 10:30] = 100
    changed = type(rooms.hall())(more, rooms.RESOLUTION, rooms.building()[0].origin, "left")
    graph.publish(fleet, changed)
    graph.spin(1.0)
    assert len(graph.maps["/map"]) == count
    # The paused one hears what is latched when it goes on.
    assert change(graph, Transition.TRANSITION_ACTIVATE)
    graph.wait("the newer map", lambda: len(graph.maps["/map"]) > count)

    assert change(graph, Transition.TRANSITION_DEACTIVATE)
    assert change(graph, Transition.TRANSITION_CLEANUP)
    assert graph.ros.count_publishers("/map") == 0 or graph.wait(
        "no topic", lambda: not graph.ros.count_publishers("/map")
    )
    assert change(graph, Transition.TRANSITION_CONFIGURE)
    assert change(graph, Transition.TRANSITION_ACTIVATE)
    graph.wait_status(left="no evidence")


def test_save_writes_all_files_or_none(graph: Graph, tmp_path: Path) -> None:
    fleet = graph.fleet()
    graph.node()
    folder = tmp_path / "site"
    refused = graph.call(SaveMaps, "/map_merge/save", folder=str(folder))
    assert not refused.success
    assert "no merged map yet" in refused.message
    for grid in (*rooms.building()[:2], rooms.hall()):
        graph.publish(fleet, grid)
    graph.wait_status(left="merged", middle="merged", hall="no evidence")
    graph.spin(0.5)
    answer = graph.call(SaveMaps, "/map_merge/save", folder=str(folder))
    assert answer.success, answer.message
    names = ["merged.pgm", "merged.yaml", "merged_2.pgm", "merged_2.yaml", "result.json"]
    assert [Path(f).name for f in answer.files] == names
    assert sorted(p.name for p in folder.iterdir()) == names
    saved = read_map(folder / "merged.yaml")
    newest = graph.maps["/map"][-1]
    np.testing.assert_array_equal(saved.data, np.array(newest.data, dtype=np.int8).reshape(saved.data.shape))
    result = json.loads((folder / "result.json").read_text())
    tree = graph.tree()
    for placed in result["maps"]:
        parent, pose = tree[placed["frame"]]
        assert parent == result["components"][placed["component"]]["frame"]
        np.testing.assert_allclose(placed["T_component_map"], pose, atol=1e-9)
    # All of it speaks of the same components, in the same frames.
    assert {c["frame"]: c["is_world"] for c in result["components"]} == {
        c.frame: c.is_world for c in graph.estimates[-1].components
    }
    maps = {m["name"]: m for m in result["maps"]}
    assert result["probability"] == pytest.approx(maps["left"]["probability"] * maps["middle"]["probability"])
    for placed in result["hypotheses"][0]["maps"]:
        if placed["name"] in [c["reference"] for c in result["components"]]:
            np.testing.assert_allclose(
                placed["T_component_map"], maps[placed["name"]]["T_component_map"], atol=1e-9
            )

    # Again over its own files, but not beside those of others.
    assert graph.call(SaveMaps, "/map_merge/save", folder=str(folder)).success
    (folder / "notes.txt").write_text("mine")
    refused = graph.call(SaveMaps, "/map_merge/save", folder=str(folder))
    assert not refused.success
    assert "notes.txt" in refused.message
    assert graph.call(SaveMaps, "/map_merge/save", folder=str(folder), force=True).success
    # What the operating system says is the answer.
    refused = graph.call(SaveMaps, "/map_merge/save", folder="/proc/site")
    assert not refused.success
    assert "/proc/site: cannot be written" in refused.message
    refused = graph.call(SaveMaps, "/map_merge/save", folder="")
    assert "folder: is empty" in refused.message


def test_re_estimate_does_not_wait_for_the_rate(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node(estimation_rate=0.005)
    graph.publish(fleet, rooms.building()[0])
    graph.wait_status(left="no evidence")
    graph.publish(fleet, rooms.building()[1])
    graph.wait("its map", lambda: graph.estimates[-1].robots[-1].robot == "middle")
    graph.spin(1.0)
    assert graph.estimates[-1].robots[-1].status == "waiting"
    assert graph.call(Trigger, "/map_merge/re_estimate").success
    graph.wait_status(left="merged", middle="merged")


def test_only_re_estimate_takes_the_maps_for_done(graph: Graph) -> None:
    """A pin among robots that explore must not lower what the links of all others need."""
    fleet = graph.fleet()
    said: list[bool] = []
    args = ["--ros-args", "-p", "quiet_time:=0.0", "-p", "estimation_rate:=50.0", "-p", "discovery_rate:=2.0"]
    node = MapMerge(context=graph.context, cli_args=args, use_global_arguments=False)
    graph.executor.add_node(node)
    try:
        graph.publish(fleet, rooms.hall())
        graph.wait_status(hall="no evidence")
        estimator = node._session.estimator
        estimate = estimator.estimate

        def heard(progress: Any, maps_are_done: bool) -> Estimate:
            said.append(maps_are_done)
            return estimate(progress, maps_are_done)

        estimator.estimate = heard
        assert graph.call(PinRobot, "/map_merge/pin", robot="hall", x=1.0).success
        graph.wait_status(hall="pinned")
        assert graph.call(UnpinRobot, "/map_merge/unpin", robot="hall").success
        graph.wait_status(hall="no evidence")
        assert said == [False] * len(said)
        assert graph.call(Trigger, "/map_merge/re_estimate").success
        graph.wait("the last estimate", lambda: said[-1])
    finally:
        graph.executor.remove_node(node)
        node.destroy_node()


def test_diagnostics_name_every_robot_and_what_is_wrong(graph: Graph) -> None:
    said: list[DiagnosticArray] = []
    graph.ros.create_subscription(DiagnosticArray, "/diagnostics", said.append, 10)
    fleet = graph.fleet()
    graph.node()
    for grid in (*rooms.building()[:2], rooms.hall()):
        graph.publish(fleet, grid)
    graph.wait_status(left="merged", middle="merged", hall="no evidence")
    graph.publish(fleet, rooms.building()[0], set={"info.resolution": -1.0})

    def levels() -> dict[str, bytes]:
        return {s.name: s.level for s in said[-1].status} if said else {}

    ok, warn = DiagnosticStatus.OK, DiagnosticStatus.WARN
    expected = {
        "map_merge: map merge": ok,
        "map_merge: robot middle": ok,
        "map_merge: robot left": warn,
        "map_merge: robot hall": warn,
    }
    graph.wait("the levels", lambda: levels() == expected)
    robots = {s.hardware_id: s for s in said[-1].status}
    assert "info.resolution: must be a positive number of metres per cell, got -1" in robots["left"].message
    assert "no evidence" in robots["hall"].message
    values = {v.key: v.value for v in robots["middle"].values}
    assert float(values["probability"]) >= default_config()["evidence"]["min_probability"]
    assert values["topic"] == "/middle/map"


def test_it_ends_at_once_when_it_is_told(graph: Graph) -> None:
    for sig in (signal.SIGINT, signal.SIGTERM):
        node = graph.node()
        graph.wait("an active node", lambda: state(graph) == "active")
        assert node.stop(sig) == 0
        graph.processes.remove(node)


def test_two_nodes_in_one_process_and_executor(graph: Graph) -> None:
    """As a component container makes them: with a context, names and arguments of their own."""
    fleet = graph.fleet()
    executor = SingleThreadedExecutor(context=graph.context)
    nodes = []
    for name in ("a", "b"):
        args = [
            "--ros-args",
            "-r",
            f"__node:=merge_{name}",
            "-p",
            f"merged_map_topic:=/{name}_merged",
            "-p",
            f"robot_namespace:={name}_",
        ]
        nodes.append(MapMerge(context=graph.context, cli_args=args, use_global_arguments=False))
        executor.add_node(nodes[-1])
        graph.hear_map(f"/{name}_merged")
    try:
        for name, grid in zip(("a_left", "b_hall"), (rooms.building()[0], rooms.hall()), strict=True):
            graph.publish(fleet, grid, topic=f"/{name}/map", frame=f"{name}/map")

        def both() -> bool:
            executor.spin_once(timeout_sec=0.02)
            return all(graph.maps[f"/{name}_merged"] for name in ("a", "b"))

        graph.wait("both maps", both)
        counts = [np.count_nonzero(np.array(graph.maps[f"/{n}_merged"][-1].data) == 100) for n in ("a", "b")]
        assert counts[1] == np.count_nonzero(rooms.hall().data == 100)
        assert counts[0] > counts[1]
    finally:
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
