"""`mapmeld merge` of bags that are damaged, cut off, or none, and what it says then."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import FORMATS, bag_path, grid_record, team, text_record, update_record, write_bag
from rooms import assert_refused, building, hall, run_cli, save

LEFT, MIDDLE, RIGHT = building()


def spoil(path: str, value: object) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        *parents, last = path.split(".")
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, last, value)

    return change


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("info.width", 44),
        ("info.resolution", -0.05),
        ("info.origin.position.x", float("nan")),
        ("info.origin.orientation.w", 0.5),
        ("data", np.full(30 * 45, 101, np.int8)),
    ],
)
def test_bad_messages_are_one_line(field: str, value: object, tmp_path: Path) -> None:
    records = [
        text_record(0),
        grid_record(1, "/r1/map", hall()),
        grid_record(2, "/r2/map", hall(), spoil(field, value)),
    ]
    bag = write_bag(tmp_path / "run", records)
    named = "data" if field == "info.width" else field.removesuffix(".w")
    assert_refused(run_cli("merge", bag, "-o", tmp_path / "out"), str(bag), "/r2/map", "+2.000 s", named)
    assert os.listdir(tmp_path) == ["run"]


def test_bad_updates_are_one_line(tmp_path: Path) -> None:
    wide = [grid_record(0, "/r/map", hall()), update_record(1, "/r/map", 40, 0, np.zeros((1, 9)))]
    outcome = run_cli("merge", write_bag(tmp_path / "wide", wide), "--json", "-")
    assert_refused(outcome, "wide: /r/map_updates", "+1.000 s", "x, width", "45 cells")
    other = [
        grid_record(0, "/r/map", hall()),
        update_record(1, "/r/map", 0, 0, np.zeros((1, 9)), frame="/map"),
        update_record(2, "/r/map", 0, 0, np.zeros((1, 9)), frame="odom"),
    ]
    outcome = run_cli("merge", write_bag(tmp_path / "other", other), "--json", "-")
    assert_refused(outcome, "/r/map_updates", "+2.000 s", "header.frame_id", "'odom'", "'map'")


def test_a_map_without_cells_is_no_map(tmp_path: Path) -> None:
    def clear(message: Any) -> None:
        message.info.width = message.info.height = 0
        message.data = np.zeros(0, np.int8)

    bag = write_bag(
        tmp_path / "run", [grid_record(0, "/r1/map", hall()), grid_record(1, "/r2/map", hall(), clear)]
    )
    code, out, err = run_cli("merge", bag, "--json", "-")
    assert code == 0
    assert [m["name"] for m in json.loads(out)["maps"]] == ["r1"]
    assert "/r2/map has no map; the last one has no cells; r2 is left out" in err
    assert_refused(run_cli("merge", bag, "--json", "-", "--topics", "/r2/map"), "/r2/map", "no cells")


def whole_file(bag: Path) -> Path:
    return bag if bag.is_file() else next(f for f in bag.iterdir() if f.name != "metadata.yaml")


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.98])
def test_bags_cut_off_are_one_line(kind: str, share: float, tmp_path: Path) -> None:
    bag = write_bag(bag_path(tmp_path, kind), team(), kind)
    file = whole_file(bag)
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * share)])
    before = set(os.listdir(tmp_path))
    assert_refused(run_cli("merge", bag, "-o", tmp_path / "out"), str(bag), "is it complete?", "mends")
    assert set(os.listdir(tmp_path)) == before


@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_bags_never_crash(kind: str, tmp_path: Path) -> None:
    """Bytes overwritten anywhere: a merge of what is still whole, or one line about the bag."""
    bag = write_bag(bag_path(tmp_path, kind), team(), kind)
    file = whole_file(bag)
    content = file.read_bytes()
    rng = np.random.default_rng(7)
    for _ in range(12):
        spoilt = bytearray(content)
        start = int(rng.integers(len(spoilt)))
        spoilt[start : start + 60] = rng.bytes(len(spoilt[start : start + 60]))
        file.write_bytes(spoilt)
        code, _, err = run_cli("merge", bag, "--json", "-", "-q")
        assert code in (0, 2), err
        if code == 2:
            assert err.startswith(f"mapmeld: {bag}: ")
            assert err.count("\n") == 1


def test_what_is_no_bag(tmp_path: Path) -> None:
    to = ("--json", "-")
    assert_refused(run_cli("merge", tmp_path / "none.mcap", *to), "none.mcap", "no such file")
    for name in ("text.mcap", "text.db3", "text.bag"):
        (tmp_path / name).write_text("hello, this is no bag at all; " * 9)
        assert_refused(run_cli("merge", tmp_path / name, *to), name, "cannot be read as a bag")
    (tmp_path / "folder").mkdir()
    assert_refused(run_cli("merge", tmp_path / "folder", *to), "folder", "is a folder", "bag")
    (tmp_path / "folder" / "metadata.yaml").write_text("a: [1")
    assert_refused(run_cli("merge", tmp_path / "folder", *to), "folder", "cannot be read as a bag")
    (tmp_path / "folder" / "metadata.yaml").write_text("a: 1")
    assert_refused(run_cli("merge", tmp_path / "folder", *to), "folder", "cannot be read as a bag")


def test_output_never_replaces_a_part_of_a_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", team())
    before = {f.name: f.read_bytes() for f in bag.iterdir()}
    assert_refused(run_cli("merge", bag, "-o", bag), str(bag), "--force")
    assert_refused(run_cli("merge", bag, "--json", bag / "run.mcap"), "--json", "bag")
    assert_refused(run_cli("merge", bag / "run.mcap", "--json", bag / "run.mcap"), "--json", "bag")
    assert {f.name: f.read_bytes() for f in bag.iterdir()} == before


def test_without_the_library(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", team())
    code = (
        "import sys; sys.modules['rosbags'] = None; sys.argv[1:] = sys.argv[1:]\n"
        "from mapmeld.cli import main; main()"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, "merge", str(bag), "--json", "-"], capture_output=True, text=True
    )
    assert_refused((run.returncode, run.stdout, run.stderr), str(bag), "rosbags", "pip install rosbags")
    files: Sequence[str] = save(tmp_path / "maps", [LEFT, MIDDLE])
    run = subprocess.run([sys.executable, "-c", code, "merge", *files, "--json", "-"], capture_output=True)
    assert run.returncode == 0
