"""Every map says why it stands where it stands, and with which numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mapmeld
from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.reasons import reason
from mapmeld.result import Hypothesis, HypothesisMap, MergeResult, Mode, Pair
from rooms import TRUTH, building, hall, two_way_room, view


@pytest.fixture(scope="module")
def result() -> MergeResult:
    blank = OccupancyGrid(np.full((20, 20), UNKNOWN, dtype=np.int8), 0.05, (0.0, 0.0, 0.0), "blank")
    return mapmeld.merge([*building(), hall(), blank], seed=1)


def test_merged_maps_name_what_holds_them(result: MergeResult) -> None:
    merged = [m for m in result.maps if m.status == "merged"]
    assert len(merged) >= 2
    names = {m.name for m in merged}
    for m in merged:
        found = re.match(
            r"held by (\w+).*: probability ([0-9.]+) for these two alone, ([0-9.]+) m of wall in common",
            m.reason,
        )
        assert found, m.reason
        assert found[1] in names - {m.name}
        # The numbers are of one pair: what others there are stands behind them.
        assert re.fullmatch(r"(; \d+ more pairs? puts? it there too)?", m.reason[found.end() :]), m.reason
        pair = next(p for p in result.pairs if {p.a, p.b} == {m.name, found[1]})
        assert found[2] == f"{pair.probability:.2f}"
        assert found[3] == f"{pair.modes[0].shared_length:.1f}"


def test_others_say_what_is_lacking(result: MergeResult) -> None:
    by_name = {m.name: m for m in result.maps}
    assert by_name["hall"].status == "no evidence"
    assert re.search(r"no (shared walls that suffice|wall of another map)", by_name["hall"].reason)
    assert by_name["blank"].reason == "it holds no known cell, so it is placed nowhere"
    assert mapmeld.merge([hall()]).maps[0].reason == "it is the only map"


def test_a_room_that_a_half_turn_takes_to_itself_is_ambiguous() -> None:
    """Two maps of one closed, bare rectangular room: a half turn fits as well."""
    rooms = [two_way_room("a"), two_way_room("b", (3.0, -2.0, 0.4))]
    result = mapmeld.merge(rooms, seed=1)
    statuses = [m.status for m in result.maps]
    told = [(m.status, m.probability, m.reason) for m in result.maps]
    assert statuses == ["ambiguous", "ambiguous"], told
    assert len(result.merged_maps) == 2, "not guessed"
    order = [m.name for m in result.hypotheses[0].maps]
    ambiguous = next(m for m in result.maps if m.name == order[-1])
    assert "its place is not sure" in ambiguous.reason
    assert all(0.2 < m.probability < 0.8 for m in result.maps), told
    assert len(result.hypotheses) >= 2
    first, second = result.hypotheses[:2]
    assert first.probability == pytest.approx(second.probability, abs=0.35)
    assert first.probability < 0.8
    assert 0.7 < sum(h.probability for h in result.hypotheses) <= 1.0
    for h in result.hypotheses:
        assert sorted(m.name for m in h.maps) == ["a", "b"], "each once"
    turn = [next(m for m in h.maps if m.name == ambiguous.name).T_component_map[2] for h in (first, second)]
    assert abs((turn[0] - turn[1] + np.pi) % (2 * np.pi) - np.pi) > 3.0


def test_walls_that_run_one_way_leave_a_map_ambiguous() -> None:
    """What the two maps share is the outer walls between two rooms, 2.3 m of a corridor."""
    left, right = view("left", (-0.5, 8.5), TRUTH["left"]), view("right", (6.2, 15.0), TRUTH["right"])
    result = mapmeld.merge([left, right])
    told = [(m.status, m.reason) for m in result.maps]
    assert {m.status for m in result.maps} == {"ambiguous"}, told
    pair = result.pairs[0]
    assert pair.status == "ambiguous"
    assert pair.probability < 0.5
    along = np.sqrt(np.linalg.eigvalsh(pair.modes[0].covariance[:2, :2]).max())
    assert along > 1.0, "metres that it may slide"
    assert any("run nearly all in one direction" in m.reason for m in result.maps), told


def test_where_a_map_lies_alone_is_no_place_among_others() -> None:
    T = np.zeros(3)

    def told(component: int) -> str:
        maps = (HypothesisMap("a", 0, T), HypothesisMap("b", component, T))
        return reason("b", "ambiguous", {"b": T}, [], [Hypothesis(0.9, maps)], {"b": (0.0, 0.0)})

    assert "the likeliest one has 0.90" in told(0)
    assert "no place among them is probable" in told(1)


def test_what_holds_a_map_is_named_wherever_its_frame_lies() -> None:
    """A frame far off: the smallest turn moves its origin by metres, and the walls by nothing to speak of."""
    left, middle, right = building()
    away = OccupancyGrid(
        middle.data,
        middle.resolution,
        (middle.origin[0] + 5e4, middle.origin[1] - 3e4, middle.origin[2]),
        "away",
    )
    result = mapmeld.merge([left, away, right], seed=1)
    told = [(m.status, m.reason) for m in result.maps]
    assert all(
        status == "merged" and re.match(r"held by (left|away|right)", text) for status, text in told
    ), told


def told_apart(
    log_likelihood: float, mirrored: float, elsewhere: float | None, status: str = "no evidence"
) -> str:
    """The reason of map b, whose only pair reaches so much, as its mirror image, and at another place."""
    T, C = np.zeros(3), np.eye(3)
    none = ("log_odds", "misses", "opposed", "conflicts", "straight_conflicts", "bending")
    some = {
        "hits": 30.0,
        "shared_floor": 20.0,
        "agreement": 0.9,
        "shared_length": 9.0,
        "second_direction": 12.0,
    }
    numbers = dict.fromkeys(none, 0.0) | some
    places = [(T, log_likelihood)] + ([] if elsewhere is None else [(np.array([9.0, 0.0, 0.0]), elsewhere)])
    modes = tuple(
        Mode(T_a_b=t, covariance=C, log_likelihood=reached, source="corners", **numbers)
        for t, reached in places
    )
    pair = Pair("a", "b", 9, status, 0.9, mirrored, None, None, modes)
    return reason("b", "no evidence", {"b": T}, [pair], [], {"a": (0.0, 0.0), "b": (0.0, 0.0)})


def test_what_comes_near_a_match_is_named() -> None:
    assert told_apart(50.0, 40.0, None).endswith(", and its mirror image fits 80 % as well")
    assert told_apart(50.0, 10.0, 30.0).endswith(", and another place fits 60 % as well")
    assert told_apart(50.0, 60.0, 30.0).endswith(", and its mirror image fits better")
    assert told_apart(50.0, 10.0, 20.0).endswith("m of wall in common")


def test_a_map_whose_sure_matches_contradict_each_other_says_so() -> None:
    assert told_apart(50.0, 0.0, None, "merged").startswith(
        "alone it would merge with a (0.90), but among all maps no place is sure"
    )
