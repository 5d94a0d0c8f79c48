"""The cases of a building that nothing was made with: who owns which scan, and what MRPT's files hold."""

import os
from pathlib import Path

import numpy as np
import pytest

from test_benchmarks import BENCHMARKS

DATASETS = Path(os.environ.get("MAPMELD_MRPT", "/usr/share/mrpt/datasets"))
needs_datasets = pytest.mark.skipif(
    not DATASETS.is_dir(), reason="MRPT's example data are not here: install mrpt-common or set MAPMELD_MRPT"
)


def test_no_scan_is_in_two_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import malaga

    for maps, common in malaga.STRETCHES:
        parts = malaga.stretches(99, maps, common)
        owned = [i for part in parts for i in part]
        assert sorted(owned) == list(range(99))
        assert len(parts) == maps
        assert all(len(part) > 3 and part == sorted(part) for part in parts)


@needs_datasets
def test_key_frames_and_grid_of_mrpt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import mrpt_files

    scans = mrpt_files.read_scans(DATASETS / "malaga-cs-fac-building.simplemap.gz")
    assert scans.poses.shape == (99, 3)
    assert scans.ranges.shape == (99, 361)
    assert np.allclose(np.diff(scans.angles), np.pi / 360)
    # The first key frame is the origin, and the laser stands in front of it.
    assert scans.poses[0] == pytest.approx([0.78, 0.0, 0.0], abs=1e-6)
    grid = mrpt_files.read_grid(DATASETS / "2006-MalagaCampus.gridmap.gz", "campus")
    assert grid.data.shape == (2738, 1888)
    assert grid.resolution == 0.08
    assert 20_000 < int((grid.data == 100).sum()) < 40_000
