"""The figures: their data against the truth, and the files."""

from __future__ import annotations

import io
import json
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mapmeld import OccupancyGrid, se2
from mapmeld.datasets import bundled
from mapmeld.errors import MapmeldError
from mapmeld.figures import drawing, merges, motion, poses, update, write_figures
from mapmeld.figures.corner_pairs import corner_pairs
from mapmeld.figures.study import Study, bundled_maps, study
from mapmeld.metrics import centre_of_known_cells
from mapmeld.truth import Truth, parse_truth

CELLS, DEGREES = 3, 1.5


@pytest.fixture(scope="module")
def all_maps() -> Study:
    return study(seed=1)


@pytest.fixture(scope="module")
def truth() -> Truth:
    return parse_truth(json.loads((bundled("maze10") / "truth.json").read_text()))


@pytest.fixture(scope="module")
def pose_figure(all_maps: Study) -> poses.PoseFigure:
    return poses.compute_poses(all_maps)


def is_true(
    truth: Truth, a: OccupancyGrid, b: OccupancyGrid, T_a_b: NDArray[np.float64], slack: float = 1.0
) -> bool:
    """Within three cells, at the centre of b's known cells, and 1.5 degrees; `slack` times that."""
    reference = truth.reference(a.name, b.name)
    assert reference is not None
    centre = np.array(centre_of_known_cells(b))
    metres = np.linalg.norm(se2.apply(T_a_b, centre) - se2.apply(reference.T_a_b, centre))
    degrees = abs(math.degrees(se2.wrap(float(T_a_b[2]) - reference.T_a_b[2])))
    return bool(metres <= slack * CELLS * b.resolution and degrees <= slack * DEGREES)


def test_every_corner_pair_lays_its_corners_on_each_other(all_maps: Study) -> None:
    a, b = all_maps.local[0], all_maps.local[2]
    corners_a, corners_b = a.corners(), b.corners()
    pairs = corner_pairs(a, b)
    assert len(pairs) > 10
    assert len({(p.corner_a, p.corner_b) for p in pairs}) == len(pairs)
    for p in pairs:
        opening = abs(corners_a["opening"][p.corner_a] - corners_b["opening"][p.corner_b])
        assert opening < 0.6
        vertex = se2.apply(p.T_a_b, corners_b["vertex"][p.corner_b])
        assert np.linalg.norm(vertex - corners_a["vertex"][p.corner_a]) < 0.4
        arm = se2.apply((0.0, 0.0, p.T_a_b[2]), corners_b["arm0"][p.corner_b])
        assert arm @ corners_a["arm0"][p.corner_a] > 0.9


def test_fig1_one_mode_against_many(all_maps: Study, truth: Truth) -> None:
    data = motion.compute_motion(all_maps, 2, 3)
    # (a): one Gaussian around the reading, on the free floor.
    offset = np.array([se2.compose(se2.inverse(data.reading), s) for s in data.samples])
    assert np.abs(offset.mean(axis=0)).max() < 0.1
    assert offset.std(axis=0) == pytest.approx(motion.SIGMA, rel=0.25)
    assert se2.compose(se2.inverse(data.start), data.reading) == pytest.approx(motion.ODOMETRY)
    walls = all_maps.local[2].boundary()["position"]
    for pose in (data.start, data.reading):
        assert np.linalg.norm(walls - pose[:2], axis=1).min() > 0.4
    # (b): many, far from each other; the likeliest is the true one.
    assert len(data.proposals) > 20
    assert np.ptp(data.proposals[:, :2], axis=0).min() > 8
    assert len(data.modes) > 1
    assert (np.diff(data.log_likelihood) <= 0).all()
    assert is_true(truth, all_maps.grids[2], all_maps.grids[3], data.modes[0])


def test_fig2_two_modes_and_their_samples(all_maps: Study, truth: Truth) -> None:
    data = update.compute_update(all_maps)
    assert data is not None
    assert data.z not in data.before
    assert data.share[0] >= data.share[1] > 0.05
    assert data.share.sum() <= 1 + 1e-12
    first, second = data.samples
    assert len(first) + len(second) + data.elsewhere == 100
    # Within four standard deviations of a binomial.
    assert abs(len(first) - 100 * data.share[0]) < 20
    for samples, T, covariance in zip(data.samples, data.modes, data.covariance, strict=True):
        spread = np.array([se2.compose(se2.inverse(T), s) for s in samples])
        assert (np.abs(spread).max(axis=0) < 5 * np.sqrt(np.diag(covariance))).all()
    assert np.linalg.norm(data.modes[0, :2] - data.modes[1, :2]) > 1
    assert data.right in (0, 1)
    reference = all_maps.grids[data.before[0]]
    assert is_true(truth, reference, all_maps.grids[data.z], data.modes[data.right])
    assert np.array_equal(data.trajectory[0], np.zeros(3))


