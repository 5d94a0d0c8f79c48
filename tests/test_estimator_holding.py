"""Hysteresis: what was told stays until the evidence against it is clear, and goes then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapmeld import Estimator, Hold, OccupancyGrid, se2
from mapmeld.admission import admitted
from mapmeld.frames import Group, Held, apart
from mapmeld.holding import Answer, Poses, repinned, units
from mapmeld.known_cells import known_cells
from mapmeld.linking import joined
from mapmeld.simulate import SimulateOptions, simulate
from rooms import TRUTH, building, hall, view

LEFT, MIDDLE, RIGHT = building()
CENTRES = dict.fromkeys("abcdef", (0.0, 0.0))


def at(x: float, y: float = 0.0, theta: float = 0.0) -> np.ndarray:
    return np.array([x, y, theta])


def grown(name: str, to: float) -> OccupancyGrid:
    """A view that grows from the building's left."""
    return view(name, (-0.5, to), TRUTH[name])


class Witness:
    """Answers what the maps say: the probabilities of the held and the new place, and of the best other."""

    def __init__(self, *probabilities: float, rival: float = 0.0, same: bool = False) -> None:
        self.probabilities = probabilities
        self.rival = rival
        self.same = same
        self.asked: list[tuple[Poses, Poses, list[np.ndarray]]] = []

    def __call__(self, base: Poses, moved: Poses, places: list[np.ndarray]) -> Answer:
        self.asked.append((base, moved, places))
        told = [(p, 0 if self.same else k) for k, p in enumerate(self.probabilities[: len(places)])]
        return told, self.rival


HELD = [Held(0, "a", True, {"a": at(0), "b": at(5), "c": at(9)})]


def parts(groups: list[Group], witness: Witness) -> list[set[str]]:
    return [set(u.poses) for u in units(HELD, groups, (), CENTRES, Hold(), witness)]


def test_what_agrees_is_not_asked_about() -> None:
    witness = Witness()
    turned = Group({n: se2.compose(at(3, 4, 1.0), T) for n, T in HELD[0].poses.items()})
    assert parts([turned], witness) == [{"a", "b", "c"}]
    assert witness.asked == []


@pytest.mark.parametrize(
    ("held", "rival", "stays"), [(0.6, 0.0, True), (0.78, 0.1, True), (0.4, 0.0, False), (0.02, 0.95, False)]
)
def test_a_merge_that_is_torn_apart_stays_while_it_is_probable(
    held: float, rival: float, stays: bool
) -> None:
    torn = [Group({"a": at(0), "b": at(5)}), Group({"c": at(0)})]
    found = parts(torn, Witness(held, rival=rival))
    assert found == ([{"a", "b", "c"}] if stays else [{"a", "b"}, {"c"}])


@pytest.mark.parametrize(
    ("held", "new", "stays"), [(0.3, 0.6, True), (0.04, 0.9, False), (0.0, 0.5, False), (0.5, 0.45, True)]
)
def test_another_place_takes_over_when_it_is_clearly_better(held: float, new: float, stays: bool) -> None:
    elsewhere = [Group({"a": at(0), "b": at(5), "c": at(9, 3)})]
    witness = Witness(held, new)
    assert parts(elsewhere, witness) == ([{"a", "b", "c"}] if stays else [{"a", "b"}, {"c"}])
    # Asked in the held frame: staying there is no motion.
    (_, moved, (stay, go)) = witness.asked[0]
    assert list(moved) == ["c"]
    assert np.allclose(stay, 0)
    assert np.allclose(go, at(0, 3))


def test_a_place_that_is_the_held_one_refined_is_followed() -> None:
    """It is the link that was held, so nobody asks for it to be as clear as a new one."""
    refined = [Group({"a": at(0), "b": at(5), "c": at(9.3)})]
    witness = Witness(0.9, 0.9, same=True)
    kept = units(HELD, refined, (), CENTRES, Hold(), witness)
    found, unclear = admitted(refined, kept, (), (), CENTRES, Hold(), 0.99, witness)
    (group,) = joined(found, kept, (), CENTRES, Hold())
    assert {n: T.round(9).tolist() for n, T in group.poses.items()} == {
        "a": [0, 0, 0],
        "b": [5, 0, 0],
        "c": [9.3, 0, 0],
    }
    assert unclear == {}


def test_a_refined_place_that_does_not_stand_is_asked_for_like_a_new_one() -> None:
    refined = [Group({"a": at(0), "b": at(5), "c": at(9.3)})]
    assert parts(refined, Witness(0.4, 0.4, same=True)) == [{"a", "b"}, {"c"}]


