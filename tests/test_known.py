"""Priors, pins, points in common and forbidden pairs, told to a merge."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from mapmeld import Known, MapmeldError, Prior, SamePoints, merge, read_map, se2
from mapmeld.contradictions import contradictions
from mapmeld.merge_view import warnings
from mapmeld.result import MergeResult
from rooms import TRUTH, building, hall, view


def T_between(result: MergeResult, a: str, b: str) -> np.ndarray:
    placed = {m.name: m for m in result.maps}
    assert placed[a].component == placed[b].component
    return se2.compose(se2.inverse(placed[a].T_component_map), placed[b].T_component_map)


def is_true(result: MergeResult, a: str, b: str) -> bool:
    off = T_between(result, a, b) - se2.compose(se2.inverse(TRUTH[a]), TRUTH[b])
    return math.hypot(off[0], off[1]) < 0.3 and abs(se2.wrap(off[2])) < 0.05


def corners(a: str, b: str, *world: tuple[float, float]) -> SamePoints:
    """Places of the building, as they are seen in two maps."""
    seen = [tuple(tuple(se2.apply(se2.inverse(TRUTH[n]), np.array(p))) for n in (a, b)) for p in world]
    return SamePoints(a, b, tuple(seen))


def test_nothing_known_is_the_plain_merge() -> None:
    plain, told = merge(building()).to_dict(), merge(building(), known=Known()).to_dict()
    del plain["seconds"], told["seconds"]
    assert plain == told
    assert told["known"] is None


def test_pinned_maps_stay_exactly_where_they_are() -> None:
    pins = {"left": (3.0, -2.0, 0.5), "hall": (40.0, 0.0, 1.0)}
    result = merge([*building(), hall()], known=Known(pins=pins))
    placed = {m.name: m for m in result.maps}
    for name, T in pins.items():
        np.testing.assert_allclose(placed[name].T_component_map, T, atol=1e-9)
        assert placed[name].status == "pinned"
        assert "pinned" in placed[name].reason
    assert placed["middle"].component == placed["left"].component == placed["hall"].component
    assert result.components[placed["left"].component].in_world
    assert is_true(result, "left", "middle")


def test_a_prior_decides_between_walls_and_elsewhere() -> None:
    priors = {
        "left": Prior((0.0, 0.0, 0.0), (0.1, 0.1, 0.05)),
        "right": Prior((50.0, 0.0, 0.0), (0.1, 0.1, 0.05)),
    }
    result = merge([building()[0], building()[2]], known=Known(priors=priors))
    assert abs(T_between(result, "left", "right")[0] - 50.0) < 0.5


def test_points_in_common_tie_maps_that_share_no_wall() -> None:
    # Views of two ends of the building: nothing in common but what somebody knows.
    left, right = view("left", (-0.5, 5.0), TRUTH["left"]), view("right", (9.0, 15.0), TRUTH["right"])
    assert len(merge([left, right]).merged_maps) == 2
    result = merge([left, right], known=Known(same_points=(corners("left", "right", (0, 0), (0, 8)),)))
    assert len(result.merged_maps) == 1
    assert is_true(result, "left", "right")
    assert [m.status for m in result.maps] == ["prior", "prior"]
    assert "points in common with right" in result.maps[0].reason


def test_points_lift_a_match_that_walls_alone_do_not_carry() -> None:
    left, right = view("left", (-0.5, 8.5), TRUTH["left"]), view("right", (6.5, 15.0), TRUTH["right"])
    alone = merge([left, right])
    assert [m.status for m in alone.maps] == ["no evidence", "no evidence"]
    known = Known(same_points=(corners("left", "right", (7.0, 2.1), (7.0, 8.0)),))
    result = merge([left, right], known=known)
    assert [m.status for m in result.maps] == ["merged", "merged"]
    assert is_true(result, "left", "right")


def test_one_point_tells_a_shift_whatever_the_heading() -> None:
    one = corners("left", "middle", (7.0, 2.1))
    assert one.relation()[5] is None
    assert is_true(merge(building(), known=Known(same_points=(one,))), "left", "middle")


def test_points_that_contradict_the_walls_win() -> None:
    shifted = tuple(((p[0] + 30.0, p[1]), q) for p, q in corners("left", "middle", (4, 3), (10, 6)).points)
    result = merge(building()[:2], known=Known(same_points=(SamePoints("left", "middle", shifted),)))
    assert [m.status for m in result.maps] == ["prior", "prior"]
    assert not is_true(result, "left", "middle")


def test_walls_that_a_prior_overrules_are_told() -> None:
    left, middle, _ = building()
    assert contradictions(merge([left, middle])) == []
    priors = {name: Prior((x, 0.0, 0.0), (0.3, 0.3, 0.05)) for name, x in (("left", 0.0), ("middle", 40.0))}
    result = merge([left, middle], known=Known(priors=priors))
    assert [m.status for m in result.maps] == ["prior", "prior"]
    (told,) = contradictions(result)
    off = T_between(result, "left", "middle") - se2.compose(se2.inverse(TRUTH["left"]), TRUTH["middle"])
    assert {told.a, told.b} == {"left", "middle"}
    assert told.probability > 0.9
    assert told.metres > 5.0
    assert told.radians == pytest.approx(abs(se2.wrap(off[2])), abs=0.05)
    (line,) = (w for w in warnings(result) if "these two alone" in w)
    assert re.search(r"(left and middle|middle and left) lie \d+\.\d m and \d+ degrees from", line), line


def test_a_forbidden_pair_stays_apart_where_nothing_else_holds_it() -> None:
    pair = building()[:2]
    assert merge(pair).maps[1].status == "merged"
    result = merge(pair, known=Known(forbidden=(("middle", "left"),)))
    assert len(result.merged_maps) == 2
    assert result.pairs[0].status == "forbidden"
    assert result.pairs[0].probability == 0.0
    assert "forbidden" in result.maps[0].reason


def test_a_forbidden_match_is_not_made_by_way_of_others() -> None:
    # The middle map holds both; without it they would be where their walls match.
    left, middle, right = building()
    assert is_true(merge([left, middle, right]), "left", "right")
    result = merge([left, middle, right], known=Known(forbidden=(("left", "right"),)))
    components = {m.name: m.component for m in result.maps}
    together = components["left"] == components["right"]
    assert not together or not is_true(result, "left", "right")
    # One of them has the middle one.
    assert len(result.merged_maps) == 2


def test_a_forbidden_pair_holds_among_parts_that_join() -> None:
    # Two maps of one place each, so that parts form, and every pair across is forbidden.
    ends = [
        *(view(n, (-0.5, 9.0), TRUTH["left"]) for n in ("left", "left_2")),
        *(view(n, (5.0, 15.0), TRUTH["right"]) for n in ("right", "right_2")),
    ]
    ends[1] = view("left_2", (-0.5, 8.8), (2.0, -1.0, 0.2))
    ends[3] = view("right_2", (5.1, 15.0), (-1.0, 2.0, 0.9))
    assert len(merge(ends).merged_maps) == 1
    across = tuple((a, b) for a in ("left", "left_2") for b in ("right", "right_2"))
    result = merge(ends, known=Known(forbidden=across))
    assert [sorted(c.order) for c in result.components] == [["left", "left_2"], ["right", "right_2"]] or [
        sorted(c.order) for c in result.components
    ] == [["right", "right_2"], ["left", "left_2"]]


def test_a_forbidden_pair_may_be_held_by_other_maps_where_it_does_not_match() -> None:
    ends = [view("left", (-0.5, 6.2), TRUTH["left"]), view("right", (7.9, 15.0), TRUTH["right"])]
    maps = [ends[0], building()[1], ends[1]]
    assert is_true(merge(maps), "left", "right")
    result = merge(maps, known=Known(forbidden=(("left", "right"),)))
    assert is_true(result, "left", "right")


def test_the_order_of_maps_does_not_matter() -> None:
    known = Known(
        pins={"left": (0.0, 0.0, 0.0)},
        same_points=(corners("left", "middle", (4, 3), (10, 6)),),
        forbidden=(("left", "right"),),
    )
    forwards, backwards = merge(building(), known=known), merge(building()[::-1], known=known)
    for m in forwards.maps:
        other = next(o for o in backwards.maps if o.name == m.name)
        assert (m.status, m.probability) == (other.status, other.probability)
        np.testing.assert_array_equal(m.T_component_map, other.T_component_map)


def test_known_survives_json() -> None:
    known = Known(
        priors={"left": Prior((1.0, 2.0, 0.3), (0.1, 0.2, 0.05))},
        pins={"right": (4.0, 5.0, 0.6)},
        same_points=(corners("left", "middle", (4, 3), (10, 6)),),
        forbidden=(("middle", "right"),),
    )
    assert Known.from_dict(known.to_dict(), "file") == known
    assert len(known.lines()) == 4


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: SamePoints("a", "a", (((0, 0), (1, 1)),)), "two maps"),
        (lambda: SamePoints("a", "b", ()), "at least one"),
        (lambda: SamePoints("a", "b", (((0, 0), (math.nan, 1)),)), "finite"),
        (lambda: SamePoints("a", "b", (((0, 0), (0, 0)),), sigma=0.0), "positive"),
        (lambda: SamePoints("a", "b", (((0, 0), (0, 0)), ((5, 0), (9, 0)))), "not the same places"),
        (lambda: SamePoints("a", "b", ((1, 2),)), "pairs of"),
        (lambda: Known(forbidden=(("a", "a"),)), "two maps"),
        (lambda: Known(forbidden=("ab",)), "two maps"),
        (lambda: Known(pins={"a": (1, 2)}), "pin of 'a'"),
        (lambda: Known(priors={"a": (1, 2, 3)}), "prior of 'a': must be a mapmeld.Prior"),
        (lambda: Known(same_points=(1,)), "must be of mapmeld.SamePoints"),
        (lambda: merge(building(), known=Known(pins={"x": (0, 0, 0)})), "no map is called 'x'"),
        (
            lambda: Known(same_points=(SamePoints("a", "b", (((0, 0), (0, 0)),)),), forbidden=(("b", "a"),)),
            "forbidden and have points",
        ),
    ],
)
def test_bad_input_says_what_is_wrong(make, text: str) -> None:
    with pytest.raises(MapmeldError, match=text):
        make()


def test_a_recorded_merge_that_fails_alone_is_made_right_by_two_corners(shared_data: Path) -> None:
    import json

    case = shared_data / "intel_ov15"
    maps = [read_map(path) for path in sorted(case.glob("*.yaml"))]
    assert {m.status for m in merge(maps).maps} == {"no evidence"}
    T_a_b = json.loads((case / "truth.json").read_text())["pairs"][0]["T_a_b"]
    # Two places that both show, as exactly as a person clicks.
    centre = se2.apply(se2.inverse(T_a_b), np.array([0.0, 0.0]))
    points = tuple(
        (tuple(se2.apply(T_a_b, q) + 0.1), tuple(q)) for q in centre + np.array([[1.0, 2.0], [6.0, -3.0]])
    )
    known = Known(same_points=(SamePoints(maps[0].name, maps[1].name, points),))
    result = merge(maps, known=known)
    assert {m.status for m in result.maps} == {"merged"}
    off = T_between(result, maps[0].name, maps[1].name) - T_a_b
    assert math.hypot(off[0], off[1]) < 0.3


def test_a_lone_prior_says_nothing_and_says_so() -> None:
    left, _, _ = building()
    prior = Known(priors={"left": Prior((3.0, 0.0, 0.0), (0.1, 0.1, 0.05))})
    result = merge([left, hall()], known=prior)
    placed = {m.name: m for m in result.maps}
    assert placed["left"].status == "prior"
    assert "no other map lies in the world of its prior" in placed["left"].reason
