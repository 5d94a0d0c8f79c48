"""mapmeld.acceptance: which maps are asked, which are accepted, and by whom."""

from __future__ import annotations

import pytest

from mapmeld.metrics import evaluate
from mapmeld.metrics_view import format_table
from metrics_cases import BLANK, CENTRES, CHAIN, FRAMES, make_result, make_truth, row, two


def test_a_split_group_counts_its_larger_half_only() -> None:
    frames = {**FRAMES, "e": [9.0, 9.0, 0.0]}
    centres = {**CENTRES, "e": (1.0, 1.0)}
    truth = make_truth(frames, {**CHAIN, ("d", "e"): 0.3})
    components = {"a": 0, "b": 0, "c": 1, "d": 1, "e": 1}
    acceptance = evaluate(make_result(truth, components=components), truth, centres).acceptance
    assert acceptance.failing == ("a", "b")
    assert (acceptance.pairs_asked, acceptance.pairs_accepted) == (4, 3)


def test_groups_that_share_nothing_may_stay_apart() -> None:
    truth = make_truth(FRAMES, {("a", "b"): 0.4, ("c", "d"): 0.2})
    components = {"a": 0, "b": 0, "c": 1, "d": 1}
    acceptance = evaluate(make_result(truth, components=components), truth, CENTRES).acceptance
    assert (acceptance.asked, acceptance.accepted, acceptance.holds) == (4, 4, True)


def test_only_maps_that_share_enough_are_asked() -> None:
    truth = make_truth(FRAMES, {("a", "b"): 0.10, ("b", "c"): 0.099})
    evaluation = evaluate(make_result(truth, {"c": [5.0, 0.0, 0.0], "d": BLANK}), truth, CENTRES)
    assert (evaluation.acceptance.asked, evaluation.acceptance.holds) == (2, True)
    assert [row(evaluation, n).accepted for n in "abcd"] == [True, True, None, None]
    assert row(evaluation, "c").shares == pytest.approx(0.099)


def test_acceptance_without_known_shares_shows_nothing() -> None:
    truth = two(overlap_occupied=None)
    acceptance = evaluate(make_result(truth), truth, CENTRES).acceptance
    assert (acceptance.asked, acceptance.holds) == (0, None)


@pytest.mark.parametrize(("rms", "accepted"), [(None, False), (0.19, False), (0.21, True)])
def test_acceptance_allows_one_stated_residual(rms: float | None, accepted: bool) -> None:
    truth = two(rms_m=rms)
    evaluation = evaluate(make_result(truth, {"b": [0.2, 0.0, 0.0]}), truth, CENTRES)
    assert evaluation.acceptance.holds is accepted


def test_acceptance_allows_no_residual_that_we_assume() -> None:
    truth = two(overlap=0.04)
    truth["variant"] = "drift"
    evaluation = evaluate(make_result(truth, {"b": [0.2, 0.0, 0.0]}), truth, CENTRES)
    assert (evaluation.pairs[0].rms_m, evaluation.pairs[0].fine) == (0.3, True)
    assert evaluation.acceptance.holds is False


def test_bent_maps_are_accepted_by_a_chain_of_neighbours() -> None:
    # Every neighbour is where its pair's truth wants it; the frames disagree more with every step.
    truth = make_truth(FRAMES, CHAIN, variant="drift")
    for i, item in enumerate(truth["maps"]):
        item["T_world_map"][0] += 0.4 * i * i
    result = make_result(make_truth(FRAMES, CHAIN))
    evaluation = evaluate(result, truth, CENTRES)
    assert evaluation.acceptance.holds is True
    assert (evaluation.acceptance.pairs_asked, evaluation.acceptance.pairs_accepted) == (3, 3)
    far = next(m for m in evaluation.maps if m.reference == "frames")
    assert far.translation_error_m is not None
    assert far.translation_error_m > 0.15
    assert far.accepted
    assert far.accepted_via != far.anchor
    assert f"yes, by {far.accepted_via}" in format_table(evaluation)
    # The same frames cannot excuse a neighbour that is itself misplaced.
    bad = make_result(make_truth(FRAMES, CHAIN), {"d": [0.2, 0.0, 0.0]})
    assert evaluate(bad, truth, CENTRES).acceptance.failing == ("d",)
