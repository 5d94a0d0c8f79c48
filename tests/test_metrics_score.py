"""mapmeld.metrics agrees with the customers' score.py."""

from __future__ import annotations

import importlib.util
import json
import math
import sys
from argparse import Namespace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.metrics import evaluate, evaluate_files
from metrics_cases import BLANK, about, make_result, two


@pytest.fixture
def score(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    path = shared_data.parent / "score.py"
    if not path.is_file():
        pytest.skip(f"no {path}: set MAPMELD_SHARED to the folder with score.py and data/")
    spec = importlib.util.spec_from_file_location("shared_score", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setattr(sys, "argv", ["score.py"])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # the folder is not ours to write to
    # The script ends in an unguarded main(), which leaves for want of arguments: all is defined by then.
    with pytest.raises(SystemExit):
        spec.loader.exec_module(module)
    return module


def test_pair_errors_agree_with_judge_on_random_transforms(score: ModuleType) -> None:
    rng = np.random.default_rng(11)
    seen = set()
    for _ in range(300):
        rms = None if rng.random() < 0.3 else float(rng.uniform(0, 0.7))
        truth = two(rms_m=rms, T_a_b=[*rng.normal(0, 30, 2), rng.uniform(-math.pi, math.pi)])
        centre, res = rng.normal(0, 20, 2), float(rng.choice([0.02, 0.05, 0.1, 0.3]))
        spread = rng.choice([0.1, 0.5, 3.0])
        error = se2.compose([*rng.normal(0, spread, 2), 0.0], about(tuple(centre), rng.normal(0, 5 * spread)))
        T = se2.compose(truth["pairs"][0]["T_a_b"], error)
        result = make_result(truth)
        result["maps"][0]["T_component_map"] = [*rng.normal(0, 9, 2), rng.uniform(-9, 9)]
        result["maps"][1]["T_component_map"] = se2.compose(result["maps"][0]["T_component_map"], T).tolist()
        centres = {"a": (0.0, 0.0), "b": tuple(centre)}
        p = evaluate(result, truth, centres, {"a": res, "b": res}).pairs[0]
        want = score.judge(T.tolist(), truth["pairs"][0], np.array([*centre, 1.0]), res)
        assert p.translation_error_m == pytest.approx(want["te"], abs=1e-9)
        assert p.rotation_error_deg == pytest.approx(want["re"], abs=1e-9)
        assert (p.right, p.fine, p.wrong) == (want["right"], want["fine"], want["wrong"])
        seen.add(p.verdict)
    assert seen == {"fine", "right", "off", "wrong"}


def test_whole_cases_agree_with_multi(
    score: ModuleType, shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    results: dict[str, dict[str, Any]] = {}
    for path in sorted(shared_data.glob("*/truth.json")):
        truth = json.loads(path.read_text())
        moved = {
            m["name"]: BLANK if rng.random() < 0.1 else [*rng.normal(0, 0.15, 2), rng.normal(0, 0.005)]
            for m in truth["maps"]
        }
        components = {m["name"]: int(rng.random() < 0.2) for m in truth["maps"]}
        results[path.parent.name] = make_result(truth, moved, components)

    def run(_: Namespace, yamls: list[str]) -> tuple[dict[str, Any], float, None]:
        return results[Path(yamls[0]).parent.name], 0.0, None

    monkeypatch.setattr(score, "run", run)
    rows = score.multi(Namespace(cases=str(shared_data), only=None, frontend=False, native=False))
    assert rows
    for want in rows:
        result_path = tmp_path / f"{want['case']}.json"
        result_path.write_text(json.dumps(results[want["case"]]))
        summary = evaluate_files(result_path, shared_data / want["case"] / "truth.json").summary
        assert (summary.right_maps, summary.joined, summary.wrong) == (
            want["placed"],
            want["joined"],
            want["wrong"],
        )
        assert summary.median_right_m == (None if want["te"] is None else pytest.approx(want["te"], abs=1e-6))