def test_what_the_merge_leaves_alone_is_held_by_what_is_held_to_it() -> None:
    torn = [Group({"a": at(0)}), Group({"b": at(0)})]
    held = [Held(0, "a", True, {"a": at(0), "b": at(5)})]
    (unit,) = units(held, torn, (), CENTRES, Hold(), Witness(0.7))
    assert unit.against == {"a": 0.7, "b": 0.7}
    # One that the merge has among others stands by these.
    others = [Group({"a": at(0), "d": at(3)}), Group({"b": at(0)})]
    unit, _ = units(held, others, (), CENTRES, Hold(), Witness(0.7))
    assert unit.against == {"b": 0.7}


def test_what_is_held_to_a_pin_stays_with_it_and_the_pin_stays_exact() -> None:
    """The merge has the two others elsewhere to the pinned one, which is not clear enough."""
    groups = [Group({"a": at(0), "b": at(5, 3), "c": at(9, 3)}, in_world=True)]
    witness = Witness(0.6, 0.3)
    kept = units(HELD, groups, (), CENTRES, Hold(), witness)
    found, _ = admitted(groups, kept, {"a"}, {"a"}, CENTRES, Hold(), 0.99, witness)
    (group,) = joined(found, kept, {"a"}, CENTRES, Hold())
    assert {n: T.round(9).tolist() for n, T in group.poses.items()} == {
        "a": [0, 0, 0],
        "b": [5, 0, 0],
        "c": [9, 0, 0],
    }
    assert group.poses["a"].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("pinned", "moved"),
    [
        ({"a": at(0), "b": at(5)}, set()),
        ({"a": at(7)}, set()),
        ({"a": at(0), "b": at(5.1)}, {"b"}),
        ({"a": at(0, 1), "b": at(5)}, {"a"}),
        ({"a": at(0), "b": at(5), "c": at(9, 1)}, {"c"}),
    ],
)
def test_a_pin_that_moves_against_others_is_held_no_more(
    pinned: dict[str, np.ndarray], moved: set[str]
) -> None:
    world = Group(pinned, in_world=True)
    assert repinned(HELD, [world], pinned.keys(), CENTRES) == moved


def test_a_link_to_a_pinned_robot_stays_while_its_maps_stay() -> None:
    """It is clear enough for maps that are done, and not for a new link while they grow."""
    estimator = Estimator()
    estimator.update(LEFT)
    estimator.update(view("middle", (4.0, 6.25), TRUTH["middle"]))
    estimator.pin("left", TRUTH["left"])
    estimates = [estimator.estimate(maps_are_done=done) for done in (True, False, False, True, False)]
    assert 0.8 < estimates[0].result.pairs[0].probability < 0.99
    assert [len(e.components) for e in estimates] == [1, 1, 1, 1, 1]
    assert estimates[-1].robot("middle").placements == 1
    # A pin that moves takes along what is linked to it.
    estimator.pin("left", (TRUTH["left"][0] + 5.0, *TRUTH["left"][1:]))
    after = estimator.estimate()
    assert len(after.components) == 1
    moved = after.robot("middle").T_world_map - estimates[-1].robot("middle").T_world_map
    assert np.allclose(moved, at(5.0), atol=0.05)


def test_groups_are_joined_across_what_is_held() -> None:
    """The merge has c apart, with d beside it: as c is held to a and b, d comes along."""
    groups = [Group({"a": at(0), "b": at(5)}), Group({"c": at(1), "d": at(3)})]
    kept = units(HELD, groups, (), CENTRES, Hold(), Witness(0.9))
    (group,) = joined(groups, kept, (), CENTRES, Hold())
    assert {n: T.round(9).tolist() for n, T in group.poses.items()} == {
        "a": [0, 0, 0],
        "b": [5, 0, 0],
        "c": [9, 0, 0],
        "d": [11, 0, 0],
    }


@pytest.mark.parametrize(("probability", "told"), [(0.9, False), (0.99, True)])
def test_a_new_link_is_told_when_it_is_clear(probability: float, told: bool) -> None:
    groups = [Group({"a": at(0), "b": at(5)})]
    alone = units([], groups, (), CENTRES, Hold(), Witness())
    found, unclear = admitted(groups, alone, (), (), CENTRES, Hold(), 0.98, Witness(probability))
    assert [set(g.poses) for g in found] == ([{"a", "b"}] if told else [{"a"}, {"b"}])
    assert unclear == ({} if told else {"a": 0.9, "b": 0.9})


def test_what_priors_place_is_not_asked_for_clear_walls() -> None:
    groups = [Group({"a": at(0), "b": at(5), "c": at(9)}, in_world=True)]
    alone = units([], groups, (), CENTRES, Hold(), Witness())
    found, _ = admitted(groups, alone, {"b", "c"}, (), CENTRES, Hold(), 0.98, Witness(0.9))
    assert [(set(g.poses), g.in_world) for g in found] == [({"b", "c"}, True), ({"a"}, False)]