def test_fig3_pools_and_the_right_pose(all_maps: Study, truth: Truth, pose_figure: poses.PoseFigure) -> None:
    s = pose_figure.shown
    a, b = all_maps.grids[s.a], all_maps.grids[s.b]
    assert s.poses.shape == (11, 3)
    for pool in (s.all_classes, s.occupied):
        for values in (pool.psi, pool.gamma, pool.product):
            assert values.shape == (11,)
            assert values.sum() == pytest.approx(1)
            assert (values >= 0).all()
        product = pool.psi * pool.gamma
        assert pool.product == pytest.approx(product / product.sum())
    assert np.array_equal(s.all_classes.gamma, s.occupied.gamma)
    assert [i for i, T in enumerate(s.poses) if is_true(truth, a, b, T)] == [s.right]
    # The paper's figure: the product tells the right pose, with all classes as with the default.
    assert s.picks(s.all_classes.product)
    assert s.picks(s.occupied.product)
    assert s.picks(s.walls)
    assert s.walls[s.right] > 0 > np.delete(s.walls, s.right).max()


def test_fig3_tally_is_of_right_poses(all_maps: Study, truth: Truth, pose_figure: poses.PoseFigure) -> None:
    for s in pose_figure.studies:
        # Right is what the merge says, whose own error comes on top.
        assert is_true(truth, all_maps.grids[s.a], all_maps.grids[s.b], s.poses[s.right], slack=1.25)
        assert len(s.poses) <= 11
    tally, n = pose_figure.tally(), len(pose_figure.studies)
    assert n >= 10
    assert all(0 <= count <= n for count in tally.values())
    assert tally["walls"] >= max(tally["product_all"], tally["product_occupied"])


def test_fig4_places_all_maps_right(all_maps: Study, truth: Truth) -> None:
    data = merges.compute_merges(all_maps)
    assert [d.maps for d in data] == [3, 5, 6, 10]
    for merged in data:
        assert sorted(merged.order) == list(range(merged.maps))
        assert np.array_equal(merged.trajectory[0], np.zeros(3))
        # Against the map of the panel that shares the most with it, as pairs without overlap say little.
        for i, T_i in zip(merged.order, merged.trajectory, strict=True):
            grids = all_maps.grids
            shared = {j: truth.shared(grids[i].name, grids[j].name) or 0.0 for j in merged.order if j != i}
            j = max(shared, key=shared.__getitem__)
            T_j = merged.trajectory[merged.order.index(j)]
            assert is_true(truth, grids[j], grids[i], se2.compose(se2.inverse(T_j), T_i)), (merged.maps, i)


def test_fig2_and_fig3_are_drawn_whole(all_maps: Study, pose_figure: poses.PoseFigure) -> None:
    data = update.compute_update(all_maps)
    assert data is not None
    check_picture(drawing.render(update.draw_update(all_maps, data), "png"))
    check_picture(drawing.render(poses.draw_poses(all_maps, pose_figure), "png"))


def check_picture(png: bytes) -> None:
    """Large, mostly paper, ink in its parts, and none on the rim: nothing is cut off."""
    with Image.open(io.BytesIO(png)) as image:
        assert min(image.size) > 600
        levels = np.asarray(image.convert("L"))
    assert 0.6 < (levels > 200).mean() < 0.995
    h, w = levels.shape
    for part in (levels[: h // 2, : w // 2], levels[: h // 2, w // 2 :], levels[h // 2 :, : w // 2]):
        assert (part < 120).sum() > 500
    rim = np.concatenate([levels[:, 0], levels[:, -1], levels[0], levels[-1]])
    assert (rim > 250).all()


def test_files_are_written_and_not_blank(tmp_path: Path) -> None:
    maps = bundled_maps()[:3]
    files = write_figures(tmp_path / "figs", maps=maps, seed=3)
    assert {f.suffix for f in files} == {".png", ".svg"}
    names = [f.stem for f in files if f.suffix == ".png"]
    assert names == sorted(names)
    assert {"fig1_motion", "fig3_poses", "fig4_merges"} <= set(names)
    assert sorted(files) == sorted((tmp_path / "figs").iterdir())
    for file in files:
        if file.suffix == ".svg":
            assert ElementTree.parse(file).getroot().tag.endswith("svg")
        else:
            check_picture(file.read_bytes())


def test_maps_without_overlap_and_bad_folders_are_refused(tmp_path: Path) -> None:
    maps = bundled_maps()
    with pytest.raises(MapmeldError, match="no two of the maps belong together"):
        write_figures(tmp_path / "none", maps=maps[:1])
    assert not (tmp_path / "none").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(MapmeldError, match="is no folder"):
        write_figures(tmp_path / "file", maps=maps[:3])
