"""Priors and pins: known poses are evidence, and exact ones are where they are said to be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from mapmeld import Estimate, Estimator, OccupancyGrid, Prior, se2
from rooms import TRUTH, blank, building, hall, view

LEFT, MIDDLE, RIGHT = building()
SIGMA = (0.4, 0.4, 0.1)


def told(*grids: OccupancyGrid) -> Estimator:
    estimator = Estimator()
    for grid in grids:
        estimator.update(grid)
    return estimator


def off(name: str, dx: float, dy: float = 0.0, turn: float = 0.0) -> tuple[float, float, float]:
    """The true pose of a map, moved by so much in the world."""
    x, y, theta = TRUTH[name]
    return (x + dx, y + dy, theta + turn)


def miss(estimate: Estimate, name: str, T: Sequence[float]) -> float:
    """Metres and radians, added up, by which a robot's pose misses another."""
    found = estimate.robot(name).T_world_map
    return math.hypot(found[0] - T[0], found[1] - T[1]) + abs(se2.wrap(found[2] - T[2]))


def test_known_poses_with_yaw_give_the_world_and_walls_refine_them() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    errors = {"left": (0.3, -0.2, 0.05), "middle": (-0.3, 0.2, -0.05), "right": (0.1, 0.3, 0.02)}
    for name, error in errors.items():
        estimator.set_prior(name, Prior(off(name, *error), SIGMA))
    estimate = estimator.estimate()
    (component,) = estimate.components
    assert component.is_world
    assert [r.status for r in estimate.robots] == ["merged"] * 3
    for a, b in (("left", "middle"), ("middle", "right")):
        found = se2.compose(se2.inverse(estimate.robot(a).T_world_map), estimate.robot(b).T_world_map)
        true = se2.compose(se2.inverse(TRUTH[a]), TRUTH[b])
        assert np.allclose(found, true, atol=0.1)
    # The errors of three priors, averaged by walls that tie them together.
    assert all(miss(estimate, n, TRUTH[n]) < 0.35 for n in TRUTH)
    sigma = math.sqrt(estimate.robot("left").covariance[0, 0])
    assert 0.05 < sigma < SIGMA[0]


def test_a_robot_without_a_prior_is_placed_in_the_world_by_walls() -> None:
    estimator = told(RIGHT, LEFT, MIDDLE)
    estimator.set_prior("left", Prior(TRUTH["left"], (0.05, 0.05, 0.01)))
    estimate = estimator.estimate()
    assert estimate.components[0].is_world
    assert len(estimate.components) == 1
    assert miss(estimate, "right", TRUTH["right"]) < 0.2
    assert estimate.robot("right").status == "merged"


def test_a_prior_places_a_map_that_shares_no_wall() -> None:
    estimator = told(LEFT, MIDDLE, hall())
    estimator.set_prior("left", Prior(TRUTH["left"], SIGMA))
    estimator.set_prior("hall", Prior((40.0, -7.0, 2.5), (0.5, 0.3, 0.2)))
    estimate = estimator.estimate()
    (component,) = estimate.components
    assert component.names == ("hall", "left", "middle")
    lone = estimate.robot("hall")
    assert lone.status == "prior"
    assert np.allclose(lone.T_world_map, (40.0, -7.0, 2.5))
    assert np.allclose(lone.covariance, np.diag([0.25, 0.09, 0.04]))
    assert lone.probability == 1.0
    assert estimate.robot("left").status == "merged"
    assert np.isclose(miss(estimate, "left", TRUTH["left"]), 0.0, atol=1e-6)


def test_a_single_prior_makes_the_world_and_others_stay_out_of_it() -> None:
    estimator = told(hall(), LEFT)
    estimator.set_prior("left", Prior(TRUTH["left"], SIGMA))
    estimate = estimator.estimate()
    assert {c.names: c.is_world for c in estimate.components} == {("left",): True, ("hall",): False}
    assert (estimate.robot("left").status, estimate.robot("hall").status) == ("prior", "no evidence")


def test_walls_that_contradict_a_prior_lose_and_are_told() -> None:
    estimator = told(LEFT, MIDDLE)
    estimator.set_prior("left", Prior(TRUTH["left"], (0.1, 0.1, 0.02)))
    wrong = off("middle", 4.0, -3.0)
    estimator.set_prior("middle", Prior(wrong, (0.3, 0.3, 0.1)))
    estimate = estimator.estimate()
    robot = estimate.robot("middle")
    assert robot.status == "prior"
    assert miss(estimate, "middle", wrong) < 1e-9
    assert "left" in robot.reason
    assert "5.0 m" in robot.reason


