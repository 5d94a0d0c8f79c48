"""What `mapmeld merge` takes for maps: files, folders of them, the same one twice; and what --strict says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mapmeld import OccupancyGrid
from rooms import assert_refused, building, hall, run_cli, save


def names(folder: Path) -> list[str]:
    return [m["name"] for m in json.loads((folder / "result.json").read_text())["maps"]]


def test_a_folder_stands_for_the_maps_in_it(tmp_path: Path) -> None:
    save(tmp_path / "maps", building())
    (tmp_path / "maps" / "nav2_params.yaml").write_text("amcl:\n  ros__parameters:\n    image: no\n")
    (tmp_path / "maps" / "notes.txt").write_text("image: none\n")
    lone = save(tmp_path, [hall()])
    code, _, err = run_cli("merge", tmp_path / "maps", *lone, "-o", tmp_path / "out")
    assert code == 0
    assert names(tmp_path / "out") == ["left", "middle", "right", "hall"]
    assert "2 components" in err


def test_a_folder_without_maps_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "params.yaml").write_text("amcl: {}\n")
    assert_refused(run_cli("merge", tmp_path / "empty", "-o", tmp_path / "out"), "empty", "no bag")
    assert not (tmp_path / "out").exists()


def test_a_broken_map_in_a_folder_is_not_passed_over(tmp_path: Path) -> None:
    save(tmp_path / "maps", building())
    (tmp_path / "maps" / "cut.yaml").write_text("image: cut.pgm\nresolution: 0.05\n")
    assert_refused(run_cli("merge", tmp_path / "maps", "-o", tmp_path / "out"), "cut.yaml", "origin")


def test_one_map_under_two_names_is_told(tmp_path: Path) -> None:
    left, middle, _ = building()
    again = OccupancyGrid(left.data.copy(), left.resolution, (5.0, 0.0, 1.0), "again")
    blank = [OccupancyGrid(np.full((9, 9), -1, dtype=np.int8), 0.1, (0.0, 0.0, 0.0), n) for n in "pq"]
    paths = save(tmp_path / "maps", [left, middle, again, *blank])
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert "maps left and again are the same, cell by cell" in err
    assert err.count("cell by cell") == 1, "blank maps are told of as blank"


def test_strict_ends_with_3_where_maps_stay_apart(tmp_path: Path) -> None:
    one, two = (save(tmp_path / f, [*building(), *more]) for f, more in (("one", []), ("two", [hall()])))
    assert run_cli("merge", *one, "-o", tmp_path / "out", "--strict")[0] == 0
    assert run_cli("merge", *two, "-o", tmp_path / "apart", "--strict")[0] == 3
    assert (tmp_path / "apart" / "merged_2.yaml").is_file(), "all is written"


def test_a_lone_map_says_so(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [hall()])
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert "map hall: no evidence: it is the only map" in err


def test_origins_are_written_without_noise(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", building())
    assert run_cli("merge", *paths, "-o", tmp_path / "out", "-q")[0] == 0
    line = next(t for t in (tmp_path / "out" / "merged.yaml").read_text().split("\n") if "origin" in t)
    assert all(len(v.strip()) < 8 for v in line.partition("[")[2].rstrip("]").split(",")), line


def test_files_called_alike_are_called_with_their_folders(tmp_path: Path) -> None:
    """As each robot's map_saver leaves them: robot1/map.yaml, robot2/map.yaml."""
    paths = []
    for robot, g in zip(("robot1", "robot2", "robot3"), building(), strict=True):
        (tmp_path / robot).mkdir()
        paths += save(tmp_path / robot, [OccupancyGrid(g.data, g.resolution, g.origin, "map")])
    paths += save(tmp_path, [hall()])
    code, out, _ = run_cli("merge", *paths, "-o", tmp_path / "out", "--order", "robot2/map,robot1/map")
    assert code == 0
    assert names(tmp_path / "out") == ["robot1/map", "robot2/map", "robot3/map", "hall"]
    assert "robot3/map" in out
    assert run_cli("report", tmp_path / "out" / "result.json")[0] == 0
    # Moved away, a file is known by the name that it was merged with.
    (tmp_path / "robot3").rename(tmp_path / "elsewhere")
    assert_refused(run_cli("report", tmp_path / "out" / "result.json"), "robot3/map", "not there any more")
    (tmp_path / "else").mkdir()
    (tmp_path / "elsewhere").rename(tmp_path / "else" / "robot3")
    moved = tmp_path / "else" / "robot3" / "map.yaml"
    assert run_cli("report", tmp_path / "out" / "result.json", moved)[0] == 0
    twin = save(tmp_path / "twin" / "robot1", [OccupancyGrid(hall().data, 0.1, (0.0, 0.0, 0.0), "map")])
    assert_refused(run_cli("merge", paths[0], *twin, "-o", tmp_path / "x"), "robot1/map", "rename one")
