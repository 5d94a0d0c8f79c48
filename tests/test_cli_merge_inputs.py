"""What `mapmeld merge` takes for maps: files, folders of them, the same one twice; and what --strict says."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from mapmeld import OccupancyGrid
from rooms import assert_refused, blank, building, hall, run_cli, save


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
    cut = tmp_path / "maps" / "cut.yaml"
    cut.write_text("image: cut.pgm\nresolution: 0.05\n")
    to = ("merge", tmp_path / "maps", "-o", tmp_path / "out")
    assert_refused(run_cli(*to), "cut.yaml", "origin")
    cut.write_text("resolution: 0.05\norigin: [0, 0, 0]\n")
    assert_refused(run_cli(*to), "cut.yaml", "image")
    cut.write_bytes(b"\x00image: \xff")
    assert_refused(run_cli(*to), "cut.yaml", "UTF-8")
    cut.unlink()
    (tmp_path / "maps" / "left.yaml").write_text("")
    assert_refused(run_cli(*to), "left.yaml", "mapping")


def test_one_map_under_two_names_is_told(tmp_path: Path) -> None:
    left, middle, _ = building()
    again = OccupancyGrid(left.data.copy(), left.resolution, (5.0, 0.0, 1.0), "again")
    unknown = [OccupancyGrid(np.full((9, 9), -1, dtype=np.int8), 0.1, (0.0, 0.0, 0.0), n) for n in "pq"]
    mirrored = OccupancyGrid(left.data[:, ::-1], left.resolution, left.origin, "mirrored")
    coarser = OccupancyGrid(left.data, 2 * left.resolution, left.origin, "coarser")
    paths = save(tmp_path / "maps", [left, middle, again, mirrored, coarser, *unknown])
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert "maps left and again are the same, cell by cell" in err
    assert err.count("cell by cell") == 1, "blank maps are told of as blank"


def test_strict_ends_with_3_where_maps_stay_apart(tmp_path: Path) -> None:
    one, two = (save(tmp_path / f, [*building(), *more]) for f, more in (("one", []), ("two", [hall()])))
    assert run_cli("merge", *one, "-o", tmp_path / "out", "--strict")[0] == 0
    assert run_cli("merge", *two, "-o", tmp_path / "apart", "--strict")[0] == 3
    assert (tmp_path / "apart" / "merged_2.yaml").is_file(), "all is written"
    code, out, _ = run_cli("merge", *two, "--json", "-", "--strict")
    assert code == 3
    assert json.loads(out)["components"], "and printed"
    nothing = save(tmp_path / "nothing", [blank()])
    assert run_cli("merge", *one, *nothing, "-o", tmp_path / "out", "--strict")[0] == 0, "one merged map"
    assert run_cli("merge", *nothing, "-o", tmp_path / "none", "--strict")[0] == 3, "no merged map"


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


@pytest.fixture
def robots(tmp_path: Path) -> list[str]:
    """As each robot's map_saver leaves them: robot1/map.yaml, robot2/map.yaml, ..."""
    named = zip(("robot1", "robot2", "robot3"), building(), strict=True)
    maps = [(n, OccupancyGrid(g.data, g.resolution, g.origin, "map")) for n, g in named]
    return [path for n, g in maps for path in save(tmp_path / n, [g])]


def test_files_called_alike_are_called_with_their_folders(tmp_path: Path, robots: list[str]) -> None:
    lone = save(tmp_path, [hall()])
    to = ("-o", tmp_path / "out", "--order", "robot2/map,robot1/map")
    code, out, _ = run_cli("merge", *robots, *lone, *to)
    assert code == 0
    assert names(tmp_path / "out") == ["robot1/map", "robot2/map", "robot3/map", "hall"]
    assert "robot3/map" in out
    order = json.loads((tmp_path / "out" / "result.json").read_text())["components"][0]["order"]
    assert order[:2] == ["robot2/map", "robot1/map"]


