"""The estimator: frames that stay, changes that count, robots that are never lost."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import mapmeld
from mapmeld import Estimate, Estimator, MapmeldError, OccupancyGrid, se2
from mapmeld.covariances import covariances_in_frames
from mapmeld.frames import Held
from rooms import TRUTH, building, hall, view

LEFT, MIDDLE, RIGHT = building()


def told(*grids: OccupancyGrid) -> Estimator:
    estimator = Estimator()
    for grid in grids:
        estimator.update(grid)
    return estimator


def between(estimate: Estimate, a: str, b: str) -> np.ndarray:
    one, other = estimate.robot(a), estimate.robot(b)
    assert one.component == other.component, (one.reason, other.reason)
    return se2.compose(se2.inverse(one.T_world_map), other.T_world_map)


def assert_true(estimate: Estimate, a: str, b: str) -> None:
    found, truth = between(estimate, a, b), se2.compose(se2.inverse(TRUTH[a]), TRUTH[b])
    assert math.hypot(*(found - truth)[:2]) < 0.2, (found, truth)
    assert abs(se2.wrap(found[2] - truth[2])) < 0.02


def test_no_robot_is_an_empty_estimate() -> None:
    estimate = Estimator().estimate()
    assert (estimate.robots, estimate.components, estimate.result) == ((), (), None)


def test_robots_are_placed_in_the_frame_of_the_first() -> None:
    estimate = told(MIDDLE, LEFT, RIGHT).estimate()
    assert [r.name for r in estimate.robots] == ["left", "middle", "right"]
    (component,) = estimate.components
    assert (component.anchor, component.is_world) == ("middle", True)
    assert component.names == ("left", "middle", "right")
    assert estimate.robot("middle").T_world_map.tolist() == [0.0, 0.0, 0.0]
    assert_true(estimate, "left", "middle")
    assert_true(estimate, "middle", "right")
    assert [estimate.robot(n).status for n in TRUTH] == ["merged"] * 3
    assert not estimate.robot("middle").covariance.any()
    assert estimate.robot("left").covariance.any()
    assert estimate.registered_pairs == 3


def test_the_result_is_that_of_a_merge() -> None:
    estimator = told(MIDDLE, RIGHT)
    estimator.estimate()
    estimator.update(LEFT)
    estimator.remove("middle")
    estimator.update(MIDDLE)
    found = estimator.estimate().result
    merged = mapmeld.merge([RIGHT, LEFT, MIDDLE], reference="right")
    for pair, other in zip(found.pairs, merged.pairs, strict=True):
        assert (pair.a, pair.b, pair.probability) == (other.a, other.b, other.probability)
        assert all(np.array_equal(m.T_a_b, n.T_a_b) for m, n in zip(pair.modes, other.modes, strict=True))
    assert [m.probability for m in found.maps] == [m.probability for m in merged.maps]


def test_only_pairs_with_a_changed_map_are_registered() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    first = estimator.estimate()
    again = estimator.estimate()
    assert again.registered_pairs == 0
    for a, b in zip(first.robots, again.robots, strict=True):
        assert np.array_equal(a.T_world_map, b.T_world_map)
        assert a.placements == b.placements
    # The same cells, told once more.
    estimator.update(OccupancyGrid(RIGHT.data.copy(), RIGHT.resolution, RIGHT.origin, "right"))
    assert estimator.estimate().registered_pairs == 0
    estimator.update(view("right", (7, 14.4), TRUTH["right"]))
    assert estimator.estimate().registered_pairs == 2


def test_placements_count_what_is_put_elsewhere() -> None:
    estimator = told(LEFT)
    assert estimator.estimate().robot("left").placements == 0
    estimator.update(RIGHT)
    estimator.update(MIDDLE)
    estimate = estimator.estimate()
    assert [estimate.robot(n).placements for n in ("left", "middle", "right")] == [0, 1, 1]


def test_components_that_nothing_links_are_told_apart() -> None:
    estimate = told(LEFT, MIDDLE, hall()).estimate()
    assert [c.names for c in estimate.components] == [("left", "middle"), (hall().name,)]
    assert [c.is_world for c in estimate.components] == [True, False]
    alone = estimate.robot(hall().name)
    assert (alone.component, alone.status) == (1, "no evidence")
    assert all(c.merged is not None for c in estimate.components)


def test_the_world_is_where_the_first_robot_is_however_small_its_component() -> None:
    estimate = told(hall(), LEFT, MIDDLE).estimate()
    assert [(c.anchor, c.is_world) for c in estimate.components] == [("left", False), (hall().name, True)]


def test_a_blank_map_is_told_and_placed_nowhere() -> None:
    blank = OccupancyGrid(np.full((20, 30), -1, dtype=np.int8), 0.1, name="asleep")
    estimator = told(blank, LEFT)
    robot = estimator.estimate().robot("asleep")
    assert (robot.status, robot.component, robot.T_world_map, robot.covariance) == ("blank", None, None, None)
    assert estimator.estimate().components[0].anchor == "left"
    only = told(blank).estimate()
    assert (only.components, only.robots[0].status) == ((), "blank")


def test_those_who_remain_keep_their_poses_when_the_anchor_leaves() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    before = estimator.estimate()
    estimator.remove("left")
    after = estimator.estimate()
    assert [r.name for r in after.robots] == ["middle", "right"]
    (component,) = after.components
    assert (component.anchor, component.is_world) == ("middle", True)
    for name in ("middle", "right"):
        assert np.array_equal(after.robot(name).T_world_map, before.robot(name).T_world_map)
        assert after.robot(name).placements == before.robot(name).placements
    # One that comes back is placed in the world that is there.
    estimator.update(LEFT)
    back = estimator.estimate()
    assert np.allclose(back.robot("left").T_world_map, 0.0, atol=0.1)
    assert np.array_equal(back.robot("middle").T_world_map, before.robot("middle").T_world_map)


def test_a_grown_map_has_the_old_cells_at_whole_cell_offsets() -> None:
    estimator = told(LEFT, view("middle", (4, 9.5), TRUTH["middle"]))
    old = estimator.estimate().components[0].merged
    estimator.update(MIDDLE)
    estimator.update(RIGHT)
    new = estimator.estimate().components[0].merged
    assert new.resolution == old.resolution
    assert (old.origin[2], new.origin[2]) == (0.0, 0.0)
    for origin in (old.origin, new.origin):
        cells = np.array(origin[:2]) / new.resolution
        assert np.allclose(cells, np.round(cells), atol=1e-6)
    col, row = np.round((np.array(old.origin[:2]) - new.origin[:2]) / new.resolution).astype(int)
    assert min(row, col) >= 0
    within = new.data[row : row + old.height, col : col + old.width]
    both = (within >= 0) & (old.data >= 0)
    assert both.sum() > 1000
    assert (within == old.data)[both].mean() > 0.97


def test_an_unchanged_component_is_not_drawn_again() -> None:
    estimator = told(LEFT, MIDDLE)
    first = estimator.estimate()
    assert estimator.estimate().components[0].merged is first.components[0].merged


def test_what_progress_raises_supersedes_an_estimate_and_finished_pairs_stay() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)

    class Superseded(Exception):
        pass

    def refuse(stage: str, done: int, total: int) -> None:
        if stage == "filter":
            raise Superseded

    with pytest.raises(Superseded):
        estimator.estimate(refuse)
    estimate = estimator.estimate()
    assert estimate.registered_pairs == 0
    assert len(estimate.components) == 1


def test_updates_from_other_threads_count_for_the_next_estimate() -> None:
    estimator = told(LEFT, MIDDLE)
    heard: list[str] = []

    def meddle(stage: str, done: int, total: int) -> None:
        if not heard:
            other = threading.Thread(target=lambda: (estimator.update(RIGHT), estimator.remove("middle")))
            other.start()
            other.join(10)
            assert not other.is_alive()
        heard.append(stage)

    assert [r.name for r in estimator.estimate(meddle).robots] == ["left", "middle"]
    assert [r.name for r in estimator.estimate().robots] == ["left", "right"]


def test_estimates_of_several_threads_take_turns() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    found: list[Estimate] = []
    threads = [threading.Thread(target=lambda: found.append(estimator.estimate())) for _ in range(4)]
    for k, thread in enumerate(threads):
        thread.start()
        estimator.update(view("right", (7 + 0.1 * k, 14.4), TRUTH["right"]))
    for thread in threads:
        thread.join(60)
    assert len(found) == 4
    assert all([r.name for r in e.robots] == ["left", "middle", "right"] for e in found)


def bad_uses() -> Iterator[tuple[str, str]]:
    yield "estimator.update(3)", "OccupancyGrid"
    yield "estimator.update(OccupancyGrid([[0]], 0.1))", "no name"
    yield "estimator.remove('nobody')", "'nobody'"
    yield "estimator.unpin('left')", "'left' is not pinned"
    yield "estimator.pin('left', (1, 2))", "T_world_map"
    yield "estimator.pin('left', (1, 2, float('nan')))", "T_world_map"
    yield "estimator.set_prior('left', (1, 2, 3))", "Prior"
    yield "mapmeld.Prior((0, 0, 0), (0.1, 0, 0.1))", "sigma must be positive"
    yield "mapmeld.Prior('abc', (0.1, 0.1, 0.1))", "T_world_map"
    yield "mapmeld.Hold(keep=2)", "keep"
    yield "mapmeld.Hold(replace='much')", "replace"
    yield "Estimator(hold=0.5)", "Hold"
    yield "estimator.estimate().robot('nobody')", "'nobody'"


@pytest.mark.parametrize(("use", "message"), list(bad_uses()))
def test_bad_use_is_refused_by_name(use: str, message: str) -> None:
    estimator = told(LEFT)
    with pytest.raises(MapmeldError, match=message):
        eval(use, {**globals(), "estimator": estimator})


def test_a_bad_option_is_refused_at_once() -> None:
    with pytest.raises(mapmeld.ConfigError, match=r"filter\.particles"):
        Estimator(config={"filter": {"particles": 0}})


def resident_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as stream:
        return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_memory_stays_flat_over_many_updates() -> None:
    estimator = told(LEFT, MIDDLE, hall())

    def churn(times: int) -> None:
        for k in range(times):
            estimator.update(view("middle", (2.0, 9.0 + 0.1 * (k % 29)), TRUTH["middle"]))
            estimate = estimator.estimate()
            assert len(estimate.robots) == 3

    churn(30)
    before = resident_mb()
    churn(120)
    # What one map and its pairs take is some megabytes: 120 of them would show.
    assert resident_mb() - before < 20


@pytest.mark.parametrize("origin", [(2e8, 0.0, 0.0), (0.0, -1.1e8, 0.0)])
def test_a_map_that_lies_too_far_off_is_refused_where_it_is_made(origin: tuple[float, float, float]) -> None:
    """The core would refuse it, and with it every estimate of those that sent theirs."""
    with pytest.raises(MapmeldError, match="map 'far': origin must lie within 1e\\+08 m"):
        OccupancyGrid(LEFT.data, LEFT.resolution, origin, "far")
    told(OccupancyGrid(LEFT.data, LEFT.resolution, (1e8, -1e8, 0.0), "far"), MIDDLE).estimate()


def test_a_zero_covariance_is_the_anchors_alone() -> None:
    """Of two single robots that are linked, the one that came first is the anchor, whatever its name."""
    y = OccupancyGrid(LEFT.data, LEFT.resolution, LEFT.origin, "y")
    estimator = told(hall("z"), y, hall("x"))
    estimator.estimate()
    estimator.update(OccupancyGrid(MIDDLE.data, MIDDLE.resolution, MIDDLE.origin, "x"))
    estimate = estimator.estimate(maps_are_done=True)
    (linked,) = (c for c in estimate.components if set(c.names) == {"x", "y"})
    assert linked.anchor == "y"
    assert not estimate.robot("y").covariance.any()
    assert (np.diag(estimate.robot("x").covariance) > 0).all()


def test_a_covariance_is_told_relative_to_an_anchor_that_is_not_the_merges_reference() -> None:
    """Two maps: how far one is off seen from the other is how far the other is off seen from it."""
    seen = {name: mapmeld.merge([LEFT, MIDDLE], reference=name) for name in ("left", "middle")}
    poses = {m.name: m.T_component_map for m in seen["middle"].maps}
    held = Held(0, "middle", True, poses)
    told_anew = covariances_in_frames(seen["left"], [held], {})
    assert not told_anew["middle"].any()
    (expected,) = (m.covariance for m in seen["middle"].maps if m.name == "left")
    assert np.allclose(told_anew["left"], expected, rtol=0.1, atol=1e-7)