def test_a_prior_that_is_vague_enough_does_not_keep_walls_from_saying_otherwise() -> None:
    estimator = told(LEFT, MIDDLE)
    estimator.set_prior("left", Prior(TRUTH["left"], (0.05, 0.05, 0.01)))
    estimator.set_prior("middle", Prior(off("middle", 4.0, -3.0), (3.0, 3.0, 0.3)))
    estimate = estimator.estimate()
    assert estimate.robot("middle").status == "merged"
    assert miss(estimate, "middle", TRUTH["middle"]) < 0.2


def test_a_prior_links_maps_that_walls_alone_would_not() -> None:
    little = [view("left", (-0.5, 6.6), TRUTH["left"]), view("right", (5.4, 15.0), TRUTH["right"])]
    estimator = told(*little)
    alone = estimator.estimate()
    assert len(alone.components) == 2
    for name, error in (("left", (0.2, 0.1, 0.03)), ("right", (-0.2, 0.2, -0.03))):
        estimator.set_prior(name, Prior(off(name, *error), SIGMA))
    estimate = estimator.estimate()
    assert [r.status for r in estimate.robots] == ["merged", "merged"]
    found = se2.compose(se2.inverse(estimate.robot("left").T_world_map), estimate.robot("right").T_world_map)
    assert np.allclose(found, se2.compose(se2.inverse(TRUTH["left"]), TRUTH["right"]), atol=0.1)


def test_a_pinned_robot_is_where_it_is_pinned_and_others_follow() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    estimator.pin("middle", TRUTH["middle"])
    estimate = estimator.estimate()
    assert tuple(estimate.robot("middle").T_world_map) == pytest.approx(TRUTH["middle"], abs=1e-12)
    assert (estimate.robot("middle").status, estimate.robot("middle").probability) == ("pinned", 1.0)
    assert not estimate.robot("middle").covariance.any()
    for name in ("left", "right"):
        assert estimate.robot(name).status == "merged"
        assert miss(estimate, name, TRUTH[name]) < 0.2
    # Pinned elsewhere, it takes the others along.
    moved = (30.0, -20.0, 1.0)
    estimator.pin("middle", moved)
    estimate = estimator.estimate()
    assert miss(estimate, "middle", moved) < 1e-9
    expected = se2.compose(moved, se2.compose(se2.inverse(TRUTH["middle"]), TRUTH["right"]))
    assert miss(estimate, "right", expected) < 0.3


def test_two_pins_stand_whatever_the_walls_say() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    wrong = off("middle", 2.0, 1.0, 0.5)
    estimator.pin("left", TRUTH["left"])
    estimator.pin("middle", wrong)
    estimate = estimator.estimate()
    for name, pose in (("left", TRUTH["left"]), ("middle", wrong)):
        assert miss(estimate, name, pose) < 1e-9
        assert estimate.robot(name).status == "pinned"
    assert "the walls" in estimate.robot("middle").reason
    assert len(estimate.robots) == 3


def test_two_true_pins_hold_the_third_between_them() -> None:
    estimator = told(LEFT, MIDDLE, RIGHT)
    estimator.pin("left", TRUTH["left"])
    estimator.pin("right", TRUTH["right"])
    estimate = estimator.estimate()
    assert len(estimate.components) == 1
    assert all(miss(estimate, n, TRUTH[n]) < 1e-9 for n in ("left", "right"))
    assert miss(estimate, "middle", TRUTH["middle"]) < 0.1


def test_an_unpinned_robot_goes_where_the_evidence_is() -> None:
    estimator = told(LEFT, MIDDLE)
    estimator.pin("left", TRUTH["left"])
    estimator.pin("middle", off("middle", 3.0, 0.0, 1.0))
    estimator.estimate()
    estimator.unpin("middle")
    estimate = estimator.estimate()
    assert estimate.robot("middle").status == "merged"
    assert miss(estimate, "middle", TRUTH["middle"]) < 0.2


