"""The files of the package: parameters, launch files, RViz, and that they are installed."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from graph import Graph
from mapmeld_ros.parameters import Parameters

PACKAGE = Path(__file__).resolve().parents[1]
LAUNCH_FILES = sorted((PACKAGE / "launch").glob("*.launch.py"))


@pytest.mark.parametrize("namespace", ["/", "/fleet"])
def test_the_parameter_file_has_every_parameter_and_reaches_the_node(graph: Graph, namespace: str) -> None:
    text = (PACKAGE / "config" / "map_merge.yaml").read_text()
    written = yaml.safe_load(text)["/**"]["map_merge"]["ros__parameters"]
    assert written == vars(Parameters())
    assert {k: type(v) for k, v in written.items()} == {k: type(v) for k, v in vars(Parameters()).items()}

    assert "merging_rate: 4.0" in text
    file = graph.folder / "changed.yaml"
    file.write_text(text.replace("merging_rate: 4.0", "merging_rate: 3.0"))
    args = ["--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(file)]
    graph.program(["-m", "mapmeld_ros.map_merge", *args])
    service = f"{namespace.rstrip('/')}/map_merge/get_parameters"
    answer = graph.call(GetParameters, service, names=["merging_rate", "world_frame"])
    assert [parameter_value_to_python(v) for v in answer.values] == [3.0, "world"]


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda f: f.name)
def test_launch_files_describe_a_launch(file: Path) -> None:
    """By launch itself, which has no wheel: the next test reads the files where there is none."""
    pytest.importorskip("launch_ros", reason="launch is not installed: only a ROS 2 distribution has it")
    described = runpy.run_path(str(file))["generate_launch_description"]()
    assert {"namespace", "use_sim_time", "params_file"} <= {a.name for a in described.get_launch_arguments()}


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda f: f.name)
def test_launch_files_name_what_the_package_installs(file: Path) -> None:
    tree = ast.parse(file.read_text())
    words = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    assert {"namespace", "use_sim_time"} <= words
    for folder in ("config", "launch", "rviz"):
        if folder in words:
            named = [w for w in words if w.endswith((".yaml", ".launch.py", ".rviz"))]
            assert any((PACKAGE / folder / name).is_file() for name in named)


def test_rviz_shows_the_merged_map_as_it_is_published() -> None:
    config = yaml.safe_load((PACKAGE / "rviz" / "map_merge.rviz").read_text())
    manager = config["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == Parameters().world_frame
    (merged,) = [d for d in manager["Displays"] if d["Name"] == "Merged map"]
    assert merged["Topic"]["Value"] == f"/{Parameters().merged_map_topic}"
    assert merged["Topic"]["Durability Policy"] == "Transient Local"


def test_rviz_follows_the_merge_into_a_namespace() -> None:
    """Each global topic of the configuration is remapped. RViz has no wheel, so the files are read."""
    config = yaml.safe_load((PACKAGE / "rviz" / "map_merge.rviz").read_text())
    displays = config["Visualization Manager"]["Displays"]
    shown = {d["Topic"]["Value"] for d in displays if "Topic" in d}
    (node,) = [
        n
        for n in ast.walk(ast.parse((PACKAGE / "launch" / "map_merge_rviz.launch.py").read_text()))
        if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "Node"
    ]
    given = {k.arg: k.value for k in node.keywords}
    assert dict(ast.literal_eval(given["remappings"])) == {topic: topic.lstrip("/") for topic in shown}
    assert "namespace" in given


def test_package_xml_names_every_ros_package_that_is_imported() -> None:
    package = ElementTree.parse(PACKAGE / "package.xml")
    depends = {e.text for e in package.iter() if e.tag.endswith("depend")}
    imported = set()
    for file in [*(PACKAGE / "mapmeld_ros").glob("*.py"), *LAUNCH_FILES]:
        for node in ast.walk(ast.parse(file.read_text())):
            names = (
                [node.module]
                if isinstance(node, ast.ImportFrom)
                else [a.name for a in getattr(node, "names", [])]
            )
            if isinstance(node, ast.Import | ast.ImportFrom):
                imported |= {str(name).split(".")[0] for name in names}
    foreign = imported - set(sys.stdlib_module_names) - {"numpy", "mapmeld", "mapmeld_ros"}
    assert foreign <= depends, foreign - depends


def test_the_documentation_has_every_parameter_with_its_default() -> None:
    text = (PACKAGE.parents[1] / "docs" / "ros2.md").read_text()
    rows = [[c.strip() for c in r.split("|")[1:3]] for r in text.splitlines() if r.startswith("| `")]
    documented = {n.strip("` "): default for names, default in rows for n in names.split(",")}
    for name, value in vars(Parameters()).items():
        said = yaml.safe_load(documented[name].strip("`"))
        assert said == value, name
