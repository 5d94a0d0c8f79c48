"""The recording for Rerun: what it holds, and what is said where the library is missing."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mapmeld
from mapmeld.cli_options import with_rerun
from mapmeld.recording import recording
from rooms import assert_refused, blank, building, hall, run_cli, save


def rerun() -> Any:
    return pytest.importorskip("rerun", reason="needs rerun-sdk: pip install '.[rerun]'")


def entities(path: Path) -> dict[str, list[Any]]:
    """The record batches of a recording, by entity."""
    from rerun.chunk import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(str(chunk.entity_path).strip("/"), []).append(chunk.to_record_batch())
    return found


def column(batches: list[Any], name: str) -> list[Any]:
    """The values of the column whose name ends so, over the steps."""
    values = []
    for batch in batches:
        for field, data in zip(batch.schema.names, batch.columns, strict=True):
            if field.endswith(name):
                steps = batch.column("step").to_pylist()
                values += list(zip(steps, data.to_pylist(), strict=True))
    return [v for _, v in sorted(values, key=lambda pair: pair[0]) if v is not None]


def test_events_in_python() -> None:
    heard: list[tuple[str, float, Mapping[str, Any]]] = []
    maps = [*building(), hall()]
    result = mapmeld.merge(maps, seed=1, listener=lambda *event: heard.append(event))
    names = Counter(name for name, _, _ in heard)
    assert names == {"prepared": 1, "registered": 1, "stepped": 2, "refined": names["refined"]}
    assert [s for _, s, _ in heard] == sorted(s for _, s, _ in heard)
    assert heard[-1][1] <= result.seconds["merge"]
    prepared = heard[0][2]["maps"]
    assert [m["map"] for m in prepared] == [0, 1, 2, 3]
    assert prepared[0]["boundary"].shape[1] == prepared[0]["corners"].shape[1] == 2
    steps = [data for name, _, data in heard if name == "stepped"]
    for told, step in zip(steps, result.components[0].steps, strict=True):
        assert told["effective_sample_size"] == step.effective_sample_size
        assert [p["weight"] for p in told["particles"]] == list(step.weights)
    refined = heard[-1][2]["components"][0]
    assert [result.maps[i].name for i in refined["maps"]] == list(result.components[0].order)
    assert refined["covariances"].shape == (3, 3, 3)
    quiet = mapmeld.merge(maps, seed=1)
    assert [m.T_component_map.tolist() for m in result.maps if m.T_component_map is not None] == [
        m.T_component_map.tolist() for m in quiet.maps if m.T_component_map is not None
    ]


def test_what_a_listener_raises_ends_the_merge() -> None:
    def refuse(*event: object) -> None:
        raise ValueError("enough")

    with pytest.raises(ValueError, match="enough"):
        mapmeld.merge(building(), listener=refuse)


def test_a_recording_holds_the_merge(tmp_path: Path) -> None:
    rerun()
    maps = [*building(), hall("a/b [c]"), blank()]
    path = tmp_path / "merge.rrd"
    with recording(path, maps) as recorder:
        result = mapmeld.merge(maps, seed=1, listener=recorder.hear)
        recorder.finish(result)
        assert not path.exists()  # whole or not at all
    assert [p.name for p in tmp_path.iterdir()] == ["merge.rrd"]
    found = entities(path)
    for name in ("left", "middle", "right"):
        assert {f"local/{name}/cells", f"local/{name}/boundary", f"local/{name}/corners"} <= set(found)
        assert f"particles/best/{name}" in found
        assert f"result/component_0/{name}" in found
        assert f"refinement/component_0/{name}" in found
    assert any(path.startswith("local/a\\/b") for path in found), sorted(found)
    assert "pairs/left/middle/b" in found
    steps = result.components[0].steps
    n_eff = [v[0] for v in column(found["plots/n_eff"], "Scalars:scalars")]
    assert n_eff == pytest.approx([s.effective_sample_size for s in steps])
    assert {"plots/psi", "plots/gamma", "plots/weights", "plots/log_evidence", "log"} <= set(found)
    trajectories = column(found["particles/trajectories"], "LineStrips3D:strips")
    assert [len(t) for t in trajectories] == [100] * len(steps)
    assert [len(t[0]) for t in trajectories] == [2, 3]  # one more map a step
    placed = column(found["result/component_0/middle"], "Transform3D:translation")[-1][0]
    T = next(m.T_component_map for m in result.maps if m.name == "middle")
    assert T is not None
    assert np.array(placed)[:2] == pytest.approx(T[:2].tolist(), abs=1e-5)
    timelines = {name for batches in found.values() for b in batches for name in b.schema.names}
    assert {"step", "wall_time", "mode"} <= timelines


def test_a_merge_that_fails_leaves_no_recording(tmp_path: Path) -> None:
    rerun()
    with pytest.raises(ValueError, match="stop"), recording(tmp_path / "merge.rrd", building()):
        raise ValueError("stop")
    assert list(tmp_path.iterdir()) == []


def test_the_command(tmp_path: Path) -> None:
    rerun()
    maps = save(tmp_path / "maps", building())
    code, _, err = run_cli("merge", *maps, "-o", tmp_path / "site", "--rerun", tmp_path / "merge.rrd", "-q")
    assert code == 0, err
    assert "plots/n_eff" in entities(tmp_path / "merge.rrd")


def test_bad_places(tmp_path: Path) -> None:
    rerun()
    maps = save(tmp_path / "maps", building())
    out = ("-o", tmp_path / "site")
    assert_refused(run_cli("merge", *maps, *out, "--rerun=merge.txt"), "--rerun merge.txt", ".rrd")
    nowhere = tmp_path / "no" / "merge.rrd"
    assert_refused(run_cli("merge", *maps, *out, "--rerun", nowhere), str(nowhere), "folder")
    assert not (tmp_path / "site").exists()


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    maps = save(tmp_path / "maps", building())
    for arguments in (["--rerun"], ["--rerun", tmp_path / "merge.rrd"]):
        outcome = run_cli("merge", *maps, "-o", tmp_path / "site", *arguments)
        assert_refused(outcome, "rerun-sdk", "pip install 'rerun-sdk>=0.41")
    monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace(__version__="0.20.0"))
    outcome = run_cli("merge", *maps, "-o", tmp_path / "site", "--rerun")
    assert_refused(outcome, "rerun-sdk 0.20.0 is too old", "pip install")
    assert not (tmp_path / "site").exists()


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["--rerun"], ["--rerun=viewer"]),
        (["--rerun", "a.rrd", "b.yaml"], ["--rerun", "a.rrd", "b.yaml"]),
        (["--rerun", "b.yaml"], ["--rerun=viewer", "b.yaml"]),
        (["--rerun", "-q"], ["--rerun=viewer", "-q"]),
        (["--rerun=a.rrd"], ["--rerun=a.rrd"]),
        (["a.yaml"], ["a.yaml"]),
    ],
)
def test_rerun_alone_opens_the_viewer(typed: list[str], meant: list[str]) -> None:
    assert with_rerun(["merge", *typed]) == ["merge", *meant]
