"""`mapmeld studio` from the outside: what it refuses before it serves."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

from rooms import assert_refused, building, run_cli, save
from studio_page import studio


@pytest.fixture
def maps(tmp_path: Path) -> list[str]:
    return save(tmp_path / "maps", building()[:2])


def test_a_port_in_use_is_told(tmp_path: Path, maps: list[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        outcome = run_cli("studio", *maps, "-o", tmp_path / "out", "--port", port)
    assert_refused(outcome, f"--port {port}: cannot be used", "choose another one")


def test_a_second_workbench_at_a_port_is_refused(tmp_path: Path, maps: list[str]) -> None:
    with studio(maps, tmp_path / "out") as url:
        port = url.split(":")[2].split("/")[0]
        assert_refused(run_cli("studio", *maps, "-o", tmp_path / "out", "--port", port), "cannot be used")


def test_a_session_of_other_maps_is_refused(tmp_path: Path, maps: list[str]) -> None:
    assert run_cli("merge", *maps, "-o", tmp_path / "out", "--pin", "left=0,0,0")[0] == 0
    session = tmp_path / "out" / "session.json"
    others = save(tmp_path / "others", building())
    outcome = run_cli("studio", *others, "-o", tmp_path / "new", "--session", session)
    assert_refused(outcome, "session.json: does not fit these maps", "right")
    known = json.loads(session.read_text())
    known["known"]["pins"][0]["T_world_map"] = [0, 0]
    session.write_text(json.dumps(known))
    assert_refused(run_cli("studio", *maps, "--session", session), "pins[0]", "T_world_map")


def test_a_folder_that_cannot_be_saved_to_is_told_at_once(tmp_path: Path, maps: list[str]) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    assert_refused(run_cli("studio", *maps, "-o", tmp_path / "out"), "mine.txt")


def test_what_is_not_installed_is_told() -> None:
    code = (
        "import sys\nsys.modules['uvicorn'] = None\nsys.argv = ['mapmeld', 'studio', 'a.yaml']\n"
        "from mapmeld.cli import main\nmain()"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 2
    assert "pip install starlette uvicorn" in run.stderr
    assert run.stderr.count("\n") == 1


def test_nothing_is_left_where_nothing_was_saved(tmp_path: Path, maps: list[str]) -> None:
    with studio(maps, tmp_path / "out"):
        pass
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_it_soon_even_during_a_solve(tmp_path: Path, shared_data: Path) -> None:
    maps = sorted((shared_data / "intel_k10_drift").glob("*.yaml"))
    with studio(maps, tmp_path / "out") as url:
        body = json.dumps({"tab": "t", "do": "solve"}).encode()
        urlopen(Request(f"{url}act", body)).read()
        # A tab that listens does not keep it either.
        news = urlopen(f"{url}events?tab=t", timeout=20)
        assert news.readline().startswith(b"event: state")
        started = time.monotonic()
    assert time.monotonic() - started < 10


def test_the_browser_is_opened_without_telling_the_token_to_others(tmp_path: Path, maps: list[str]) -> None:
    # A browser of our own, which notes what it was called with and what it was shown.
    noted, shown = tmp_path / "noted", tmp_path / "shown"
    program = tmp_path / "browser"
    program.write_text(f'#!/bin/sh\necho "$1" > {noted}\ncat "${{1#file://}}" > {shown}\n')
    program.chmod(0o755)
    command = [sys.executable, "-m", "mapmeld", "studio", *maps, "-o", str(tmp_path / "out")]
    environment = {**os.environ, "BROWSER": str(program), "DISPLAY": ":7"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        address = next(line.strip() for line in process.stdout if "http://" in line)
        end = time.monotonic() + 20
        while not shown.exists() or address not in shown.read_text():
            assert time.monotonic() < end
            time.sleep(0.05)
        assert address not in noted.read_text()
        folder = Path(noted.read_text().strip().removeprefix("file://")).parent
        assert folder.stat().st_mode & 0o077 == 0
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    assert not folder.exists()
