"""The benchmark scripts: they run, and print the tables that they promise. No time is asserted."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


def run(script: str, *args: str, shared: Path) -> str:
    """What the script prints, without any shared maps."""
    found = subprocess.run(
        [sys.executable, str(BENCHMARKS / script), *args],
        env={**os.environ, "MAPMELD_SHARED": str(shared)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout


def tables(markdown: str) -> list[list[dict[str, str]]]:
    """Every table as its rows, cells by column name."""
    found: list[list[dict[str, str]]] = []
    columns: list[str] = []
    for line in markdown.splitlines():
        if not line.startswith("|"):
            columns = []
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not columns:
            columns = cells
            found.append([])
        elif set(line) - set("|-: "):
            found[-1].append(dict(zip(columns, cells, strict=True)))
    return found


def test_complexity(tmp_path: Path) -> None:
    text = run("complexity.py", "--quick", shared=tmp_path)
    measured, exponents, *times = tables(text)
    assert {row["measured"] for row in measured} >= {"date", "CPU", "versions", "command"}
    assert str(BENCHMARKS.parent) not in text
    assert [(row["order"], row["varied"].split()[-1], row["paper"]) for row in exponents] == [
        ("known", "N", "2"),
        ("known", "c", "2"),
        ("known", "Np", "1"),
        ("unknown", "N", "3"),
        ("unknown", "c", "2"),
        ("unknown", "Np", "1"),
    ]
    assert len(times) == 3
    for varied, rows in zip(("N", "c", "Np"), times, strict=True):
        values = [float(row[varied]) for row in rows if row["order"] == "known"]
        assert len(values) == 3
        assert values == sorted(set(values)), "grows"
        # A filter that stops early would make its times meaningless.
        assert all(row["maps merged"] == row["N"] for row in rows)
        assert all(float(row["register ms"]) > 0 and int(row["candidates"]) > 0 for row in rows)
    # With more maps there are more pairs, with more corners more candidates.
    for rows in times[:2]:
        counts = [int(row["candidates"]) for row in rows if row["order"] == "unknown"]
        assert counts == sorted(set(counts))


@pytest.mark.parametrize("model", ["oriented_walls", "psi_gamma"])
def test_acceptance(model: str, tmp_path: Path) -> None:
    text = run(
        "acceptance.py",
        *("--cases", "maze10", "mazeA_k10", "--seeds", "1", "--particles", "30", "--model", model),
        shared=tmp_path,
    )
    _, cases = tables(text)
    (row,) = cases
    assert row["case"] == "maze10"
    assert row["seeds passed"] in {"1 of 1", "0 of 1"}
    assert (row["goal"] == "met") == (row["seeds passed"] == "1 of 1")
    assert row["maps"].endswith("of 10")
    assert float(row["median s"]) > 0
    assert "Not measured" in text
    assert "mazeA_k10" in text.split("Not measured")[1].splitlines()[0]
    if model == "oriented_walls":
        assert row["seeds passed"] == "1 of 1"
        assert row["wrong"] == "0"


def test_exponents_are_those_of_powers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import complexity

    slope, error = complexity.fit([1, 2, 4, 8], [3.0, 12.0, 48.0, 192.0])
    assert slope == pytest.approx(2.0)
    assert error == pytest.approx(0.0, abs=1e-9)
    slope, error = complexity.fit([1, 2, 4], [1.0, 2.2, 4.0])
    assert slope == pytest.approx(1.0)
    assert error > 0.0
    # Without a spread there is no slope to tell.
    assert math.isnan(complexity.fit([5, 5, 5], [1.0, 2.0, 3.0])[0])


def test_trust(tmp_path: Path) -> None:
    text = run("trust.py", "--quick", "--jobs", "1", "--cache", str(tmp_path / "cache"), shared=tmp_path)
    goals = {row["figure"]: row for table in tables(text) for row in table if "verdict" in row}
    strangers = goals["unrelated pairs: merged"]
    assert (strangers["measured"], strangers["verdict"]) == ("0 of 4", "met")
    assert "No recorded case was found" in text


def test_the_fit_finds_the_weights_it_was_made_with(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import calibrate

    rng = np.random.default_rng(1)
    true = np.array([-9.5, 2.0, -1.0, 0.0])
    features = rng.normal(size=(20_000, 3)) * [1.0, 3.0, 0.5] + [5.0, 1.0, -2.0]
    right = rng.random(20_000) < 1 / (1 + np.exp(-calibrate.log_odds(true, features)))
    once = np.ones(20_000)
    found = calibrate.fit(features, right, once)
    assert found == pytest.approx(true, rel=0.1, abs=0.12)
    # What the walls alone refuse teaches nothing.
    hopeless = np.column_stack([np.full(500, 1.0), np.zeros(500), np.zeros(500)])
    more = np.vstack([features, hopeless]), np.concatenate([right, np.ones(500, dtype=bool)])
    assert calibrate.fit(*more, np.ones(20_500)) == pytest.approx(found)
    # What counts twice counts as what is there twice.
    some = features[:, 1] > 0.0
    twice = np.vstack([features, features[some]]), np.concatenate([right, right[some]])
    assert calibrate.fit(features, right, once + some) == pytest.approx(
        calibrate.fit(*twice, np.ones(len(twice[1]))), rel=1e-2
    )


def test_what_is_left_out_is_not_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two buildings whose features mean the opposite: each is judged by the other's."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import calibrate

    # The root of the log-likelihood comes first: walls enough.
    rows = [
        {"features": [20.0, sign * value], "right": value > 0, "buildings": [name], "group": name}
        for name, sign in (("plus", 1.0), ("minus", -1.0))
        for value in np.linspace(-3, 3, 40).tolist()
    ]
    p = calibrate.left_out(rows)
    right = np.array([r["right"] for r in rows])
    assert ((p > 0.5) != right).mean() > 0.9


def test_speed(shared_data: Path) -> None:
    text = run("speed.py", "--every", "70", "--only", "prepare", "pairs", shared=shared_data.parent)
    _, prepare, pairs = tables(text)
    assert float(prepare[0]["median ms for 500 x 500 cells"]) > 0.0
    assert pairs[-1]["pairs"] == "all"
    assert float(pairs[-1]["median ms"]) > 0.0
    assert int(pairs[-1]["n"]) == sum(int(row["n"]) for row in pairs[:-1])


def test_conditions(shared_data: Path) -> None:
    chosen = ["as they are", "10 %", "turned"]
    text = run("conditions.py", "--every", "45", "--only", *chosen, shared=shared_data.parent)
    _, rows = tables(text)
    assert (rows[0]["maps"], rows[0]["changed"]) == ("as they are", "none")
    assert [row["maps"] for row in rows[1::2]] == [
        "10 % of cells unknown",
        "raster turned by 7 degrees",
        "raster turned by 30 degrees",
    ]
    for row in rows:
        counts = [int(row[k]) for k in ("right", "apart", "near", "wrong")]
        assert sum(counts) == int(row["pairs"]) == 4
        assert counts[0] > 0, row
