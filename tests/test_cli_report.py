"""`mapmeld merge --report --figures` and `mapmeld report` as a user types them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from bags import bag_path, grid_record, write_bag
from rooms import assert_refused, building, hall, run_cli, save


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with maps/ and the merge of them in site/, with its report."""
    folder = tmp_path_factory.mktemp("merge")
    (folder / "maps").mkdir()
    maps = save(folder / "maps", [*building(), hall()])
    code, _, err = run_cli(
        "merge", *maps, "-o", folder / "site", "--report", "--figures", folder / "figs", "--seed", "1"
    )
    assert code == 0, err
    return folder


def edited(site: Path, tmp_path: Path, change: Any) -> Path:
    """A copy of the case with its result.json changed."""
    shutil.copytree(site, tmp_path / "case")
    path = tmp_path / "case" / "site" / "result.json"
    result = json.loads(path.read_text())
    change(result)
    path.write_text(json.dumps(result))
    return path


def test_merge_writes_the_page_and_the_pictures(site: Path) -> None:
    assert (site / "site" / "report.html").read_text().startswith("<!doctype html>")
    assert {p.suffix for p in (site / "figs").iterdir()} == {".png", ".svg"}
    assert (site / "figs" / "map_robots.svg").is_file()
    files = [m["file"] for m in json.loads((site / "site" / "result.json").read_text())["maps"]]
    assert files[0] == {"path": "../maps/left.yaml", "topic": None, "nanoseconds": None}


def test_merge_again_replaces_the_page(site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "case")
    maps = sorted((tmp_path / "case" / "maps").glob("*.yaml"))
    code, _, err = run_cli("merge", *maps, "-o", tmp_path / "case" / "site", "-q")
    assert code == 0, err
    assert not (tmp_path / "case" / "site" / "report.html").exists()


def test_report_of_an_earlier_merge(site: Path, tmp_path: Path) -> None:
    code, out, err = run_cli("report", site / "site", "-o", tmp_path / "page.html")
    assert (code, out, err) == (0, f"{tmp_path / 'page.html'}\n", "")

    def without_times(path: Path) -> list[str]:
        lines = path.read_text().splitlines()
        start = lines.index('<section id="times">')
        return lines[:start] + lines[lines.index('<section id="config">') :]

    assert without_times(tmp_path / "page.html") == without_times(site / "site" / "report.html")


def test_a_case_can_be_moved(site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "elsewhere")
    result = tmp_path / "elsewhere" / "site" / "result.json"
    (result.parent / "report.html").unlink()
    code, _, err = run_cli("report", result, "--figures", tmp_path / "figs")
    assert code == 0, err
    assert (result.parent / "report.html").is_file()
    assert (tmp_path / "figs" / "n_eff.png").is_file()


def test_a_bag_is_read_again_as_it_was_taken(tmp_path: Path) -> None:
    """The map at the time that the merge took, not the bag's last one."""
    left, middle, right = building()
    robots = [("/r1/map", left), ("/r2/map", middle), ("/r3/map", right)]
    records = [grid_record(5.0 + k / 10, topic, grid) for k, (topic, grid) in enumerate(robots)]
    later = [grid_record(50.0, topic, hall()) for topic, _ in robots]
    bag = write_bag(bag_path(tmp_path, "mcap"), [*records, *later], "mcap")
    code, _, err = run_cli("merge", bag, "--at", "20", "-o", tmp_path / "site", "--report", "-q")
    assert code == 0, err
    code, _, err = run_cli("report", tmp_path / "site" / "result.json", "-o", tmp_path / "page.html")
    assert code == 0, err
    pages = [(tmp_path / p).read_text() for p in ("page.html", "site/report.html")]
    assert pages[0].split('<section id="times">')[0] == pages[1].split('<section id="times">')[0]
    bag.unlink() if bag.is_file() else shutil.rmtree(bag)
    assert_refused(run_cli("report", tmp_path / "site" / "result.json"), "not there any more")


def test_a_map_that_is_gone(site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "case")
    result = tmp_path / "case" / "site" / "result.json"
    moved = tmp_path / "moved"
    moved.mkdir()
    for name in ("left.yaml", "left.pgm"):
        (tmp_path / "case" / "maps" / name).rename(moved / name)
    assert_refused(run_cli("report", result), "left.yaml", "not there any more", "mapmeld report")
    code, _, err = run_cli("report", result, moved / "left.yaml")
    assert code == 0, err


def test_a_map_that_the_result_does_not_know(site: Path) -> None:
    (site / "other").mkdir(exist_ok=True)
    other = save(site / "other", [hall("other")])[0]
    assert_refused(run_cli("report", site / "site" / "result.json", other), "other.yaml", "no map called")


def drop_file(result: dict[str, Any]) -> None:
    result["maps"][1]["file"] = None


def drop_pose(result: dict[str, Any]) -> None:
    result["maps"][0]["T_component_map"] = None


def bad_order(result: dict[str, Any]) -> None:
    result["components"][0]["order"] = ["left"]


def bad_pair(result: dict[str, Any]) -> None:
    result["pairs"][0]["hits"] = "many"


def drop_steps(result: dict[str, Any]) -> None:
    del result["components"][0]["steps"]


def bad_weights(result: dict[str, Any]) -> None:
    result["components"][0]["steps"][0]["weights"] = []


def bad_config(result: dict[str, Any]) -> None:
    result["config"]["filter"]["particles"] = -1


def bad_hypothesis(result: dict[str, Any]) -> None:
    result["hypotheses"][0]["maps"][0]["name"] = "nobody"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drop_file, ["map middle has no 'file'"]),
        (drop_pose, ["'T_component_map' must be [x, y, theta]"]),
        (bad_order, ["components[0]: 'order' must list"]),
        (bad_pair, ["pairs[0]: 'hits' must be a number"]),
        (drop_steps, ["components[0]: key 'steps' is missing"]),
        (bad_weights, ["components[0]: steps[0]: 'weights'"]),
        (bad_config, ["config", "particles"]),
        (bad_hypothesis, ["hypotheses[0]: maps[0]: 'name'"]),
    ],
)
def test_results_that_are_none(site: Path, tmp_path: Path, change: Any, words: list[str]) -> None:
    assert_refused(run_cli("report", edited(site, tmp_path, change)), "result.json", *words)


def test_bad_places(site: Path, tmp_path: Path) -> None:
    result = site / "site" / "result.json"
    maps = sorted((site / "maps").glob("*.yaml"))
    assert_refused(run_cli("report", result, "-o", tmp_path / "no" / "page.html"), "page.html", "-o")
    assert_refused(run_cli("report", result, "-o", result), "is an input")
    assert_refused(run_cli("report", tmp_path / "none.json"), "none.json: cannot be read")
    assert_refused(run_cli("report", tmp_path / "no" / "result.json"), "result.json: cannot be read")
    assert_refused(run_cli("merge", *maps, "--json", "-", "--report"), "--report", "-o DIR")
    (tmp_path / "file").write_text("")
    assert_refused(
        run_cli("merge", *maps, "-o", tmp_path / "out", "--figures", tmp_path / "file" / "figs"), "--figures"
    )
    assert not (tmp_path / "out").exists()
