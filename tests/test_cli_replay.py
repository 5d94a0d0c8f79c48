"""`mapmeld replay` with real bags of growing maps."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags import FORMATS, START, Record, bag_path, grid_record, text_record, update_record, write_bag
from mapmeld import OccupancyGrid, read_map, se2
from mapmeld.drawing import Drawing
from mapmeld.estimate import EstimatedComponent
from mapmeld.estimator import Estimator
from mapmeld.map_inputs import choose_robots, open_bags
from mapmeld.metrics import evaluate_files
from mapmeld.output import write_output
from mapmeld.replay import Moment, Replay
from mapmeld.replay_files import result_of_estimate
from rooms import TRUTH, assert_refused, blank, building, hall, relative_error, run_cli, save, view

FILES = {"estimates.jsonl", "development.png", "merged.yaml", "merged.pgm", "result.json", "report.png"}
MAPMELD = [sys.executable, "-c", "from mapmeld.cli import main; main()"]
RANGES = {"left": (-0.5, 9.0), "middle": (2.0, 12.0), "right": (5.0, 15.0)}


def growing(steps: int = 6, period: float = 3.0) -> list[Record]:
    """The building's three robots, who see more of it from map to map; each comes a little later."""
    records = [text_record(0.0)]
    for i, (name, (x0, x1)) in enumerate(RANGES.items()):
        for k in range(1, steps + 1):
            grid = view(name, (x0, x0 + (x1 - x0) * k / steps), TRUTH[name])
            records.append(grid_record(1 + period * k + 2.2 * i, f"/{name}/map", grid))
    return sorted(records, key=lambda r: r.seconds)


def replayed(*paths: Path, step: float = 1.0, topics: list[str] | None = None) -> tuple[Replay, list[Moment]]:
    with open_bags(paths) as bags:
        run = Replay(choose_robots(bags, topics, []), Estimator(), step)
        return run, list(run)


