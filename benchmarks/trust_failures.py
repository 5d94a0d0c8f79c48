"""Every pair that failed, with its numbers and what they say of the cause."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bench_report
import trust_tables

Row = dict[str, Any]

_MUCH_CONFLICT = 0.08
"""Share of the observations in free space from which a right pose looks like a wrong one."""
_HIGH_CHANCE = 0.6
"""Share of the log-likelihood that chance reaches, from which little stands out."""
_LITTLE_WALL = 8.0
"""Metres of wall in common that are few."""

LEGEND = """
*probability* and *log-likelihood* (nats): of the best mode of the two maps alone; *chance*: the most that the
mirror image or another place reaches; *conflicts*: walls in the other map's free space, of those that it
tells of. Numbers are those of the pictures (`--failures`).
"""


def failed(row: Row) -> bool:
    """Whether a merge of two maps is one to look at: wrong, or not right where it should have been."""
    return bool(row["wrong"]) or (row["band"] is not None and not row["right"])


def distinct(rows: Sequence[Row]) -> list[Row]:
    """The failed pairs, each once, of its first failing seed; those with most walls in common first."""
    found: dict[tuple[str, ...], Row] = {}
    for row in filter(failed, rows):
        found.setdefault(trust_tables.pair_key(row), row)
    return sorted(found.values(), key=lambda r: (-r["walls"], *trust_tables.pair_key(r)))


def evidence(told: Row, rank: int | None, rival: float) -> Row:
    """What a row keeps of a pair of the result (docs/result.md); rank: of the first right mode; rival: the
    log-likelihood of the best other place."""
    kept = {
        k: told.get(k) for k in ("log_likelihood", "hits", "opposed", "conflicts", "shared_length", "modes")
    }
    chance = max(rival, told.get("decoy_log_likelihood") or 0.0)
    return {**kept, "chance": chance, "rank": rank}


def cause(row: Row) -> str:
    """The cause that the numbers name first, in words."""
    e = row["evidence"]
    if row["wrong"]:
        return "wrong: a look-alike fits better than the truth" if e["rank"] != 0 else "wrong"
    if not e.get("modes"):
        return "no pose stands out at all"
    if e["rank"] is None:
        return f"no right pose among the {e['modes']} modes"
    if e["rank"] > 0:
        better = e["rank"]
        return f"{better} other pose{'s fit' if better > 1 else ' fits'} better"
    if row["joined"]:
        return "joined, a little off"
    share = e["conflicts"] / (e["hits"] + e["conflicts"] + 1e-9)
    chance = e["chance"] / max(e["log_likelihood"], 1e-9)
    if share > _MUCH_CONFLICT:
        return f"contradicts itself: {100 * share:.0f} % of its walls in free space"
    if chance > _HIGH_CHANCE:
        return f"chance reaches {100 * chance:.0f} % of its likelihood"
    if e["shared_length"] < _LITTLE_WALL:
        return f"only {e['shared_length']:.0f} m of wall in common"
    return "right, but just not sure enough"


def table(rows: Sequence[Row]) -> str:
    """Markdown, a line a pair; the numbers are those of the contact sheet."""
    columns = (
        *(
            "no.",
            "pair",
            "walls %",
            "merges failed",
            "probability",
            "log-likelihood",
            "chance",
            "conflicts %",
        ),
        *("metres shared", "cause"),
    )
    lines = []
    for number, row in enumerate(distinct(rows), start=1):
        e = row["evidence"]
        mine = [r for r in rows if trust_tables.pair_key(r) == trust_tables.pair_key(row)]
        seen = e["log_likelihood"] is not None
        share = 100 * e["conflicts"] / (e["hits"] + e["conflicts"] + 1e-9) if seen else None
        lines.append(
            (
                number,
                f"{row['case_a']} {row['a']} {row['b']}",
                f"{100 * row['walls']:.0f}",
                f"{sum(failed(r) for r in mine)} of {len(mine)}",
                trust_tables.number(row["mode_probability"], 2),
                trust_tables.number(e["log_likelihood"], 1),
                trust_tables.number(e["chance"], 1),
                trust_tables.number(share, 0),
                trust_tables.number(e["shared_length"], 0),
                cause(row),
            )
        )
    if not lines:
        return "None.\n"
    return bench_report.table(columns, lines)
