"""Shows an evaluation: rich tables for a terminal, or the same as plain text."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from mapmeld.acceptance import Acceptance
from mapmeld.evaluation import Evaluation, MapError, PairError, Summary

_NONE = "-"
"""What stands for a value that does not exist. Never 0: an error of 0 is a claim."""


def tables(evaluation: Evaluation) -> list[Table]:
    """The tables of maps and of pairs, for rich to print. A table without rows is left out."""
    maps = _table(
        "Maps (error to the anchor of the component)",
        ["map", "comp", "status", "anchor", "error m", "error deg", "rms m", "shares", "verdict", "accepted"],
        (_map_cells(m) for m in evaluation.maps),
    )
    pairs = _table(
        "Pairs (error of b seen from a)",
        ["a", "b", "shares", "truth", "rms m", "error m", "error deg", "verdict"],
        (_pair_cells(p) for p in evaluation.pairs),
    )
    return [table for table in (maps, pairs) if table.row_count]


def summary_lines(evaluation: Evaluation) -> list[str]:
    """The counts and the verdict of the acceptance rule, a sentence a line."""
    lines = [*_count_lines(evaluation.summary), *_acceptance_lines(evaluation.acceptance)]
    if evaluation.not_in_result:
        lines.append("Not in the result, so not judged: " + ", ".join(evaluation.not_in_result))
    return lines


def format_table(evaluation: Evaluation) -> str:
    """Tables and summary as plain text: ASCII frames, no colours, no line cut, no final newline."""
    rendered = tables(evaluation)
    out = io.StringIO()
    # Wide enough for every column, so that nothing is wrapped or cut in a file or pipe.
    measure = Console(file=io.StringIO(), width=100_000, color_system=None)
    width = max((measure.measure(table).maximum for table in rendered), default=80)
    console = Console(file=out, width=max(width, 80), color_system=None, force_terminal=False)
    for table in rendered:
        console.print(table)  # ends in an empty line, the foot of a Markdown table
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    return "\n".join([*lines, *summary_lines(evaluation)])


def _table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(title=title, title_justify="left", box=box.MARKDOWN)
    for head in heads:
        is_number = head.startswith("error") or head in ("shares", "rms m", "comp")
        table.add_column(head, justify="right" if is_number else "left", overflow="fold")
    for row in rows:
        # Text, not str: rich would read [brackets] in a map's name as markup.
        table.add_row(*(Text(cell) for cell in row))
    return table


def _map_cells(m: MapError) -> list[str]:
    # The anchor is what acceptance is measured against unless we say otherwise.
    by_neighbour = m.accepted and m.anchor not in (m.name, m.accepted_via)
    yes = f"yes, by {m.accepted_via}" if by_neighbour else "yes"
    accepted = {None: _NONE, True: yes, False: "no"}[m.accepted]
    return [
        m.name,
        _NONE if m.component is None else str(m.component),
        m.status,
        "(itself)" if m.anchor == m.name else m.anchor or _NONE,
        _number(m.translation_error_m, 3),
        _number(m.rotation_error_deg, 2),
        _number(m.rms_m, 3),
        _number(m.shares, 2),
        m.verdict,
        accepted,
    ]


def _pair_cells(p: PairError) -> list[str]:
    return [
        p.a,
        p.b,
        _number(p.overlap_occupied, 2),
        p.reference or _NONE,
        _number(p.rms_m, 3),
        _number(p.translation_error_m, 3),
        _number(p.rotation_error_deg, 2),
        p.verdict,
    ]


def _count_lines(s: Summary) -> list[str]:
    median = "" if s.median_right_m is None else f", median error of the right ones {s.median_right_m:.3f} m"
    return [
        f"Maps: {s.right_maps} of {s.maps} right together, {s.placed_maps} placed, in "
        f"{s.components} component{'' if s.components == 1 else 's'}.",
        f"Pairs: {s.joined} of {s.pairs} joined, {s.right} right, {s.fine} fine, {s.wrong} wrong{median}.",
    ]


def _acceptance_lines(a: Acceptance) -> list[str]:
    if a.holds is None:
        return [
            f"Acceptance: nothing to judge, no map is known to share {a.share:.2f} of its occupied cells."
        ]
    lines = [
        f"Acceptance: {'holds' if a.holds else 'fails'}; {a.accepted} of the {a.asked} maps that share at "
        f"least {a.share:.2f} are placed within tolerance (pairs that share as much: {a.pairs_accepted} of "
        f"{a.pairs_asked})."
    ]
    if a.failing:
        lines.append("Not accepted: " + ", ".join(a.failing))
    return lines


def _number(value: float | None, digits: int) -> str:
    return _NONE if value is None else f"{value:.{digits}f}"
