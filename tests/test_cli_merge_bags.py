"""`mapmeld merge` with bags: real ones, of every format, written with rosbags."""

from __future__ import annotations

import json
import re
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bags
from bags import FORMATS, bag_path, grid_record, team, text_record, update_record, write_bag
from mapmeld import OccupancyGrid, read_map
from mapmeld.bag import Bag
from mapmeld.metrics import evaluate_files
from rooms import assert_refused, blank, building, hall, run_cli, save

LEFT, MIDDLE, RIGHT = building()


def merged(*args: object) -> dict[str, Any]:
    """The result of a merge that must take everything it is given."""
    code, out, err = run_cli("merge", *args, "--json", "-")
    assert code == 0, err
    assert "is not taken" not in err
    assert "left out" not in err
    result: dict[str, Any] = json.loads(out)
    return result


def names(result: dict[str, Any]) -> list[str]:
    return [m["name"] for m in result["maps"]]


def poses(result: dict[str, Any]) -> np.ndarray:
    return np.array([m["T_component_map"] for m in result["maps"]])


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format(kind: str, tmp_path: Path) -> None:
    bag = write_bag(bag_path(tmp_path, kind), team(), kind)
    files = save(tmp_path / "maps", [LEFT, MIDDLE, RIGHT])
    found = merged(bag, "--seed", 3)
    assert names(found) == ["robot1", "robot2", "robot3"]
    assert np.allclose(poses(found), poses(merged(*files, "--seed", 3)), atol=1e-6)
    assert all(m["status"] == "merged" for m in found["maps"])


@pytest.mark.parametrize("kind", ["mcap", "mcap-storage", "sqlite3"])
def test_a_file_without_its_metadata(kind: str, tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "run", team(), kind)
    (folder / "metadata.yaml").unlink()
    (part,) = folder.iterdir()
    assert names(merged(part)) == ["robot1", "robot2", "robot3"]
    assert (poses(merged(part)) == poses(merged(folder))).all()


def test_a_folder_of_parts_without_metadata(tmp_path: Path) -> None:
    early, late = team()[:4], team()[4:]
    folder = tmp_path / "run"
    folder.mkdir()
    for i, records in enumerate((early, late)):
        part = write_bag(tmp_path / f"part{i}", records)
        (part / f"part{i}.mcap").rename(folder / f"run_{i}.mcap")
    assert np.allclose(poses(merged(folder)), poses(merged(write_bag(tmp_path / "whole", team()))))
    with Bag(folder) as bag:
        assert bag.grids == {f"/robot{i}/map": 2 for i in (1, 2, 3)}


def test_the_packed_parts_of_a_folder_are_not_for_themselves(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "run", team(), "mcap-message")
    assert_refused(
        run_cli("merge", folder / "run.mcap", "--json", "-"), "run.mcap", "/robot1/map", "packed", "folder"
    )
    folder = write_bag(tmp_path / "run2", team(), "sqlite3-file")
    (part,) = folder.glob("*.zstd")
    assert_refused(run_cli("merge", part, "--json", "-"), part.name, "packed", "folder")


def test_an_old_database_without_definitions(tmp_path: Path) -> None:
    """As Humble and those before it write them."""
    folder = write_bag(tmp_path / "run", team(), "sqlite3")
    with sqlite3.connect(folder / "run.db3") as db:
        db.execute("DROP TABLE message_definitions")
        db.execute("DROP TABLE schema")
        db.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
    db.close()
    assert names(merged(folder / "run.db3")) == ["robot1", "robot2", "robot3"]


def test_a_database_that_was_not_closed(tmp_path: Path) -> None:
    """The library would read it without what is still in the log."""
    folder = write_bag(tmp_path / "run", team(), "sqlite3")
    db = sqlite3.connect(folder / "run.db3")
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("UPDATE messages SET timestamp = timestamp + 1")
    db.commit()
    for path in (folder, folder / "run.db3"):
        assert_refused(run_cli("merge", path, "--json", "-"), "run.db3-wal", "wal_checkpoint")
    db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    db.close()
    assert names(merged(folder)) == ["robot1", "robot2", "robot3"]