def test_what_is_known_may_be_told_before_the_map() -> None:
    estimator = told(LEFT)
    estimator.set_prior("middle", Prior(TRUTH["middle"], (0.05, 0.05, 0.01)))
    estimator.pin("ghost", (0.0, 0.0, 0.0))
    waiting = estimator.estimate()
    assert [r.name for r in waiting.robots] == ["left"]
    # The world is the priors', and nobody is in it yet.
    assert not waiting.components[0].is_world
    estimator.update(MIDDLE)
    estimate = estimator.estimate()
    assert estimate.components[0].is_world
    assert miss(estimate, "left", TRUTH["left"]) < 0.2


def test_the_world_stays_when_its_priors_are_forgotten() -> None:
    estimator = told(LEFT, MIDDLE)
    estimator.set_prior("left", Prior(TRUTH["left"], SIGMA))
    before = estimator.estimate()
    estimator.set_prior("left", None)
    after = estimator.estimate()
    assert after.components[0].is_world
    for name in ("left", "middle"):
        assert np.allclose(after.robot(name).T_world_map, before.robot(name).T_world_map, atol=1e-9)


def test_a_blank_map_is_not_placed_by_what_is_known_of_it() -> None:
    estimator = told(LEFT, blank())
    estimator.pin("blank", (1.0, 1.0, 0.0))
    robot = estimator.estimate().robot("blank")
    assert (robot.status, robot.T_world_map) == ("blank", None)


@pytest.mark.parametrize("far", [3e5, 3e8])
def test_pins_too_far_apart_for_one_map_end_no_estimate(far: float) -> None:
    estimator = told(LEFT, MIDDLE, hall())
    estimator.pin("hall", (0.0, 0.0, 0.0))
    estimator.pin("left", (far, 0.0, 0.0))
    estimate = estimator.estimate(maps_are_done=True)
    world = estimate.components[estimate.robot("left").component]
    assert estimate.robot("middle").component == estimate.robot("left").component
    assert set(world.names) == {"hall", "left", "middle"}
    assert world.merged is None
    assert "map" in world.problem
    estimator.pin("left", (30.0, 0.0, 0.0))
    (world,) = estimator.estimate(maps_are_done=True).components
    assert world.problem is None
    assert world.merged.width * world.merged.resolution > 30.0


def test_what_a_prior_placed_may_go_and_come_back_as_another() -> None:
    """Of a robot that left, nothing is known any more: who comes by its name has no prior."""
    estimator = told(LEFT, hall())
    estimator.set_prior("left", Prior(TRUTH["left"], (0.1, 0.1, 0.05)))
    estimator.set_prior("hall", Prior((30.0, 0.0, 0.0), (0.1, 0.1, 0.05)))
    assert len(estimator.estimate().components) == 1
    estimator.remove("hall")
    estimator.update(hall())
    assert len(estimator.estimate().components) == 2


def test_covariances_are_told_along_the_axes_of_the_frame() -> None:
    """The world stays turned when the pin that turned it is forgotten; what is known stays along its axes."""
    estimator = told(LEFT, MIDDLE, RIGHT)
    estimator.pin("left", (0.0, 0.0, math.pi / 2))
    pinned = estimator.estimate(maps_are_done=True)
    estimator.unpin("left")
    free = estimator.estimate(maps_are_done=True)
    assert free.components[0].is_world
    for name in ("middle", "right"):
        one, other = pinned.robot(name), free.robot(name)
        assert np.allclose(one.T_world_map, other.T_world_map, atol=0.05)
        # One direction is known clearly better than the other.
        assert one.covariance[1, 1] > 1.3 * one.covariance[0, 0]
        assert np.allclose(one.covariance, other.covariance, rtol=0.1, atol=1e-6)


def test_the_frame_of_the_first_robot_and_that_of_the_priors_are_told_apart() -> None:
    estimator = told(hall("first"), LEFT)
    before = estimator.estimate()
    assert before.components[before.robot("first").component].is_world
    estimator.set_prior("left", Prior(TRUTH["left"], (0.3, 0.3, 0.1)))
    given = estimator.estimate()
    assert {c.names: c.is_world for c in given.components} == {("first",): False, ("left",): True}
    assert given.robot("first").placements == 0
    assert given.robot("left").placements == before.robot("left").placements + 1
    again = estimator.estimate()
    assert [c.merged is d.merged for c, d in zip(given.components, again.components, strict=True)] == [
        True,
        True,
    ]
    assert [r.placements for r in again.robots] == [r.placements for r in given.robots]
