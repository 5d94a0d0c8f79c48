"""mapmeld.metrics_view: the tables as text."""

from __future__ import annotations

from mapmeld.metrics import evaluate
from mapmeld.metrics_view import format_table, tables
from metrics_cases import CENTRES, CHAIN, FRAMES, make_result, make_truth


def test_the_table_shows_every_map_and_pair_without_cutting_or_markup() -> None:
    long = "[bold]" + "x" * 150
    frames = {"a": FRAMES["a"], long: FRAMES["b"]}
    truth = make_truth(frames, {("a", long): 0.5})
    result = make_result(truth, {long: [0.123, 0.0, 0.0]})
    evaluation = evaluate(result, truth, {"a": (0.0, 0.0), long: (1.0, 2.0)})
    text = format_table(evaluation)
    assert text.count(long) >= 2
    assert "0.123" in text
    assert text.isascii()
    assert "\x1b" not in text
    assert "Acceptance: holds; 2 of the 2 maps" in text
    assert len(tables(evaluation)) == 2


def test_a_failed_acceptance_names_the_maps() -> None:
    truth = make_truth(FRAMES, CHAIN)
    text = format_table(evaluate(make_result(truth, {"c": [2.0, 0.0, 0.0]}), truth, CENTRES))
    assert "Acceptance: fails; 3 of the 4 maps" in text
    assert "Not accepted: c" in text