def test_growing_maps_move_nobody_by_less_than_noise() -> None:
    estimator = Estimator()
    estimator.update(LEFT)
    estimator.update(MIDDLE)
    before = estimator.estimate().robot("middle").T_world_map
    moves = []
    for to in (10.0, 11.0, 12.0, 13.0, 14.0):
        estimator.update(view("left", (-0.5, to - 2), TRUTH["left"]))
        estimator.update(view("middle", (2.0, to + 1), TRUTH["middle"]))
        estimate = estimator.estimate()
        assert len(estimate.components) == 1
        cells = known_cells(view("middle", (2.0, to + 1), TRUTH["middle"]))
        metres, radians = apart(before, estimate.robot("middle").T_world_map, cells.centre)
        moves.append(metres + cells.radius * radians)
        before = estimate.robot("middle").T_world_map
    # Half a cell is what makes it worth following.
    assert all(m == 0.0 or m > 0.5 * MIDDLE.resolution for m in moves), moves
    assert 0.0 in moves
    assert estimate.robot("middle").placements == 1


def odd_hall(name: str) -> OccupancyGrid:
    """An angled hall whose mirror image is another one."""
    plain = hall(name)
    data = np.array(plain.data)
    data[4:6, 4:14] = data[20:27, 36:38] = data[22:24, 6:12] = 100
    data[18:, :15] = -1
    data[18, :15] = data[18:, 14] = 100
    return OccupancyGrid(data, plain.resolution, plain.origin, name)


def test_a_merge_that_later_maps_contradict_is_undone() -> None:
    """Two robots see like halls; then the second one's turns out to be another building."""
    estimator = Estimator()
    estimator.update(odd_hall("first"))
    estimator.update(LEFT)
    twin = odd_hall("second")
    estimator.update(twin)
    alike = estimator.estimate(maps_are_done=True)
    assert alike.robot("first").component == alike.robot("second").component, alike.robot("second").reason
    # The second hall has walls where the first has none, and is larger.
    data = np.full((90, 130), -1, dtype=np.int8)
    data[5:85, 5:125] = 0
    data[[5, 84], 5:125] = data[5:85, [5, 124]] = 100
    data[20:60, 40:44] = data[60:64, 44:100] = data[30:34, 70:118] = 100
    data[8:20, 90:93] = 100
    estimator.update(OccupancyGrid(data, twin.resolution, twin.origin, "second"))
    estimate = estimator.estimate()
    assert estimate.robot("first").component != estimate.robot("second").component
    assert estimate.robot("second").status in ("no evidence", "ambiguous")
    assert estimate.robot("second").placements == alike.robot("second").placements + 1
    assert len(estimate.robots) == 3


def test_a_robot_whose_map_frame_jumped_is_placed_again() -> None:
    estimator = Estimator()
    for grid in (LEFT, MIDDLE, RIGHT):
        estimator.update(grid)
    before = estimator.estimate()
    jumped = (TRUTH["right"][0] + 6.0, TRUTH["right"][1] - 4.0, TRUTH["right"][2] + 1.2)
    estimator.update(view("right", (5.0, 15.0), jumped))
    after = estimator.estimate()
    expected = se2.compose(se2.inverse(TRUTH["left"]), jumped)
    assert np.allclose(after.robot("right").T_world_map, expected, atol=0.2)
    assert after.robot("right").placements == before.robot("right").placements + 1
    assert after.robot("middle").placements == before.robot("middle").placements


@pytest.mark.parametrize("seed", [1, 2])
def test_a_simulated_building_is_never_told_wrong_while_it_is_revealed(seed: int) -> None:
    case = simulate(SimulateOptions(robots=3, seed=seed))
    truth = {(p["a"], p["b"]): np.array(p["T_a_b"]) for p in case.truth["pairs"]}
    estimator = Estimator()
    for step in range(1, 7):
        for grid in case.maps:
            estimator.update(revealed(grid, step / 6))
        estimate = estimator.estimate()
        assert [r.name for r in estimate.robots] == sorted(g.name for g in case.maps)
        for (a, b), T_a_b in truth.items():
            one, other = estimate.robot(a), estimate.robot(b)
            if one.component is not None and one.component == other.component:
                found = se2.compose(se2.inverse(one.T_world_map), other.T_world_map)
                assert math.hypot(*(found - T_a_b)[:2]) < 0.5
                assert abs(se2.wrap(found[2] - T_a_b[2])) < math.radians(5)
    assert max(r.placements for r in estimate.robots) <= 2


def revealed(grid: OccupancyGrid, share: float) -> OccupancyGrid:
    """The part of a map that lies nearest to its middle."""
    rows, cols = np.nonzero(grid.data >= 0)
    middle = rows.mean(), cols.mean()
    distance = np.hypot(rows - middle[0], cols - middle[1])
    known = distance <= np.quantile(distance, share)
    data = np.full_like(grid.data, -1)
    data[rows[known], cols[known]] = grid.data[rows[known], cols[known]]
    return OccupancyGrid(data, grid.resolution, grid.origin, grid.name)
