"""`mapmeld simulate` and `mapmeld demo` as a user types them."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from mapmeld import datasets, read_map
from rooms import assert_refused, run_cli

SMALL = ("--robots", 2, "--set", "path_length=3", "--set", "size=[5, 5]", "--set", "resolution=0.1")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_small_case(tmp_path: Path) -> None:
    for name in ("a", "b"):
        code, out, err = run_cli("simulate", "-o", tmp_path / name, "--seed", 3, *SMALL)
        assert (code, err) == (0, "")
        assert "2 maps" in out
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    truth = json.loads((tmp_path / "a" / "truth.json").read_text())
    assert truth["options"]["seed"] == 3
    assert truth["options"]["size"] == [5, 5]
    for entry in truth["maps"]:
        assert read_map(tmp_path / "a" / f"{entry['name']}.yaml").resolution == 0.1


def test_png_and_another_world(tmp_path: Path) -> None:
    run_cli("simulate", "-o", tmp_path / "a", *SMALL)
    world = sorted((tmp_path / "a").glob("*.yaml"))[0]
    to = ("simulate", "-o", tmp_path / "b", "--image", "png")
    code, _, err = run_cli(*to, "--world", world, "--robots", 1, "--set", "path_length=1")
    assert (code, err) == (0, "")
    assert sorted(p.suffix for p in (tmp_path / "b").iterdir()) == [".json", ".png", ".yaml"]


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    to = ("simulate", "-o", tmp_path / "out")
    assert_refused(run_cli(*to, "--robots", 0), "robots", "at least 1")
    assert_refused(run_cli(*to, "--world", "castle"), "world", "maze")
    assert_refused(run_cli(*to, "--world", tmp_path / "none.yaml"), "none.yaml", "no such file")
    assert_refused(run_cli(*to, "--set", "robotz=3"), "robotz", "no such option", "path_length")
    assert_refused(run_cli(*to, "--set", "robots"), "'robots'", "value")
    (tmp_path / "mine.txt").write_text("mine")
    assert_refused(run_cli("simulate", "-o", tmp_path, *SMALL), "mine.txt", "--force")
    assert os.listdir(tmp_path) == ["mine.txt"]


def test_demo(tmp_path: Path) -> None:
    if not datasets.names():
        pytest.skip("no bundled maps")
    for _ in range(2):  # also over its own output
        code, out, err = run_cli("demo", "-o", tmp_path / "demo")
        assert code == 0, err
    assert "Acceptance: " in out
    assert str(tmp_path / "demo" / "merge" / "report.png") in out
    assert {"merged.yaml", "merged.pgm", "result.json", "report.png"} <= set(
        os.listdir(tmp_path / "demo/merge")
    )
    assert len(os.listdir(tmp_path / "demo" / "inspect")) == 10
