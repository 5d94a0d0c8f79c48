"""The cases of buildings that no weight was fitted to: who owns which scan, and what the files hold."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mapmeld import read_map, se2
from mapmeld.simulate.raster import dilate
from test_benchmarks import BENCHMARKS

DATASETS = Path(os.environ.get("MAPMELD_MRPT", "/usr/share/mrpt/datasets"))
needs_datasets = pytest.mark.skipif(
    not DATASETS.is_dir(), reason="MRPT's example data are not here: install mrpt-common or set MAPMELD_MRPT"
)


def test_no_scan_is_in_two_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import killian
    import malaga
    from drawn_cases import stretches

    cases = [(99, *c) for c in malaga.STRETCHES] + [(3758, *c) for c in killian.STRETCHES]
    for scans, maps, common in cases:
        parts = stretches(scans, maps, common)
        owned = [i for part in parts for i in part]
        assert sorted(owned) == list(range(scans))
        assert len(parts) == maps
        assert all(len(part) > 3 and part == sorted(part) for part in parts)


def test_the_floor_of_a_hatched_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import homes

    y, x = np.mgrid[0:300, 0:400]
    hatched = (x + y) % 30 != 0
    room = (abs(x - 150) < 80) & (abs(y - 150) < 60)
    door = (x >= 230) & (x < 270) & (abs(y - 150) < 12)
    next_room = (abs(x - 310) < 40) & (abs(y - 150) < 50)
    floor = room | door | next_room
    line = dilate(floor, 1) & ~floor
    drawing = (y < 20) | (x < 15) | floor | (hatched & ~line)
    assert np.array_equal(homes.floor_of(drawing), floor)


def _pose_graph(path: Path) -> Path:
    """Two scans in the middle of a room of 6 x 4 m, a metre apart; the last beam comes back from nowhere."""
    lines = ["# a room"]
    angles = [-1.5 + k * 0.05 for k in range(61)]
    for k in range(2):
        x = -0.5 + k
        ranges = [min((3.0 - x) / np.cos(a), 2.0 / max(abs(np.sin(a)), 1e-9)) for a in angles]
        told = " ".join(f"{v:.3f}" for v in [*ranges[:-1], 51.0])
        lines.append(f"VERTEX_SE2 {k} {x} 0.0 0.0")
        lines.append(f"ROBOTLASER1 0 -1.5 3.0 0.05 50.0 0.1 0 61 {told} 0 {x} 0 0 {x} 0 0 0 0 0 0 0 0 host 0")
    lines.append("EDGE_SE2 0 1 1.0 0.0 0.0 1 0 0 1 0 1")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_scans_of_a_pose_graph_become_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import g2o_files
    from drawn_cases import draw

    path = _pose_graph(tmp_path / "room.g2o")
    zipped = tmp_path / "room.g2o.zip"
    with zipfile.ZipFile(zipped, "w") as z:
        z.writestr("__MACOSX/._room.g2o", "nothing")
        z.write(path, "room.g2o")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as z:
        z.writestr("room.txt", "nothing")
    with pytest.raises(ValueError, match=r"empty\.zip: no \.g2o"):
        g2o_files.read_scans(tmp_path / "empty.zip")
    (tmp_path / "bare.g2o").write_text("VERTEX_SE2 0 0 0 0\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"bare\.g2o: no scan"):
        g2o_files.read_scans(tmp_path / "bare.g2o")
    scans = g2o_files.read_scans(path)
    assert np.array_equal(scans.ranges, g2o_files.read_scans(zipped).ranges, equal_nan=True)
    assert scans.poses.tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]
    assert np.isnan(scans.ranges[:, -1]).all()
    assert np.isfinite(scans.ranges[:, :-1]).all()
    assert scans.angles[[0, -1]] == pytest.approx([-1.5, 1.5])

    draw(scans, [[0], [1]], 8.0, 0.05, np.random.default_rng(1), tmp_path / "case", "a room")
    truth = json.loads((tmp_path / "case" / "truth.json").read_text(encoding="utf-8"))
    (pair,) = truth["pairs"]
    # Both see the wall ahead and most of those beside them.
    assert pair["overlap_occupied"] > 0.5
    walls = []
    for told in truth["maps"]:
        m = read_map(tmp_path / "case" / f"{told['name']}.yaml")
        rows, cols = np.nonzero(m.data == 100)
        cells = np.column_stack([cols + 0.5, rows + 0.5]) * m.resolution
        in_map = se2.apply(m.origin, cells)
        walls.append(se2.apply(told["T_world_map"], in_map))
    for points in walls:
        ahead = points[np.abs(points[:, 1]) < 1.5]
        assert np.abs(ahead[:, 0] - 3.0).max() < 0.1


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
