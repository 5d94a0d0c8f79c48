"""mapmeld.metrics: known errors of pairs and maps, and what they must not depend on."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import numpy as np
import pytest

from mapmeld import se2
from mapmeld.metrics import evaluate
from mapmeld.metrics_view import format_table
from metrics_cases import BLANK, CENTRES, CHAIN, FRAMES, about, make_result, make_truth, row, two


def test_perfect_result_has_no_error_whatever_the_gauge() -> None:
    truth = make_truth(FRAMES, CHAIN)
    result = make_result(truth, gauge={0: [100.0, -50.0, 2.5]})
    evaluation = evaluate(result, truth, CENTRES)
    assert len(evaluation.pairs) == 6
    for p in evaluation.pairs:
        assert p.translation_error_m == pytest.approx(0, abs=1e-9)
        assert p.rotation_error_deg == pytest.approx(0, abs=1e-9)
        assert (p.joined, p.right, p.fine, p.wrong, p.verdict) == (True, True, True, False, "fine")
    assert evaluation.summary.right_maps == 4
    assert evaluation.acceptance.holds is True


def test_rotation_about_the_centre_is_no_translation_error() -> None:
    truth = two()
    p = evaluate(make_result(truth, {"b": about(CENTRES["b"], 4.0)}), truth, CENTRES).pairs[0]
    assert p.translation_error_m == pytest.approx(0, abs=1e-9)
    assert p.rotation_error_deg == pytest.approx(4.0)
    assert p.verdict == "right"


def test_rotation_about_the_origin_moves_the_centre() -> None:
    truth = two()
    p = evaluate(make_result(truth, {"b": [0.0, 0.0, math.radians(1.0)]}), truth, CENTRES).pairs[0]
    chord = 2 * math.hypot(*CENTRES["b"]) * math.sin(math.radians(0.5))
    assert p.translation_error_m == pytest.approx(chord)
    assert p.verdict == "off"


@pytest.mark.parametrize(
    ("metres", "degrees", "rms", "verdict"),
    [
        (0.149, 1.49, None, "fine"),
        (0.151, 0.0, None, "right"),
        (0.0, 1.51, None, "right"),
        (0.499, 4.9, None, "right"),
        (0.501, 0.0, None, "off"),
        (0.0, 5.1, None, "off"),
        (0.99, 9.9, None, "off"),
        (1.01, 0.0, None, "wrong"),
        (0.0, 10.1, None, "wrong"),
        (0.0, 180.0, None, "wrong"),
        (0.59, 0.0, 0.4, "fine"),  # 1.5 residuals
        (0.79, 0.0, 0.4, "right"),  # 2 residuals
        (1.19, 0.0, 0.4, "off"),  # 3 residuals
        (1.21, 0.0, 0.4, "wrong"),
    ],
)
def test_verdicts_follow_the_tolerances(
    metres: float, degrees: float, rms: float | None, verdict: str
) -> None:
    truth = two(rms_m=rms)
    error = se2.compose([metres, 0.0, 0.0], about(CENTRES["b"], degrees))
    p = evaluate(make_result(truth, {"b": error}), truth, CENTRES).pairs[0]
    assert p.translation_error_m == pytest.approx(metres, abs=1e-9)
    assert p.rotation_error_deg == pytest.approx(degrees, abs=1e-6)
    assert p.verdict == verdict


def test_three_cells_of_b_count_not_of_a() -> None:
    truth = two()
    result = make_result(truth, {"b": [0.29, 0.0, 0.0]})
    assert evaluate(result, truth, CENTRES, {"a": 0.02, "b": 0.1}).pairs[0].fine
    assert not evaluate(result, truth, CENTRES, {"a": 0.1, "b": 0.02}).pairs[0].fine


def test_the_pairs_own_truth_counts_where_the_maps_overlap_and_frames_below() -> None:
    truth = two(overlap=0.05)
    truth["pairs"][0]["T_a_b"][0] += 0.3
    p = evaluate(make_result(truth), truth, CENTRES).pairs[0]
    assert (p.reference, p.rms_m) == ("pair", 0.0)
    assert p.translation_error_m == pytest.approx(0.3)
    truth["pairs"][0]["overlap"] = 0.049
    p = evaluate(make_result(truth), truth, CENTRES).pairs[0]
    assert (p.reference, p.rms_m) == ("frames", 0.0)
    assert p.translation_error_m == pytest.approx(0, abs=1e-9)
    truth["variant"] = "drift"
    p = evaluate(make_result(truth), truth, CENTRES).pairs[0]
    assert (p.reference, p.rms_m) == ("frames", 0.3)


def test_a_truth_pair_written_the_other_way_is_judged_the_way_it_is_written() -> None:
    truth = two()
    p = truth["pairs"][0]
    p.update(a="b", b="a", T_a_b=se2.inverse(p["T_a_b"]).tolist())
    got = evaluate(make_result(truth, {"a": [0.2, 0.0, 0.0]}), truth, CENTRES).pairs[0]
    assert (got.a, got.b) == ("b", "a")
    assert got.translation_error_m == pytest.approx(0.2)


def test_without_any_truth_there_is_no_error_and_no_success() -> None:
    truth = two(T_a_b=None)
    truth["maps"][0]["T_world_map"] = None
    evaluation = evaluate(make_result(two()), truth, CENTRES)
    p = evaluation.pairs[0]
    assert (p.verdict, p.translation_error_m, p.right, p.reference) == ("no truth", None, False, None)
    assert evaluation.summary.pairs == 0
    assert evaluation.acceptance.holds is False
    assert {m.verdict for m in evaluation.maps} == {"no truth"}


def test_one_misplaced_map_is_the_only_one_blamed() -> None:
    truth = make_truth(FRAMES, CHAIN)
    # Truth's first map is the culprit, so that "take the first map as the anchor" would blame the others.
    evaluation = evaluate(make_result(truth, {"a": [3.0, 0.0, 0.0]}), truth, CENTRES)
    assert row(evaluation, "a").verdict == "wrong"
    assert row(evaluation, "a").translation_error_m == pytest.approx(3.0)
    assert [row(evaluation, n).verdict for n in "bcd"] == ["fine"] * 3
    assert row(evaluation, "a").anchor in "bcd"
    assert evaluation.summary.right_maps == 3
    assert evaluation.summary.wrong == 3
    assert (evaluation.acceptance.accepted, evaluation.acceptance.failing) == (3, ("a",))


def test_two_maps_that_agree_outvote_three_that_agree_with_nobody() -> None:
    frames = {**FRAMES, "e": [9.0, 9.0, 0.0]}
    centres = {**CENTRES, "e": (1.0, 1.0)}
    truth = make_truth(frames, CHAIN)
    moved = {"a": [3.0, 0.0, 0.0], "b": [-6.0, 0.0, 0.4], "c": [0.0, 9.0, 0.0]}
    evaluation = evaluate(make_result(truth, moved), truth, centres)
    assert row(evaluation, "a").anchor in "de"
    assert [m.verdict for m in evaluation.maps] == ["wrong", "wrong", "wrong", "fine", "fine"]


def test_the_anchor_claims_no_error_of_its_own() -> None:
    truth = two()
    evaluation = evaluate(make_result(truth, {"b": [3.0, 0.0, 0.0]}), truth, CENTRES)
    anchor = row(evaluation, evaluation.maps[0].anchor)
    assert anchor.translation_error_m is None
    assert anchor.verdict == "wrong"  # of two maps that disagree neither is right
    assert evaluation.summary.right_maps == 0
    assert evaluation.acceptance.accepted == 0


def test_components_are_measured_each_by_itself_and_one_counts() -> None:
    truth = make_truth(FRAMES, {**CHAIN, ("a", "d"): 0.15})
    components = {"a": 0, "b": 0, "c": 0, "d": 7}
    gauge = {0: [5.0, 5.0, 1.0], 7: [-80.0, 0.0, 3.0]}
    evaluation = evaluate(make_result(truth, components=components, gauge=gauge), truth, CENTRES)
    assert [row(evaluation, n).verdict for n in "abcd"] == ["fine", "fine", "fine", "alone"]
    assert [p.verdict for p in evaluation.pairs if "d" in (p.a, p.b)] == ["apart"] * 3
    assert (evaluation.summary.components, evaluation.summary.joined) == (2, 3)
    assert evaluation.acceptance.failing == ("d",)


def test_blank_maps_are_not_placed_and_need_no_centre() -> None:
    truth = make_truth(FRAMES, CHAIN)
    result = make_result(truth, {"b": BLANK})
    result["maps"][1]["component"] = None
    centres = {n: c for n, c in CENTRES.items() if n != "b"}
    evaluation = evaluate(result, truth, centres)
    blank = row(evaluation, "b")
    assert (blank.verdict, blank.component, blank.translation_error_m) == ("not placed", None, None)
    assert evaluation.acceptance.failing == ("b",)
    assert evaluation.summary.placed_maps == 3
    everything_blank = make_result(truth, dict.fromkeys("abcd", BLANK))
    evaluation = evaluate(everything_blank, truth, {})
    assert evaluation.summary.right_maps == 0
    assert evaluation.acceptance.accepted == 0
    assert "not placed" in format_table(evaluation)


def test_order_of_maps_and_frames_of_components_do_not_matter() -> None:
    truth = make_truth(FRAMES, CHAIN)
    rng = np.random.default_rng(3)
    moved = {n: [*rng.normal(0, 0.2, 2), rng.normal(0, 0.02)] for n in FRAMES}
    components = {"a": 0, "b": 0, "c": 0, "d": 1}
    base = evaluate(make_result(truth, moved, components), truth, CENTRES).to_dict()
    gauged = make_result(truth, moved, components, {0: [7.0, 8.0, -2.0], 1: [0.0, 1.0, 1.0]})
    gauged["maps"].reverse()
    assert_close(evaluate(gauged, truth, CENTRES).to_dict(), base)


def assert_close(x: Any, y: Any) -> None:
    """Equality of nested values, floats to 1e-9."""
    if isinstance(x, dict):
        assert x.keys() == y.keys()
        for key in x:
            assert_close(x[key], y[key])
    elif isinstance(x, list):
        assert len(x) == len(y)
        for u, v in zip(x, y, strict=True):
            assert_close(u, v)
    elif isinstance(x, float):
        assert x == pytest.approx(y, abs=1e-9)
    else:
        assert x == y


def test_inputs_are_left_alone_and_the_dict_is_json() -> None:
    truth = make_truth(FRAMES, CHAIN)
    result = make_result(truth, {"a": BLANK})
    before = copy.deepcopy((result, truth))
    evaluation = evaluate(result, truth, CENTRES)
    assert (result, truth) == before
    plain = evaluation.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain


def test_maps_left_out_of_the_result_are_named() -> None:
    truth = make_truth(FRAMES, CHAIN)
    result = make_result(truth)
    result["maps"] = result["maps"][:2]
    evaluation = evaluate(result, truth, CENTRES)
    assert evaluation.not_in_result == ("c", "d")
    assert len(evaluation.pairs) == 1
    assert "Not in the result, so not judged: c, d" in format_table(evaluation)