def test_as_many_folders_as_tell_them_apart(
    tmp_path: Path, robots: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = [save(tmp_path / n / "maps", [g]) for n, g in zip("ab", building()[:2], strict=True)]
    for (path,), n in zip(deep, "ab", strict=True):
        Path(path).rename(tmp_path / n / "maps" / "map.yaml")
    monkeypatch.chdir(tmp_path / "robot1")
    code, _, _ = run_cli("merge", "map.yaml", "../robot2/map.yaml", "../a/maps", "../b/maps", "-o", "../out")
    assert code == 0
    assert names(tmp_path / "out") == ["robot1/map", "robot2/map", "a/maps/map", "b/maps/map"]


def test_a_report_knows_moved_files_by_the_names_they_were_merged_with(
    tmp_path: Path, robots: list[str]
) -> None:
    assert run_cli("merge", *robots, "-o", tmp_path / "out", "-q")[0] == 0
    result = tmp_path / "out" / "result.json"
    assert run_cli("report", result)[0] == 0
    (tmp_path / "robot3").rename(tmp_path / "elsewhere")
    assert_refused(run_cli("report", result), "robot3/map", "not there any more")
    moved = tmp_path / "elsewhere" / "map.yaml"
    assert_refused(run_cli("report", result, moved), "robot3/map", "folder")
    (tmp_path / "else").mkdir()
    (tmp_path / "elsewhere").rename(tmp_path / "else" / "robot3")
    moved = tmp_path / "else" / "robot3" / "map.yaml"
    assert run_cli("report", result, moved)[0] == 0
    assert_refused(run_cli("report", result, moved, robots[0], robots[0]), "twice")
    assert_refused(run_cli("report", result, moved, tmp_path / "no.mcap"), "no.mcap", "no map called 'no'")


def test_what_a_folder_holds_besides_is_told_or_refused(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    (left, *_) = save(folder, building())
    (folder / "params.yaml").write_text("amcl: {}\n")
    (folder / ".hidden.yaml").write_text("image: none.pgm\n")
    (folder / "deploy.yaml").write_text("a: 1\n---\nspec:\n  image_topic: nginx\n")
    (folder / "latest.yaml").symlink_to(left)
    assert run_cli("merge", folder, "-o", folder, "--force", "-q")[0] == 0
    (folder / "newest.yaml").symlink_to(folder / "merged.yaml")
    code, out, _ = run_cli("merge", folder, "-o", tmp_path / "out", "-v")
    assert code == 0
    assert names(tmp_path / "out") == ["left", "middle", "right"]
    assert "params.yaml: is no saved map" in out
    assert "merged.yaml: an earlier merge wrote it" in out
    (folder / "run.mcap").write_bytes(b"")
    assert_refused(run_cli("merge", folder, "-o", tmp_path / "x"), "maps", "a bag")
    deep = tmp_path / "deep"
    save(deep / "robot1", [hall()])
    assert_refused(run_cli("merge", deep, "-o", tmp_path / "x"), "deep", "robot1")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffimage: {}.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n{rest}",
        '{{\n  "image": "{}.pgm",\n  "resolution": 0.1, "origin": [0, 0, 0], "negate": 0,\n'
        '  "occupied_thresh": 0.65, "free_thresh": 0.196\n}}\n',
    ],
)
def test_yaml_in_any_form_is_found_in_a_folder(tmp_path: Path, text: str) -> None:
    left, middle, right = building()
    save(tmp_path / "maps", [left, middle, right])
    rest = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "maps" / "middle.yaml").write_text(text.format("middle", rest=rest), encoding="utf-8")
    (tmp_path / "maps" / "right.yaml").rename(tmp_path / "maps" / "right.YML")
    assert run_cli("merge", tmp_path / "maps", "-o", tmp_path / "out", "-q")[0] == 0
    assert names(tmp_path / "out") == ["left", "middle", "right"]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="nothing is closed to this user")
def test_a_folder_that_is_closed_is_one_line(tmp_path: Path) -> None:
    save(tmp_path / "maps", building())
    (tmp_path / "maps").chmod(0)
    try:
        assert_refused(run_cli("merge", tmp_path / "maps", "-o", tmp_path / "out"), "maps", "who may read")
    finally:
        (tmp_path / "maps").chmod(0o755)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_pipes_and_links_in_circles_are_one_line(tmp_path: Path) -> None:
    save(tmp_path / "maps", building())
    os.mkfifo(tmp_path / "maps" / "pipe.yaml")
    to = ("merge", tmp_path / "maps", "-o", tmp_path / "out")
    assert_refused(run_cli(*to), "pipe.yaml", "regular file")
    (tmp_path / "maps" / "pipe.yaml").unlink()
    (tmp_path / "maps" / "loop.yaml").symlink_to("loop.yaml")
    assert_refused(run_cli(*to), "loop.yaml")
    assert_refused(run_cli("merge", tmp_path / "maps" / "loop.yaml", "-o", tmp_path / "out"), "loop.yaml")


def test_maps_that_lack_a_class_of_cells_are_told(tmp_path: Path) -> None:
    left, middle, _ = building()
    values = {"bare": (-1, 100, -1), "open": (-1, 0, 0), "full": (0, 100, 0)}
    changed = []
    for name, (unknown, occupied, free) in values.items():
        cells = np.select([left.data < 0, left.data >= 65], [unknown, occupied], free).astype(np.int8)
        changed.append(OccupancyGrid(cells, left.resolution, left.origin, name))
    paths = save(tmp_path / "maps", [middle, blank(), hall(), *changed])
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    for name, lack in (("bare", "free"), ("open", "occupied"), ("full", "unknown")):
        assert err.count(f"map {name} has no {lack} cell") == err.count(f"map {name} has no") == 1
    # A closed hall that ends at its walls lacks nothing.
    assert err.count("has no") == 3
    assert "more occupied cells" not in err


def test_a_map_drawn_the_other_way_round_is_told(tmp_path: Path) -> None:
    left, middle, _ = building()
    paths = save(tmp_path / "maps", [left, middle])
    described = Path(paths[0]).read_text()
    assert "negate: 0" in described
    Path(paths[0]).write_text(described.replace("negate: 0", "negate: 1"))
    code, _, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert re.search(r"map left has more occupied cells \(\d+\) than free ones \(\d+\).*`negate`", err), err
    assert "map middle has" not in err


def test_a_place_that_is_not_there_is_told(tmp_path: Path) -> None:
    assert_refused(
        run_cli("merge", tmp_path / "mpas", "-o", tmp_path / "out"), "mpas", "no such file or folder"
    )
