"""`mapmeld merge` with priors, pins, points, forbidden pairs and sessions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mapmeld.cli import build_app
from rooms import building, save


def run(*args: str) -> tuple[int, str]:
    found = CliRunner().invoke(build_app(), ["merge", *args])
    return found.exit_code, found.output


@pytest.fixture
def maps(tmp_path: Path) -> list[str]:
    return save(tmp_path / "maps", building())


def test_what_is_known_is_told_in_the_result_and_kept_in_a_session(tmp_path: Path, maps: list[str]) -> None:
    out = tmp_path / "out"
    told = ["--pin", "left=1,2,0.5", "--prior", "right=9,5,1.4,1,1,0.2", "--forbid", "left,right"]
    code, text = run(*maps, "-o", str(out), *told)
    assert code == 0, text
    result = json.loads((out / "result.json").read_text())
    assert result["known"]["pins"] == [{"name": "left", "T_world_map": [1.0, 2.0, 0.5]}]
    assert result["known"]["forbidden"] == [["left", "right"]]
    assert result["maps"][0]["status"] == "pinned"
    session = json.loads((out / "session.json").read_text())
    assert session["known"] == result["known"]

    again = tmp_path / "again"
    code, text = run(*maps, "-o", str(again), "--session", str(out / "session.json"))
    assert code == 0, text
    for name in ("merged.pgm", "merged.yaml", "session.json"):
        assert (again / name).read_bytes() == (out / name).read_bytes()
    replayed = json.loads((again / "result.json").read_text())
    del result["seconds"], replayed["seconds"]
    assert replayed == result


def test_a_session_may_be_replayed_into_its_own_folder(tmp_path: Path, maps: list[str]) -> None:
    out = tmp_path / "out"
    assert run(*maps, "-o", str(out), "--pin", "left=1,2,0.5", "--seed", "7")[0] == 0
    before = (out / "session.json").read_text()
    assert run(*maps, "-o", str(out), "--session", str(out / "session.json"))[0] == 0
    assert (out / "session.json").read_text() == before
    assert json.loads((out / "result.json").read_text())["seed"] == 7


def test_a_session_of_other_maps_is_refused(tmp_path: Path, maps: list[str]) -> None:
    out = tmp_path / "out"
    assert run(*maps, "-o", str(out), "--pin", "left=1,2,0.5")[0] == 0
    session = ["--session", str(out / "session.json"), "-o", str(tmp_path / "other")]
    code, text = run(*maps[:2], *session)
    assert (code, "session.json: does not fit these maps" in text, "right" in text) == (2, True, True)
    image = Path(maps[0]).with_suffix(".pgm")
    image.write_bytes(image.read_bytes()[:-1] + b"\x00")
    code, text = run(*maps, *session)
    assert (code, "have changed since: left" in text) == (2, True)
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("{", "is not a JSON file"),
        ("{}", "is no session"),
        ('{"session": 1, "maps": [], "config": {}, "known": 3}', "must be objects"),
        ('{"session": 1, "maps": [], "config": {}, "known": {"priors": []}}', "'pins' is missing"),
        ('{"session": 1, "maps": [], "config": {"seeds": 1}, "known": {}}', "session.json: config"),
    ],
)
def test_a_broken_session_is_named(tmp_path: Path, maps: list[str], content: str, text: str) -> None:
    path = tmp_path / "session.json"
    path.write_text(content)
    code, output = run(*maps, "--session", str(path), "--json", "-")
    assert (code, "session.json" in output, text in output) == (2, True, True), output


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (["--pin", "left=1,2"], "--pin left=1,2: must be NAME=X,Y,THETA"),
        (["--pin", "left=1,2,nan"], "must be NAME=X,Y,THETA"),
        (["--prior", "left=1,2,3"], "must be NAME=X,Y,THETA,SX,SY,STHETA"),
        (["--prior", "left=1,2,3,0,1,1"], "--prior left=1,2,3,0,1,1: SX, SY and STHETA must be positive"),
        (["--pin", "left=1,2,0", "--pin", "left=1,3,0"], "--pin left=1,3,0: --pin left=1,2,0 gives that map"),
        (["--pin", "left=1,2,0", "--prior", "left=1,3,0,1,1,1"], "gives that map a pose as well; keep one"),
        (["--points", "left,right=1,2,3"], "must be A,B=XA,YA,XB,YB"),
        (["--points", "left=1,2,3,4"], "names of two maps"),
        (["--forbid", "left"], "names of two maps"),
        (["--forbid", "left,lift"], "no map is called 'lift'"),
    ],
)
def test_bad_options_are_named(maps: list[str], args: list[str], text: str) -> None:
    code, output = run(*maps, "--json", "-", *args)
    assert (code, text in output) == (2, True), output
