"""The hand-written stubs of the core against the core."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mapmeld import _core
from rooms import building, hall


def test_stubtest() -> None:
    pytest.importorskip("mypy")
    run = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "mapmeld._core"], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stdout + run.stderr


def stub_keys() -> dict[str, set[str]]:
    """Keys of the TypedDicts in the stub; they do not exist at run time, so the stub itself is run."""
    path = Path(_core.__file__).with_name("_core.pyi")
    namespace: dict[str, object] = {}
    exec(compile("from __future__ import annotations\n" + path.read_text(), str(path), "exec"), namespace)
    kinds = {name: kind for name, kind in namespace.items() if hasattr(kind, "__total__")}
    return {name: set(kind.__annotations__) for name, kind in kinds.items()}


def test_returned_dicts_have_the_keys_of_the_stub() -> None:
    keys = stub_keys()
    grids = [*building(), hall()]
    found = _core.merge([(g.name, g.data, g.resolution, g.origin) for g in grids], "{}")
    assert set(found) == keys["_Merge"]
    assert set(found["maps"][0]) == keys["_Placement"]
    assert set(found["components"][0]) == keys["_Component"]
    assert set(found["components"][0]["steps"][0]) == keys["_Step"]
    assert set(found["hypotheses"][0]) == keys["_Hypothesis"]
    assert set(found["pairs"][0]) == keys["_Pair"]
    assert set(found["pairs"][0]["modes"][0]) == keys["_Mode"]
    seen = [_core.LocalMap(g.name, g.data, g.resolution, g.origin, "{}") for g in grids[:2]]
    assert set(seen[0].boundary()) == keys["_Boundary"]
    assert set(seen[0].lines()) == keys["_Lines"]
    assert set(seen[0].corners()) == keys["_Corners"]
    perceived = _core.perceive(*seen, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "{}")
    assert set(perceived) == keys["_Perception"]
    assert set(perceived["walls"][0]) == keys["_Evidence"]
    assert perceived["product"].shape == (2,)
    candidates, modes = _core.register(*seen, "{}")
    assert candidates > 0
    assert set(modes[0]) == keys["_Mode"]
    weighed = _core.weigh(*seen, seen[1].mirrored(), "{}")
    assert set(weighed) == keys["_Weighed"]
    source, pose = _core.candidates(*seen, "{}")[0]
    assert (type(source), len(pose)) == (str, 3)


def test_corners_turn_anticlockwise_through_free_space() -> None:
    grid = hall()
    corners = _core.LocalMap(grid.name, grid.data, grid.resolution, grid.origin, "{}").corners()
    assert len(corners["opening"]) >= 4
    for vertex, arm0, arm1, opening in zip(
        corners["vertex"], corners["arm0"], corners["arm1"], corners["opening"], strict=True
    ):
        start = np.arctan2(arm0[1], arm0[0])
        assert np.allclose(arm1, [np.cos(start + opening), np.sin(start + opening)], atol=0.1)
        middle = vertex + 0.3 * np.array([np.cos(start + opening / 2), np.sin(start + opening / 2)])
        col, row = ((middle - grid.origin[:2]) / grid.resolution).astype(int)
        assert grid.data[row, col] == 0