def test_recorded_maps_with_truth(shared_data: Path, tmp_path: Path) -> None:
    case = shared_data / "mazeA_k3_drift"
    paths = sorted(case.glob("*.yaml"))
    grids = [read_map(path) for path in paths]
    bag = write_bag(tmp_path / "run", [grid_record(i, f"/{g.name}/map", g) for i, g in enumerate(grids)])
    assert run_cli("merge", bag, "-o", tmp_path / "out", "-q")[0] == 0
    summary = evaluate_files(tmp_path / "out" / "result.json", case / "truth.json").summary
    assert summary.wrong == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert names(result) == [g.name for g in grids]
    assert np.allclose(poses(result), poses(merged(*paths)), atol=1e-6)


def test_where_each_map_comes_from(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", team())
    code, out, _ = run_cli("merge", bag, "-o", tmp_path / "out", "-v")
    assert code == 0
    assert re.search(r"robot2: /robot2/map of \S+run, at \+5\.100 s\n", out)


def test_maps_and_bags_mixed(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "scout", [grid_record(0, "/map", MIDDLE)])
    left, right = save(tmp_path / "maps", [LEFT, RIGHT])
    result = merged(left, bag, right)
    assert names(result) == ["left", "scout", "right"]
    assert all(m["status"] == "merged" for m in result["maps"])
    assert merged(left, bag, right, "--order", "left,scout,right")["order"] == ["left", "scout", "right"]


def test_names(tmp_path: Path) -> None:
    def one(name: str, *topics: str) -> Path:
        maps = zip(topics, (LEFT, MIDDLE, RIGHT), strict=False)
        return write_bag(tmp_path / name, [grid_record(i, t, g) for i, (t, g) in enumerate(maps)])

    a, b, c = one("a", "/map"), one("b", "/map"), one("c", "/robot/map")
    assert names(merged(a, b, c)) == ["a", "b", "robot"]
    d = one("d", "/robot/map")
    assert names(merged(c, d)) == ["c/robot", "d/robot"]
    assert names(merged(one("e", "/fleet/r1/map", "/fleet/r2/map"))) == ["fleet/r1", "fleet/r2"]
    f = one("f", "/r1/map", "/r1/old_map")
    assert names(merged(f, "--topics", "r1/old_map,/r1/map")) == ["r1/old_map", "r1/map"]
    (saved,) = save(tmp_path / "maps", [hall("robot")])
    assert names(merged(saved, c)) == ["robot", "c/robot"]
    g = write_bag(tmp_path / "other" / "c", [grid_record(0, "/robot/map", LEFT)])
    assert_refused(run_cli("merge", c, g, "--json", "-"), "'c/robot'", str(c), str(g), "rename")
    assert_refused(run_cli("merge", c, c, "--json", "-"), "twice")


def test_rosbag1_of_several_robots(tmp_path: Path) -> None:
    """Topics of ROS 1 may have no leading slash."""
    a = write_bag(tmp_path / "a.bag", [grid_record(0, "r1/map", LEFT)], "rosbag1")
    b = write_bag(tmp_path / "b.bag", [grid_record(0, "map", MIDDLE)], "rosbag1")
    assert names(merged(a, b)) == ["r1", "b"]
    assert names(merged(a, b, "--topics", "/map,/r1/map")) == ["r1", "b"]


def test_the_guess(tmp_path: Path) -> None:
    def guess(name: str, *topics: str) -> tuple[list[str], str]:
        records = [grid_record(i, t, hall()) for i, t in enumerate(topics)]
        code, out, err = run_cli(
            "merge", write_bag(tmp_path / name, [*records, text_record(9)]), "--json", "-"
        )
        assert code == 0, err
        told = [line for line in err.splitlines() if "is not taken" in line]
        return names(json.loads(out)), "\n".join(told)

    costmaps = ("/r1/global_costmap/costmap", "/r1/local_costmap/costmap", "/r2/global_costmap/costmap")
    assert guess("costmaps", *costmaps, "/r1/map", "/r2/map") == (["r1", "r2"], "")
    assert guess("common", "/r1/grid", "/r2/grid", "/r2/global_costmap/costmap") == (["r1", "r2"], "")
    found, told = guess("odd", "/r1/map", "/r2/map", "/r2/old")
    assert found == ["r1", "r2"]
    assert "/r2/old is not called map" in told
    found, told = guess("merged", "/r1/map", "/r2/map", "/map")
    assert found == ["r1", "r2"]
    assert "/map may be the merged map of the others" in told
    assert guess("base", "/r1/map", "/map") == (["base", "r1"], "")

    bag = write_bag(tmp_path / "tie", [grid_record(0, "/r1/a", hall()), grid_record(1, "/r1/b", hall())])
    assert_refused(run_cli("merge", bag, "--json", "-"), "--topics", "/r1/a (1 map)", "/r1/b (1 map)")
    bag = write_bag(
        tmp_path / "none", [grid_record(0, costmaps[0], hall()), grid_record(1, costmaps[0], hall())]
    )
    assert_refused(run_cli("merge", bag, "--json", "-"), f"{costmaps[0]} (2 maps)")
    bag = write_bag(tmp_path / "text", [text_record(0)])
    assert_refused(run_cli("merge", bag, "--json", "-"), str(bag), "no topics of nav_msgs/msg/OccupancyGrid")


def test_topics(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", team())
    assert names(merged(bag, "--topics", "/robot3/map, robot1/map")) == ["robot3", "robot1"]
    to = ("merge", bag, "--json", "-", "--topics")
    assert_refused(run_cli(*to, "/robot1/map,/robot7/map"), "/robot7/map", "no such", "/robot2/map (2 maps)")
    assert_refused(run_cli(*to, "/chatter"), "/chatter", "std_msgs/msg/String", "/robot2/map (2 maps)")
    assert_refused(run_cli(*to, " , "), "--topics", "names no topic")
    other = write_bag(tmp_path / "other", [grid_record(0, "/map", hall())])
    assert_refused(run_cli("merge", other, *to[1:], "/robot1/map"), str(other), "none of", "/map (1 map)")
    (saved,) = save(tmp_path / "maps", [hall()])
    assert_refused(run_cli("merge", saved, "--json", "-", "--topics", "/map"), "--topics", "no")
    assert_refused(run_cli("merge", saved, "--json", "-", "--at", "3"), "--at", "no")


def cells(path: Path, *args: object, tmp: Path) -> np.ndarray:
    """The one map that is read from a bag, as merge writes it."""
    code, _, err = run_cli("merge", path, "-o", tmp / "out", "-q", *args)
    assert code == 0, err
    return read_map(tmp / "out" / "merged.yaml").data


def walled(share: float) -> OccupancyGrid:
    """A hall that has been seen from the left up to a share of its width."""
    data = np.array(hall().data)
    data[:, round(share * data.shape[1]) :] = -1
    return OccupancyGrid(data, hall().resolution, hall().origin, "hall")


@pytest.mark.parametrize("kind", ["rosbag1", "sqlite3", "mcap"])
def test_at(kind: str, tmp_path: Path) -> None:
    growing = [grid_record(10 * i, "/r/map", walled(i / 4)) for i in (1, 2, 3, 4)]
    bag = write_bag(bag_path(tmp_path, kind), [text_record(0), *growing, text_record(600)], kind)
    counts = [int((walled(i / 4).data >= 0).sum()) for i in (1, 2, 3, 4)]

    def known(*at: object) -> int:
        return int((cells(bag, *at, tmp=tmp_path) >= 0).sum())

    assert known() == counts[3]
    assert known("--at", 10) == counts[0]
    assert known("--at", "+29.999") == counts[1]
    assert known("--at", 30) == counts[2]
    assert known("--at", "1700000025") == counts[1]
    assert known("--at", "2023-11-14T22:13:45Z") == counts[1]
    assert known("--at", 500) == counts[3]
    code, _, err = run_cli("merge", bag, "--json", "-", "--at", 601)
    assert code == 0
    assert "ends at +600.000 s, before 601" in err
    assert_refused(run_cli("merge", bag, "--json", "-", "--at", 9.5), "/r/map", "no map by 9.5", "+10.000 s")
    assert_refused(run_cli("merge", bag, "--json", "-", "--at", "yesterday"), "--at yesterday")


def test_a_robot_that_came_later(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [grid_record(0, "/r1/map", hall()), grid_record(50, "/r2/map", hall())])
    code, out, err = run_cli("merge", bag, "--json", "-", "--at", 20)
    assert code == 0
    assert names(json.loads(out)) == ["r1"]
    assert "/r2/map has no map by 20; the first is at +50.000 s; r2 is left out" in err
    outcome = run_cli("merge", bag, "--json", "-", "--at", 20, "--topics", "/r1/map,/r2/map")
    assert_refused(outcome, str(bag), "/r2/map", "no map by 20", "+50.000 s")


@pytest.mark.parametrize("kind", ["rosbag1", "sqlite3", "mcap"])
def test_updates_are_in_the_map(kind: str, tmp_path: Path) -> None:
    records = [
        update_record(0.5, "/r/map", 0, 0, np.full((4, 4), 100)),
        grid_record(1, "/r/map", blank()),
        update_record(2, "/r/map", 5, 6, np.full((4, 4), 100)),
        update_record(2.5, "/r/map", 7, 6, np.zeros((4, 4))),
        grid_record(3, "/r/other", hall()),
        text_record(500),
    ]
    bag = write_bag(bag_path(tmp_path, kind), records, kind)
    with Bag(bag) as opened:
        last = opened.last_map("/r/map", "r")
        before = opened.last_map("/r/map", "r", opened.start + 1_600_000_000)
        at_first = opened.last_map("/r/map", "r", opened.start + 500_000_000)
        too_early = opened.last_map("/r/map", "r", opened.start + 100_000_000)
        assert last is not None
        assert opened.time(last.nanoseconds) == "+2.000 s"
    expected = np.full((20, 30), -1)
    expected[6:10, 5:7], expected[6:10, 7:11] = 100, 0
    assert (last.grid.data == expected).all()
    assert (last.updates, last.frame) == (2, "map")
    assert before is not None
    assert before.updates == 1
    assert (before.grid.data[6:10, 5:9] == 100).all()
    assert at_first is not None
    assert (at_first.grid.data == -1).all()
    assert too_early is None


def test_updates_far_behind_their_map(tmp_path: Path) -> None:
    """The search goes backwards in windows; what it passes on the way belongs to the map that it finds."""
    dots = [update_record(10 * i, "/r/map", i % 30, i // 30, np.full((1, 1), 100)) for i in range(1, 300)]
    bag = write_bag(tmp_path / "run", [grid_record(0, "/r/map", blank()), *dots])
    with Bag(bag) as opened:
        last = opened.last_map("/r/map", "r")
        halfway = opened.last_map("/r/map", "r", opened.start + 1500 * 10**9)
    assert last is not None
    assert last.updates == 299
    assert (last.grid.data == 100).sum() == 299
    assert halfway is not None
    assert halfway.updates == 150


def test_only_what_is_needed_is_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = write_bag(tmp_path / "run", [grid_record(i, "/r/map", walled(i / 40)) for i in range(1, 41)])
    decoded = []
    decode = Bag._message
    monkeypatch.setattr(Bag, "_message", lambda self, m: decoded.append(m) or decode(self, m))
    with Bag(bag) as opened:
        assert opened.last_map("/r/map", "r") is not None
        assert opened.last_map("/r/map", "r", opened.start + 10**9) is not None
    assert len(decoded) == 2


def test_the_bags_of_the_tests_begin_when_they_say(tmp_path: Path) -> None:
    with Bag(write_bag(tmp_path / "run", team())) as bag:
        assert (bag.start, bag.end) == (int(bags.START * 1e9), int((bags.START + 60) * 1e9))
        assert bag.types["/chatter"] == bags.TEXT
