"""`mapmeld merge` as a user types it."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import mapmeld
from mapmeld import OccupancyGrid, read_map
from mapmeld.merge_view import summary_table
from mapmeld.metrics import evaluate_files
from rooms import assert_refused, blank, building, hall, run_cli, save
from test_merge_api import SLOW_MERGE

FILES = {"merged.yaml", "merged.pgm", "result.json", "report.png"}
MAPMELD = [sys.executable, "-c", "from mapmeld.cli import main; main()"]


def command(*args: object) -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own."""
    return subprocess.run([*MAPMELD, *map(str, args)], capture_output=True, text=True, timeout=60)


def without_seconds(text: str) -> list[str]:
    lines = text.splitlines()
    kept = [line for line in lines if not line.startswith(' "seconds"')]
    assert len(kept) == len(lines) - 1
    return kept


def without_places(text: str) -> str:
    """A result without the paths of its maps, which depend on where it lies."""
    return re.sub(r'"path": "[^"]*"', '"path": ""', text)


def test_the_main_job(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", building())
    run = command("merge", *paths, "-o", tmp_path / "site")
    assert (run.returncode, run.stderr) == (0, "")
    assert set(os.listdir(tmp_path / "site")) == FILES
    assert set(os.listdir(tmp_path)) == {"maps", "site"}
    rows = [line for line in run.stdout.splitlines() if re.match(r" ?(left|middle|right) ", line)]
    assert len(rows) == 3
    assert all("merged" in row for row in rows)
    result = json.loads((tmp_path / "site" / "result.json").read_text())
    assert [m["name"] for m in result["maps"]] == ["left", "middle", "right"]
    assert {"prepare", "register", "filter", "merge", "read", "write", "report", "total"} <= set(
        result["seconds"]
    )
    merged = read_map(tmp_path / "site" / "merged.yaml")
    steps = np.array(merged.origin[:2]) / merged.resolution
    assert np.allclose(steps, np.round(steps), atol=1e-9)
    assert merged.origin[2] == 0.0


def test_the_same_bytes_with_one_and_two_threads(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [*building(), hall()])
    outputs = []
    for i, threads in enumerate((1, 2, 2)):
        folder = tmp_path / f"out{i}"
        assert run_cli("merge", *paths, "-o", folder, "--seed", 7, "--threads", threads, "-q")[0] == 0
        outputs.append(folder)
    texts = [without_seconds((folder / "result.json").read_text()) for folder in outputs]
    assert texts[0] == texts[1] == texts[2]
    for name in ("merged.pgm", "merged_2.pgm", "merged.yaml", "report.png"):
        assert len({(folder / name).read_bytes() for folder in outputs}) == 1


def test_recorded_maps_with_truth(shared_data: Path, tmp_path: Path) -> None:
    case = shared_data / "mazeA_k6_drift"
    paths = sorted(case.glob("*.yaml"))
    texts = []
    for threads in (1, 2):
        code, _, _ = run_cli("merge", *paths, "-o", tmp_path / "out", "--threads", threads, "-q")
        assert code == 0
        texts.append(without_seconds((tmp_path / "out" / "result.json").read_text()))
    assert texts[0] == texts[1]
    assert evaluate_files(tmp_path / "out" / "result.json", case / "truth.json").summary.wrong == 0


def test_json_on_stdout_is_all_there_is(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [*building(), blank()])
    run = command("merge", *paths, "--json", "-")
    assert run.returncode == 0
    assert json.loads(run.stdout)["maps"][0]["name"] == "left"
    assert "blank" in run.stderr
    assert set(os.listdir(tmp_path)) == {"maps"}
    code, out, err = run_cli("merge", *paths, "--json", "-", "-q", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert without_places(out) == without_places((tmp_path / "out" / "result.json").read_text())


def test_json_into_a_file(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [hall()])
    code, out, _ = run_cli("merge", *paths, "--json", tmp_path / "r.json", "-o", tmp_path / "out")
    assert code == 0
    assert "hall" in out
    written, in_folder = ((tmp_path / p).read_text() for p in ("r.json", "out/result.json"))
    assert without_places(written) == without_places(in_folder)
    # Each names the maps as seen from where it lies.
    files = [json.loads(text)["maps"][0]["file"]["path"] for text in (written, in_folder)]
    assert files == ["maps/hall.yaml", "../maps/hall.yaml"]
    to = ("merge", *paths, "-o", tmp_path / "out2")
    assert_refused(run_cli(*to, "--json", tmp_path), "--json", "no file")
    assert_refused(run_cli(*to, "--json", tmp_path / "no" / "r.json"), "--json", "no file")
    assert_refused(run_cli(*to, "--json", paths[0]), "--json", "one of the maps")
    assert not (tmp_path / "out2").exists()


def test_an_order_that_names_nothing(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", building())
    assert_refused(run_cli("merge", *paths, "-o", tmp_path / "out", "--order", " , "), "--order", "no map")


def test_quiet_and_verbose(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [*building(), hall()])
    assert run_cli("merge", *paths, "-o", tmp_path / "out", "-q") == (0, "", "")
    code, out, err = run_cli("merge", *paths, "-o", tmp_path / "out", "-v")
    assert code == 0
    assert re.search(r"pair left, middle: merged, probability [01]\.\d\d, [0-9.]+ m of wall", out)
    assert "component 1: hall" in out
    assert "2 components" in err
    assert "Wrote" in out


def test_names_with_markup_are_shown_as_they_are(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [hall("[red]hall[bold] $x$"), blank("bl [b] ank")])
    code, out, err = run_cli("merge", *paths, "-o", tmp_path / "out", "-v")
    assert code == 0
    assert "[red]hall[bold] $x$" in out
    assert "bl [b] ank" in out + err


def test_one_map_and_blank_maps_are_results(tmp_path: Path) -> None:
    one, nothing = save(tmp_path / "maps", [hall(), blank()])
    assert run_cli("merge", one, "-o", tmp_path / "one")[0] == 0
    assert set(os.listdir(tmp_path / "one")) == FILES
    code, out, err = run_cli("merge", nothing, "-o", tmp_path / "nothing")
    assert code == 0
    assert "blank" in out
    assert "no known cell" in err
    assert set(os.listdir(tmp_path / "nothing")) == {"result.json", "report.png"}
    result = json.loads((tmp_path / "nothing" / "result.json").read_text())
    assert result["maps"][0]["status"] == "blank"
    assert result["maps"][0]["T_component_map"] is None


def test_components_get_files_of_their_own(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", [hall(), *building()])
    code, out, err = run_cli("merge", *paths, "-o", tmp_path / "out")
    assert code == 0
    assert "no evidence" in out
    assert "2 components" in err
    alone = read_map(tmp_path / "out" / "merged_2.yaml")
    assert (alone.data == 100).sum() == (hall().data == 100).sum()


def test_order_and_reference(tmp_path: Path) -> None:
    paths = save(tmp_path / "maps", building())
    to = ("merge", *paths, "-o", tmp_path / "out")
    assert run_cli(*to, "--order", "right, middle,left")[0] == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["order"] == ["right", "middle", "left"]
    assert run_cli(*to, "--reference", "left")[0] == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["components"][0]["reference"] == "left"
    assert_refused(run_cli(*to, "--order", "right,lift"), "order", "'lift'", "left, middle, right")
    assert_refused(run_cli(*to, "--order", "right,right"), "order", "'right' twice")
    assert_refused(run_cli(*to, "--reference", "lift"), "reference", "'lift'", "left, middle, right")
    assert_refused(run_cli(*to, "--order", "left", "--reference", "right"), "order", "reference")


def test_resolution(tmp_path: Path) -> None:
    coarse = OccupancyGrid(hall().data[::2, ::2], 0.2, hall().origin, "coarse")
    paths = save(tmp_path / "maps", [*building(), coarse])
    assert run_cli("merge", *paths, "-o", tmp_path / "out", "-q")[0] == 0
    assert read_map(tmp_path / "out" / "merged.yaml").resolution == 0.1
    assert run_cli("merge", *paths, "-o", tmp_path / "out", "-q", "--resolution", 0.25)[0] == 0
    merged = read_map(tmp_path / "out" / "merged.yaml")
    assert merged.resolution == 0.25
    steps = np.array(merged.origin[:2]) / 0.25
    assert np.allclose(steps, np.round(steps), atol=1e-9)
    to = ("merge", *paths, "-o", tmp_path / "out2")
    assert_refused(run_cli(*to, "--resolution", "0.00001"), "fuse.resolution", "coarser")
    assert not (tmp_path / "out2").exists()


def test_the_same_file_or_name_twice(tmp_path: Path) -> None:
    (a,) = save(tmp_path / "a", [hall("site")])
    b = Path(a).with_suffix(".yml")
    b.write_text(Path(a).read_text())
    (tmp_path / "link.yaml").symlink_to(a)
    to = ("-o", tmp_path / "out")
    assert_refused(run_cli("merge", a, a, *to), a, "twice", "once")
    assert_refused(run_cli("merge", a, tmp_path / "a" / ".." / "a" / "site.yaml", *to), "twice")
    assert_refused(run_cli("merge", a, tmp_path / "link.yaml", *to), "link.yaml", "twice")
    assert_refused(run_cli("merge", a, b, *to), str(b), a, "suffix", "rename")
    assert not (tmp_path / "out").exists()


PGM = b"P5\n4 3\n255\n" + bytes([0, 254, 205, 254] * 3)
BAD_MAPS = {
    "no image": (dict(image="none.pgm"), PGM, ["hall.yaml", "none.pgm"]),
    "truncated": ({}, PGM[:-5], ["hall.pgm"]),
    "no image at all": ({}, b"hello", ["hall.pgm"]),
    "huge": ({}, b"P5\n900000 900000\n255\n", ["hall.pgm"]),
    "empty": ({}, b"P5\n0 0\n255\n", ["hall.pgm"]),
    "no resolution": (dict(resolution=None), PGM, ["hall.yaml", "resolution", "missing"]),
    "no origin": (dict(origin=None), PGM, ["hall.yaml", "origin", "missing"]),
    "text": (dict(resolution="fine"), PGM, ["hall.yaml", "resolution", "number"]),
    "nan": (dict(origin="[0, .nan, 0]"), PGM, ["hall.yaml", "origin", "finite"]),
    "negative": (dict(resolution="-0.05"), PGM, ["hall.yaml", "resolution", "positive"]),
    "zero": (dict(resolution="0"), PGM, ["hall.yaml", "resolution", "positive"]),
    "thresholds": (dict(occupied_thresh="0.1"), PGM, ["hall.yaml", "free_thresh", "occupied_thresh"]),
    "mode": (dict(mode="grey"), PGM, ["hall.yaml", "mode", "trinary"]),
}


@pytest.mark.parametrize("case", BAD_MAPS)
def test_bad_maps_are_one_line(case: str, save_map: Callable[..., Path], tmp_path: Path) -> None:
    fields, content, words = BAD_MAPS[case]
    path = save_map(content, **fields)
    (good,) = save(tmp_path / "good", [hall("good")])
    assert_refused(run_cli("merge", good, path, "-o", tmp_path / "out"), *words)
    assert set(os.listdir(tmp_path)) == {"hall.yaml", "hall.pgm", "good"}
    assert_refused(run_cli("inspect", path, "-o", tmp_path / "x.png"), *words)
    assert not (tmp_path / "x.png").exists()


def test_bad_paths_are_one_line(tmp_path: Path) -> None:
    (good,) = save(tmp_path, [hall()])
    to = ("-o", tmp_path / "out")
    assert_refused(run_cli("merge", good, tmp_path / "none.yaml", *to), "none.yaml", "no such file")
    assert_refused(run_cli("merge", good, tmp_path / "hall.pgm", *to), "hall.pgm")
    assert_refused(run_cli("merge", good, tmp_path, *to), str(tmp_path))
    assert_refused(run_cli("merge", good), "-o", "--json")
    assert not (tmp_path / "out").exists()


def test_bad_output_folders_are_one_line(tmp_path: Path) -> None:
    (good,) = save(tmp_path / "maps", [hall()])
    (tmp_path / "file").write_text("mine")
    assert_refused(run_cli("merge", good, "-o", tmp_path / "file"), "file", "no folder")
    assert_refused(run_cli("merge", good, "-o", tmp_path / "file" / "out"), "out", "cannot be written")
    assert_refused(run_cli("merge", good, "-o", tmp_path / "maps"), "hall.pgm", "--force")
    assert run_cli("merge", good, "-o", tmp_path / "maps", "--force", "-q")[0] == 0
    assert set(os.listdir(tmp_path / "maps")) == FILES | {"hall.yaml", "hall.pgm"}
    merged = tmp_path / "maps" / "merged.yaml"
    assert_refused(run_cli("merge", merged, "-o", tmp_path / "maps", "--force"), "merged.yaml", "input")


def test_usage_errors_exit_with_2(tmp_path: Path) -> None:
    for arguments in (["merge"], ["merge", "a.yaml", "--seed", "x"], ["nonsense"], ["merge", "--nonsense"]):
        run = command(*arguments)
        assert run.returncode == 2
        assert "Traceback" not in run.stderr
        assert run.stdout == ""


def test_bad_input_in_a_process_of_its_own(tmp_path: Path) -> None:
    run = command("merge", tmp_path / "none.yaml", "-o", tmp_path / "out")
    assert_refused((run.returncode, run.stdout, run.stderr), "none.yaml", "no such file")


def test_version_and_help() -> None:
    run = command("--version")
    assert (run.returncode, run.stdout) == (0, f"mapmeld {mapmeld.__version__}\n")
    for arguments in (["--help"], ["merge", "--help"]):
        run = command(*arguments)
        assert run.returncode == 0
        assert "130 interrupted" in " ".join(run.stdout.replace("│", " ").split())


def test_the_version_is_told_without_loading_much() -> None:
    code = (
        "import sys\nsys.argv = ['mapmeld', '--version']\nfrom mapmeld.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('numpy', 'matplotlib', 'PIL', 'yaml') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"


def test_internal_errors_are_one_line_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("broken\nbadly")

    (good,) = save(tmp_path / "maps", [hall()])
    monkeypatch.setattr("mapmeld.merging.merge", fail)
    code, out, err = run_cli("merge", good, "-o", tmp_path / "out")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert "RuntimeError: broken badly" in err
    assert set(os.listdir(tmp_path)) == {"maps"}


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process")
def test_ctrl_c_leaves_nothing_behind(tmp_path: Path) -> None:
    # The maps of the API's test, saved; enough work for some seconds.
    code = SLOW_MERGE.split("told = False")[0]
    code += f"[mapmeld.write_map({str(tmp_path)!r} + f'/{{m.name}}', m) for m in maps]"
    subprocess.run([sys.executable, "-c", code], check=True)
    args = [
        "merge",
        *map(str, sorted(tmp_path.glob("*.yaml"))),
        "-o",
        str(tmp_path / "out"),
        "--particles",
        "2000",
    ]
    before = set(os.listdir(tmp_path))
    child = subprocess.Popen([*MAPMELD, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 20
    while set(os.listdir(tmp_path)) == before and time.monotonic() < deadline:
        time.sleep(0.01)  # until the staging folder shows that work has begun
    time.sleep(0.5)
    started = time.perf_counter()
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert time.perf_counter() - started < 2.0
    assert (child.returncode, out) == (130, "")
    assert err.startswith("mapmeld: interrupted")
    assert "Traceback" not in err
    assert set(os.listdir(tmp_path)) == before


def test_no_minus_stands_before_what_rounds_to_zero() -> None:
    result = mapmeld.merge(building(), seed=1)
    placed = [
        dataclasses.replace(m, T_component_map=np.array([-1e-4, -0.0, -1e-5])) if m.name == "left" else m
        for m in result.maps
    ]
    console = Console(file=io.StringIO(), width=200)
    console.print(summary_table(dataclasses.replace(result, maps=tuple(placed))))
    shown = console.file.getvalue()
    row = next(line for line in shown.splitlines() if line.startswith("left"))
    assert row.split()[2:5] == ["0.000", "0.000", "0.00"]
