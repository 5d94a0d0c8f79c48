"""Ctrl-C during a merge of many maps: it ends at once and leaves nothing half written."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mapmeld.simulate import SimulateOptions, simulate, write_case


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A floor with more maps than are registered in a few seconds."""
    options = SimulateOptions(
        world="floor", size=(70.0, 70.0), robots=50, seed=3, resolution=0.1, path_length=15.0
    )
    return write_case(simulate(options), tmp_path_factory.mktemp("floor"))


def test_ctrl_c_while_pairs_are_registered(floor: Path, tmp_path: Path) -> None:
    out, cache = tmp_path / "out", tmp_path / "cache"
    maps = [str(path) for path in sorted(floor.glob("*.yaml"))]
    command = [sys.executable, "-m", "mapmeld", "merge", *maps, "-o", str(out), "--cache", str(cache), "-q"]
    run = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 120.0
    while not list(cache.glob("*/*.pair")) and run.poll() is None and time.monotonic() < limit:
        time.sleep(0.05)
    assert run.poll() is None, "ended before it was interrupted"
    began = time.monotonic()
    run.send_signal(signal.SIGINT)
    _, told = run.communicate(timeout=60)
    seconds = time.monotonic() - began
    assert run.returncode == 130, told
    print(f"ended after {seconds:.2f} s")
    assert not out.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
    # What was kept of the cache is whole: a damaged pair would be told of.
    from mapmeld.pair_store import PairStore

    store = PairStore(cache)
    assert all(store.has(path.stem) for path in cache.glob("*/*.pair"))
