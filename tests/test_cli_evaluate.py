"""`mapmeld evaluate` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mapmeld import OccupancyGrid, se2
from rooms import TRUTH, assert_refused, building, run_cli, save


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A folder with maps/, truth.json and the output of a merge in out/."""
    paths = save(tmp_path / "maps", building())
    names = list(TRUTH)
    pairs = [
        {
            "a": a,
            "b": b,
            "T_a_b": se2.compose(se2.inverse(TRUTH[a]), TRUTH[b]).tolist(),
            "overlap": 0.5,
            "overlap_occupied": 0.5,
        }
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    ]
    truth = {
        "resolution": 0.1,
        "maps": [{"name": n, "T_world_map": list(TRUTH[n])} for n in names],
        "pairs": pairs,
    }
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    assert run_cli("merge", *paths, "-o", tmp_path / "out", "-q")[0] == 0
    return tmp_path


def test_table(case: Path) -> None:
    code, out, err = run_cli(
        "evaluate", case / "out/result.json", case / "truth.json", "--maps", case / "maps"
    )
    assert (code, err) == (0, "")
    assert "Maps: 3 of 3 right together" in out
    assert "Acceptance: holds" in out


def test_json(case: Path) -> None:
    to = ("evaluate", case / "out/result.json", case / "truth.json", "--maps", case / "maps")
    code, out, err = run_cli(*to, "--json")
    assert (code, err) == (0, "")
    contents = json.loads(out)
    assert contents["summary"]["right"] == 3
    assert contents["summary"]["wrong"] == 0
    assert all(p["translation_error_m"] < 0.15 for p in contents["pairs"])


def test_a_moved_map_is_wrong(case: Path) -> None:
    file = case / "out" / "result.json"
    result = json.loads(file.read_text())
    placed = next(m for m in result["maps"] if m["name"] == "right")
    placed["T_component_map"][0] += 3.0
    file.write_text(json.dumps(result))
    code, out, _ = run_cli("evaluate", file, case / "truth.json", "--maps", case / "maps", "--json")
    assert code == 0
    assert json.loads(out)["summary"]["wrong"] == 2
    assert run_cli("evaluate", file, case / "truth.json", "--maps", case / "maps", "--strict")[0] == 3


def test_strict_lets_a_right_result_pass(case: Path) -> None:
    to = ("evaluate", case / "out/result.json", case / "truth.json", "--maps", case / "maps")
    assert run_cli(*to, "--strict")[0] == 0
    truth = json.loads((case / "truth.json").read_text())
    (case / "truth.json").write_text(json.dumps({**truth, "pairs": []}))
    code, out, _ = run_cli(*to, "--strict")
    assert code == 0, "nothing to judge is nothing wrong"
    assert "nothing to judge" in out


def test_strict_asks_for_acceptance_where_nothing_is_wrong(case: Path) -> None:
    file = case / "out" / "result.json"
    result = json.loads(file.read_text())
    right = next(m for m in result["maps"] if m["name"] == "right")
    right["T_component_map"][0] += 0.6
    file.write_text(json.dumps(result))
    to = ("evaluate", file, case / "truth.json", "--maps", case / "maps")
    code, out, _ = run_cli(*to, "--strict")
    assert code == 3
    assert "0 wrong" in out
    assert "Acceptance: fails" in out


def test_the_truth_of_another_case_is_refused(case: Path) -> None:
    left, *others = building()
    other = save(
        case / "other", [OccupancyGrid(left.data[:-3], left.resolution, left.origin, "left"), *others]
    )
    to = ("evaluate", case / "out/result.json", case / "truth.json", "--maps", Path(other[0]).parent)
    assert_refused(run_cli(*to), "left.yaml", "another")
    save(case / "other", [OccupancyGrid(left.data, left.resolution, (10.0, 20.0, 0.0), "left")])
    assert_refused(run_cli(*to), "left.yaml", "another")
    for path in (case / "maps").iterdir():
        path.unlink()
    assert run_cli(*to)[0] == 0, "where the maps that were merged are gone, names must do"


def test_bad_input_is_one_line(case: Path) -> None:
    result, truth = case / "out" / "result.json", case / "truth.json"
    assert_refused(run_cli("evaluate", case / "none.json", truth), "none.json", "cannot be read")
    assert_refused(run_cli("evaluate", result, case / "none.json"), "none.json", "cannot be read")
    assert_refused(run_cli("evaluate", result, truth), "no map file", "left")
    assert_refused(run_cli("evaluate", case / "maps" / "left.yaml", truth), "left.yaml", "JSON")
    assert_refused(run_cli("evaluate", truth, result, "--maps", case / "maps"), "truth.json", "swapped")
    assert_refused(run_cli("evaluate", case / "maps", truth), "result.json", "cannot be read")


def test_folders_stand_for_the_files_in_them(case: Path) -> None:
    options = ("--maps", case / "maps", "--json")
    expected = run_cli("evaluate", case / "out" / "result.json", case / "truth.json", *options)
    assert expected[0] == 0
    assert run_cli("evaluate", case / "out", case, *options) == expected
