"""Every example runs as its first lines say, and says something true."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from mapmeld.map_io import read_map

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(name: str, folder: Path, *arguments: str) -> str:
    """What the example prints; it must end well and quietly. It runs elsewhere, as a user may."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_there_is_a_test_for_each() -> None:
    tested = set(re.findall(r'run\("(\w+\.py)"', Path(__file__).read_text()))
    assert tested == {path.name for path in EXAMPLES.glob("*.py")}


def test_merge_files(tmp_path: Path) -> None:
    text = run("01_merge_files.py", tmp_path, str(tmp_path / "out"))
    assert text.count(": merged,") == 10
    merged = read_map(tmp_path / "out" / "merged.yaml")
    assert (merged.data == 100).sum() > 2000
    assert (tmp_path / "out" / "report.png").stat().st_size > 10_000


def test_look_at_a_pair(tmp_path: Path) -> None:
    rows = run("02_look_at_a_pair.py", tmp_path).splitlines()
    table = [
        [float(v) for v in row.split()[:7]]
        for row in rows
        if row.endswith(("corners", "segments", "correlation"))
        and not row.endswith(": corners")
        and row.startswith("  ")
    ]
    assert table
    log_likelihood = [row[3] for row in table]
    assert log_likelihood == sorted(log_likelihood, reverse=True)
    # The truth of the pair.
    assert table[0][:3] == pytest.approx([11.67, 16.39, -156.4], abs=0.2)
    assert log_likelihood[0] > 20


def test_compare_perception(tmp_path: Path) -> None:
    text = run("03_compare_perception.py", tmp_path)
    assert "oriented_walls: 10 of 10 maps right, 0 pairs wrong" in text
    assert "psi_gamma: " in text
    assert len(re.findall(r" m, [0-9.]+ degrees off", text)) >= 9