def read_lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "estimates.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("kind", ["rosbag1", "sqlite3", "mcap"])
def test_the_main_job(kind: str, tmp_path: Path) -> None:
    bag = write_bag(bag_path(tmp_path / "bags", kind), growing(), kind)
    code, out, err = run_cli("replay", bag, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert set(os.listdir(tmp_path / "out")) == FILES
    assert set(os.listdir(tmp_path)) == {"bags", "out"}

    lines = read_lines(tmp_path / "out")
    assert len(lines) > 6
    assert [r["name"] for r in lines[0]["robots"]] == ["left"]
    times = [line["since_start"] for line in lines]
    assert times == sorted(set(times))
    assert all(line["time"] == pytest.approx(START + line["since_start"]) for line in lines)
    last = lines[-1]
    assert {r["name"]: r["status"] for r in last["robots"]} == dict.fromkeys(RANGES, "merged")
    assert len(last["components"]) == 1
    assert last["components"][0]["is_world"]
    # Apart at first, together in the end: that is what a replay shows.
    assert lines[0]["components"] == [{"names": ["left"], "anchor": "left", "is_world": True}]
    poses = {r["name"]: np.array(r["T_world_map"]) for r in last["robots"]}
    assert poses["left"] == pytest.approx([0, 0, 0])
    for a, b in (("left", "middle"), ("left", "right")):
        metres, radians = relative_error(poses[a], poses[b], a, b)
        assert metres < 0.15
        assert radians < 0.03
    assert "merged" in out
    assert f"{len(lines)} estimates" in out


def test_the_last_files_agree_with_each_other(tmp_path: Path) -> None:
    bag = write_bag(
        tmp_path / "run",
        [*growing(), grid_record(30, "/far/map", hall()), grid_record(31, "/new/map", blank())],
    )
    code, _, err = run_cli("replay", bag, "-o", tmp_path / "out")
    assert code == 0
    assert "map far: no evidence" in err
    assert "map new: blank" in err
    assert set(os.listdir(tmp_path / "out")) == FILES | {"merged_2.yaml", "merged_2.pgm"}
    last = read_lines(tmp_path / "out")[-1]
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for robot, placed in zip(last["robots"], result["maps"], strict=True):
        for key, value in robot.items():
            if key == "T_world_map":
                assert placed["T_component_map"] == value
            elif key in placed and value is not None:
                assert placed[key] == value
    assert [c["reference"] for c in result["components"]] == ["left", "far", "new"]
    assert result["components"][0]["shared_cells"] > 1000
    new = next(r for r in last["robots"] if r["name"] == "new")
    assert (new["component"], new["T_world_map"], new["covariance"]) == (None, None, None)
    # Hypotheses are told in the frames of the estimate.
    best = {m["name"]: np.array(m["T_component_map"]) for m in result["hypotheses"][0]["maps"]}
    together = [m for m in result["maps"] if m["status"] == "merged"]
    assert [m["name"] for m in together] == list(RANGES)
    for placed in together:
        assert best[placed["name"]] == pytest.approx(placed["T_component_map"], abs=0.1)
    # The walls of a robot's last map are in the merged map where the estimate says.
    merged = read_map(tmp_path / "out" / "merged.yaml")
    grid = building()[1]
    rows, cols = np.nonzero(grid.data == 100)
    pose = next(r["T_world_map"] for r in last["robots"] if r["name"] == "middle")
    points = se2.apply(pose, grid.cell_centers(rows, cols)) - merged.origin[:2]
    cells = np.floor(points / merged.resolution).astype(int)
    # Blurred by a cell, since rotation draws walls anew.
    walls = np.zeros((merged.height + 2, merged.width + 2), bool)
    for dr in range(3):
        for dc in range(3):
            walls[dr : dr + merged.height, dc : dc + merged.width] |= merged.data == 100
    assert walls[cells[:, 1] + 1, cells[:, 0] + 1].mean() > 0.95


def test_the_end_is_what_a_merge_says(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", growing())
    assert run_cli("replay", bag, "-o", tmp_path / "out", "-q") == (0, "", "")
    last = json.loads((tmp_path / "out" / "result.json").read_text())
    merge = json.loads(run_cli("merge", bag, "--json", "-")[1])
    poses = [{m["name"]: m["T_component_map"] for m in r["maps"]} for r in (last, merge)]
    for name in ("middle", "right"):
        a, b = (se2.compose(se2.inverse(p["left"]), p[name]) for p in poses)
        assert a == pytest.approx(b, abs=0.05)


def test_recorded_maps_with_truth(shared_data: Path, tmp_path: Path) -> None:
    case = shared_data / "mazeA_k3_drift"
    grids = [read_map(path) for path in sorted(case.glob("*.yaml"))]
    records = []
    for i, grid in enumerate(grids):
        half = np.array(grid.data)
        half[:, grid.width // 2 :] = -1
        first = OccupancyGrid(half, grid.resolution, grid.origin, grid.name)
        records += [
            grid_record(i, f"/{grid.name}/map", first),
            grid_record(10 + i, f"/{grid.name}/map", grid),
        ]
    bag = write_bag(tmp_path / "run.bag", sorted(records, key=lambda r: r.seconds), "rosbag1-lz4")
    assert run_cli("replay", bag, "-o", tmp_path / "out", "-q")[0] == 0
    assert evaluate_files(tmp_path / "out" / "result.json", case / "truth.json").summary.wrong == 0
    assert len(read_lines(tmp_path / "out")) == 6


def test_steps(tmp_path: Path) -> None:
    grids = [OccupancyGrid(np.full((4, 5), i, np.int8), 0.1) for i in range(8)]
    seconds = [0.2, 0.5, 1.0, 1.1, 2.6, 2.7, 2.8, 9.9]
    bag = write_bag(
        tmp_path / "run",
        [text_record(0), *(grid_record(s, "/r/map", g) for s, g in zip(seconds, grids, strict=True))],
    )

    def at(step: float) -> list[float]:
        return [m.since_start for m in replayed(bag, step=step)[1]]

    assert at(1.0) == pytest.approx([1.0, 1.1, 2.8, 9.9])
    assert at(0.0) == pytest.approx(seconds)
    assert at(2.0) == pytest.approx([1.1, 2.8, 9.9])
    assert at(100.0) == pytest.approx([9.9])


def test_unchanged_maps_make_no_estimate(tmp_path: Path) -> None:
    same = [grid_record(s, "/r/map", hall()) for s in (0, 2, 4)]
    moved = OccupancyGrid(hall().data, 0.1, (9.0, 2.0, 0.0))
    bag = write_bag(
        tmp_path / "run", [*same, grid_record(6, "/r/map", moved), grid_record(8, "/r/map", moved)]
    )
    assert [m.since_start for m in replayed(bag)[1]] == [0, 6]


def test_updates_make_estimates(tmp_path: Path) -> None:
    dot = np.full((1, 1), 100)
    records = [
        text_record(0),
        update_record(1, "/r/map", 0, 0, dot),
        grid_record(2, "/r/map", blank()),
        update_record(4, "/r/map", 3, 5, dot),
        update_record(4.1, "/r/map", 4, 5, dot),
        update_record(6, "/r/map", 5, 5, dot),
        update_record(8, "/r/map", 5, 5, dot),
    ]
    run, moments = replayed(write_bag(tmp_path / "run", records))
    assert [m.since_start for m in moments] == pytest.approx([2, 4, 4.1, 6])
    expected = np.full((20, 30), -1)
    expected[5, 3:6] = 100
    assert (run.maps["r"].data == expected).all()


def test_several_bags_side_by_side(tmp_path: Path) -> None:
    whole = write_bag(tmp_path / "whole", growing())
    parts = [
        write_bag(tmp_path / name / "scout", [r for r in growing() if r.topic == f"/{name}/map"], "sqlite3")
        for name in RANGES
    ]
    one, many = replayed(whole)[1], replayed(*parts)[1]
    assert [m.nanoseconds for m in many][-1] == [m.nanoseconds for m in one][-1]
    assert [r.name for r in many[-1].robots] == list(RANGES)
    for a, b in zip(one[-1].robots, many[-1].robots, strict=True):
        assert b.T_world_map == pytest.approx(a.T_world_map, abs=0.05)


def test_a_robot_without_a_map(tmp_path: Path) -> None:
    def clear(message: Any) -> None:
        message.info.width = message.info.height = 0
        message.data = np.zeros(0, np.int8)

    empty = grid_record(0, "/r2/map", hall(), clear)
    bag = write_bag(tmp_path / "run", [empty, grid_record(1, "/r1/map", hall())])
    code, _, err = run_cli("replay", bag, "-o", tmp_path / "out")
    assert code == 0
    assert "/r2/map has no map with cells; r2 is left out" in err
    bag = write_bag(tmp_path / "empty", [empty])
    assert_refused(run_cli("replay", bag, "-o", tmp_path / "out2"), "empty", "no map with cells", "/r2/map")
    later = [empty, grid_record(1, "/r2/map", hall())]
    assert len(replayed(write_bag(tmp_path / "later", later))[1]) == 1


def test_blank_maps_alone(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [grid_record(0, "/r/map", blank())])
    assert run_cli("replay", bag, "-o", tmp_path / "out")[0] == 0
    assert set(os.listdir(tmp_path / "out")) == FILES - {"merged.yaml", "merged.pgm"}


def test_options(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", growing(3))
    to = ("replay", bag, "-o", tmp_path / "out")
    assert run_cli(*to, "--set", "seed=7", "--topics", "/left/map,/right/map", "-q")[0] == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["seed"] == 7
    assert [m["name"] for m in result["maps"]] == ["left", "right"]
    assert_refused(run_cli(*to, "--set", "sed=7"), "--set sed=7")
    for step in ("-1", "nan", "inf"):
        assert_refused(run_cli(*to, f"--step={step}"), "--step", "seconds")
    assert_refused(run_cli(*to, "--topics", "/none"), "/none", "/left/map (3 maps)")
    assert_refused(
        run_cli("replay", tmp_path / "no.mcap", "-o", tmp_path / "out2"), "no.mcap", "no such file"
    )
    (saved,) = save(tmp_path / "maps", [hall()])
    assert_refused(run_cli("replay", saved, "-o", tmp_path / "out2"), "hall.yaml", "no bag")
    assert_refused(run_cli("replay", bag, bag, "-o", tmp_path / "out2"), "twice")
    assert not (tmp_path / "out2").exists()


def test_folders_of_earlier_replays_and_merges(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", growing(3))
    out = tmp_path / "out"
    assert run_cli("replay", bag, "-o", out, "-q")[0] == 0
    assert run_cli("replay", bag, "-o", out, "-q")[0] == 0
    assert run_cli("merge", bag, "-o", out, "-q")[0] == 0
    assert not {"estimates.jsonl", "development.png"} & set(os.listdir(out))
    assert run_cli("replay", bag, "-o", out, "-q")[0] == 0
    (out / "mine.txt").write_text("mine")
    assert_refused(run_cli("replay", bag, "-o", out), "mine.txt", "--force")
    assert run_cli("replay", bag, "-o", out, "-q", "--force")[0] == 0
    assert (out / "mine.txt").read_text() == "mine"


def test_bad_messages_end_it_and_leave_nothing(tmp_path: Path) -> None:
    def spoil(message: Any) -> None:
        message.info.resolution = 0.0

    records = [*growing(2), grid_record(40, "/left/map", hall(), spoil)]
    bag = write_bag(tmp_path / "run", records)
    assert_refused(
        run_cli("replay", bag, "-o", tmp_path / "out"), "/left/map", "+40.000 s", "info.resolution"
    )
    assert os.listdir(tmp_path) == ["run"]


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_cut_off_leaves_nothing(kind: str, tmp_path: Path) -> None:
    bag = write_bag(bag_path(tmp_path, kind), growing(2), kind)
    file = bag if bag.is_file() else next(f for f in bag.iterdir() if f.name != "metadata.yaml")
    file.write_bytes(file.read_bytes()[:-400])
    before = os.listdir(tmp_path)
    assert_refused(run_cli("replay", bag, "-o", tmp_path / "out"), str(bag))
    assert os.listdir(tmp_path) == before


def test_names_with_markup(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "[red]run$x$", [grid_record(0, "/map", hall())])
    code, out, _ = run_cli("replay", bag, "-o", tmp_path / "out")
    assert code == 0
    assert "[red]run$x$" in out


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process")
def test_ctrl_c_leaves_nothing_behind(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", growing(60, 0.2))
    child = subprocess.Popen(
        [*MAPMELD, "replay", str(bag), "-o", str(tmp_path / "out"), "--step", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        drafts = list(tmp_path.glob(".mapmeld-*/new/estimates.jsonl"))
        if drafts and drafts[0].stat().st_size:
            break
        time.sleep(0.01)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert (child.returncode, out) == (130, "")
    assert err.startswith("mapmeld: interrupted")
    assert "Traceback" not in err
    assert os.listdir(tmp_path) == ["run"]


def test_an_arrangement_that_the_merge_did_not_find(tmp_path: Path) -> None:
    """An estimate may hold on to what the last merge says otherwise; what nobody counted is null."""
    estimator = Estimator()
    for grid in building():
        estimator.update(grid)
    estimate = estimator.estimate()
    (together,) = estimate.components
    alone = EstimatedComponent(("right",), "right", False, Drawing([(building()[2], (0.0, 0.0, 0.0))], {}))
    robots = [
        dataclasses.replace(r, component=1, T_world_map=np.zeros(3), status="no evidence")
        if r.name == "right"
        else r
        for r in estimate.robots
    ]
    held = dataclasses.replace(
        estimate,
        components=(dataclasses.replace(together, names=("left", "middle")), alone),
        robots=tuple(robots),
    )
    result = result_of_estimate(held, {"total": 1.0})
    write_output(tmp_path / "out", result, building())
    told = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [c["order"] for c in told["components"]] == [["left", "middle"], ["right"]]
    assert [c["merged"] for c in told["components"]] == ["merged.yaml", "merged_2.yaml"]
    assert told["components"][0]["shared_cells"] is None
    assert told["components"][0]["conflict_cells"] is None
    assert told["maps"][2]["T_component_map"] == [0, 0, 0]
    assert told["probability"] == pytest.approx(robots[0].probability * robots[1].probability)
    assert told["seconds"]["total"] == 1.0
    # The hypothesis is still that of the merge, seen from the anchor.
    best = {m["name"]: m["T_component_map"] for m in told["hypotheses"][0]["maps"]}
    assert best["left"] == pytest.approx([0, 0, 0])
    metres, radians = relative_error(np.array(best["left"]), np.array(best["right"]), "left", "right")
    assert metres < 0.2
    assert radians < 0.03


def test_maps_count_as_done_after_a_quiet_time_and_at_the_end(tmp_path: Path) -> None:
    """What is clear enough for a merge alone is told when the maps have come to rest."""
    left, _, _ = building()
    middle = view("middle", (4.0, 6.1), TRUTH["middle"])
    records = [grid_record(1, "/left/map", left), grid_record(2, "/middle/map", middle)]

    def told(*more: Record) -> list[tuple[float, int]]:
        bag = write_bag(tmp_path / f"run{len(more)}", [*records, *more])
        assert run_cli("replay", bag, "-o", bag.parent / f"{bag.name}_out", "-q")[0] == 0
        lines = read_lines(bag.parent / f"{bag.name}_out")
        return [(line["since_start"], len(line["components"])) for line in lines]

    assert told() == [(0.0, 1), (1.0, 1)]
    # Maps that are as they were do not count as changes; one that comes later does.
    still = [grid_record(s, "/left/map", left) for s in (12, 21, 23)]
    assert told(*still) == [(0.0, 1), (1.0, 2), (21.0, 1)]
    late = [*still, grid_record(30, "/far/map", hall())]
    assert told(*late) == [(0.0, 1), (1.0, 2), (21.0, 1), (29.0, 2)]
