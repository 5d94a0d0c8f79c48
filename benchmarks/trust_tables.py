"""Tables of the trust benchmark: how pairs and whole cases were placed, and what should have stayed apart.

Every section gives its Markdown and the goals that it speaks to.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bench_report

Rows = Sequence[dict[str, Any]]
BANDS = {"many": "a quarter of the walls or more", "few": "5 % to a quarter of the walls"}
_MOST_LISTED = 30


@dataclass(frozen=True)
class Goal:
    """A figure beside what it should be. met None: nothing was measured."""

    figure: str
    measured: str
    goal: str
    met: bool | None

    def row(self) -> tuple[str, str, str, str]:
        state = "not measured" if self.met is None else "met" if self.met else "missed"
        return self.figure, self.measured, self.goal, state


Section = tuple[str, list[Goal]]


def pairs(rows: Rows) -> Section:
    """Two maps alone, by band of walls in common."""
    text, goals = "", []
    for band, meaning in BANDS.items():
        mine = [r for r in rows if r["band"] == band]
        if not mine:
            continue
        text += f"### {meaning[0].upper()}{meaning[1:]} in common\n\n{_placings(mine)}\n"
        plain = [r for r in mine if r["family"] != "halmstad"]
        goals.append(
            _at_least(f"pairs with {meaning}: right", share(mine, "right"), 97 if band == "many" else 60)
        )
        if band == "many":
            goals.append(
                _at_least(f"pairs with {meaning}: fine, hand-held left out", share(plain, "fine"), 95)
            )
    goals.append(none_of("pairs: wrong", rows, "wrong"))
    laser = [r for r in rows if r["right"] and r["laser"] and not r["bent"]]
    metres, degrees = middle(laser, "error_m"), middle(laser, "error_deg")
    goals += [
        _at_most("median error, undrifted laser, m", metres, 0.02, 3),
        _at_most("median error, undrifted laser, degrees", degrees, 0.1, 2),
    ]
    return text + _listed("Wrong", [r for r in rows if r["wrong"]]), goals


PAIRS_LEGEND = """
*right*: within 0.5 m (or twice the residual of the truth) and 5 degrees at the centre of the second map's
known cells; *fine*: within 0.15 m (or three cells, or 1.5 times the residual) and 1.5 degrees; *wrong*:
joined, yet off by more than 1 m (or thrice the residual) or 10 degrees; *refused*: left apart. Counts are
of merges, a pair once a seed; *unsteady*: pairs whose verdict depends on the seed. Medians are over the
right ones.
"""


def _placings(rows: Rows) -> str:
    groups = {f: [r for r in rows if r["family"] == f] for f in sorted({r["family"] for r in rows})}
    groups["undrifted laser"] = [r for r in rows if r["laser"] and not r["bent"]]
    groups["ALL"] = list(rows)
    columns = (
        *("family", "pairs", "merges", "right %", "fine %", "wrong", "refused", "unsteady"),
        *("median m", "median deg", "median s"),
    )
    table = []
    for family, mine in groups.items():
        if not mine:
            continue
        right = [r for r in mine if r["right"]]
        plain = [r for r in mine if r["family"] != "halmstad"]
        verdicts: dict[tuple[str, ...], set[tuple[bool, bool]]] = {}
        for r in mine:
            verdicts.setdefault(pair_key(r), set()).add((r["joined"], r["right"]))
        table.append(
            (
                family,
                len(verdicts),
                len(mine),
                number(share(mine, "right"), 1),
                number(share(plain, "fine"), 1),
                sum(r["wrong"] for r in mine),
                sum(not r["joined"] for r in mine),
                sum(len(v) > 1 for v in verdicts.values()),
                number(middle(right, "error_m"), 3),
                number(middle(right, "error_deg"), 2),
                number(middle(mine, "seconds"), 2),
            )
        )
    return bench_report.table(columns, table)


def strangers(rows: Rows, figure: str) -> Section:
    """Maps of different buildings, which must stay apart."""
    kinds: dict[str, list[dict[str, Any]]] = {}
    for r in rows:
        both = {r["case_a"], r["case_b"]}
        simulated = sum("_sim" in case for case in both)
        kind = "simulated" if simulated == 2 else "recorded with simulated" if simulated else "recorded"
        kinds.setdefault(kind, []).append(r)
    kinds["ALL"] = list(rows)
    table = [
        (kind, len({pair_key(r) for r in mine}), len(mine), sum(r["joined"] for r in mine))
        for kind, mine in kinds.items()
    ]
    text = bench_report.table(("maps", "pairs", "merges", "merged"), table) + "\n"
    return text + _listed("Merged", [r for r in rows if r["joined"]]), [none_of(figure, rows, "joined")]


def same(rows: Rows) -> Section:
    """Maps of one building that have nothing in common."""
    families = {f: [r for r in rows if r["family"] == f] for f in sorted({r["family"] for r in rows})}
    families["ALL"] = list(rows)
    table = [
        (
            family,
            len({pair_key(r) for r in mine}),
            len(mine),
            sum(r["joined"] for r in mine),
            sum(r["right"] for r in mine),
            sum(r["wrong"] for r in mine),
        )
        for family, mine in families.items()
    ]
    text = bench_report.table(("family", "pairs", "merges", "merged", "right", "wrong"), table) + "\n"
    text += _listed("Merged wrongly", [r for r in rows if r["wrong"]])
    return text, [none_of("one building, no shared walls: merged wrongly", rows, "wrong")]


def whole(rows: Rows) -> Section:
    """All maps of a case at once."""
    table, goals = [], []
    for case in dict.fromkeys(r["case"] for r in rows):
        mine = [r for r in rows if r["case"] == case]
        joined = f"{sum(r['wrong'] for r in mine)}/{sum(r['joined'] for r in mine)}"
        placed = sorted({r["placed"] for r in mine})
        table.append(
            (
                case.split("_sim")[0] + (" (simulated)" if "_sim" in case else ""),
                len(mine),
                mine[0]["maps"],
                mine[0]["linked"],
                f"{placed[0]}..{placed[-1]}" if len(placed) > 1 else str(placed[0]),
                joined,
                number(middle(mine, "error_m"), 3),
                number(middle(mine, "seconds"), 1),
            )
        )
    columns = ("case", "seeds", "maps", "linked", "right", "wrong/joined pairs", "median m", "median s")
    for kind, mine in (
        ("whole cases", [r for r in rows if "_sim" not in r["case"]]),
        ("whole simulated cases", [r for r in rows if "_sim" in r["case"]]),
    ):
        if mine:
            # Simulated robots may share nothing with each other, so only maps that are linked are asked.
            asked = sum(r["linked" if "simulated" in kind else "maps"] for r in mine)
            placed_maps = sum(
                min(r["placed"], r["linked"]) if "simulated" in kind else r["placed"] for r in mine
            )
            goals.append(_at_least(f"{kind}: maps placed", 100 * placed_maps / max(asked, 1), 98))
            goals.append(
                _zero(f"{kind}: wrong pairs", sum(r["wrong"] for r in mine), sum(r["joined"] for r in mine))
            )
    return bench_report.table(columns, table) + WHOLE_LEGEND, goals


WHOLE_LEGEND = """
*linked*: the most maps that hang together by pairs with a quarter of their walls in common; *right*: the
most maps that are right with one of them, that one included, over the seeds; *wrong/joined pairs*: over all
seeds. Of simulated cases only the linked maps are asked for.
"""


def some(rows: Rows) -> Section:
    """Some maps of a case at once."""
    table = []
    for case in dict.fromkeys(r["case"] for r in rows):
        mine = [r for r in rows if r["case"] == case]
        sums = (sum(r[key] for r in mine) for key in ("maps", "parts", "joined", "right", "wrong"))
        table.append((case, len(mine), *sums))
    columns = ("case", "merges", "maps", "parts", "joined pairs", "right", "wrong")
    text = bench_report.table(columns, table) + SOME_LEGEND
    for r in rows:
        if r["wrong"]:
            text += f"- {r['case']}, seed {r['seed']}: {', '.join(r['names'])}: {r['wrong']} pairs wrong\n"
    wrong, joined = (sum(r[key] for r in rows) for key in ("wrong", "joined"))
    return text, [_zero("some maps of a case: wrong pairs", wrong, joined)]


SOME_LEGEND = """
Three to six maps of a case, drawn anew for each merge. *maps*, *parts* (single maps included) and pairs are
sums over the merges.

"""


def pair_key(row: dict[str, Any]) -> tuple[str, ...]:
    """What tells a pair from others, whatever the seed."""
    return row["case_a"], row["a"], row["case_b"], row["b"]


def share(rows: Rows, key: str) -> float | None:
    """Percentage of the rows where the key holds."""
    return 100 * sum(bool(r[key]) for r in rows) / len(rows) if rows else None


def middle(rows: Rows, key: str) -> float | None:
    """Median of the values that exist."""
    values = [r[key] for r in rows if r[key] is not None]
    return statistics.median(values) if values else None


def number(value: float | None, digits: int) -> str:
    """A number, or a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def none_of(figure: str, rows: Rows, key: str) -> Goal:
    """The goal that the key holds in no row."""
    return _zero(figure, sum(bool(r[key]) for r in rows), len(rows))


def _zero(figure: str, count: int, of: int) -> Goal:
    return Goal(figure, f"{count} of {of}", "0", count == 0 if of else None)


def _at_least(figure: str, value: float | None, least: float) -> Goal:
    met = None if value is None else value >= least
    return Goal(figure, "-" if value is None else f"{value:.1f} %", f"at least {least:g} %", met)


def _at_most(figure: str, value: float | None, most: float, digits: int) -> Goal:
    return Goal(figure, number(value, digits), f"at most {most:g}", None if value is None else value <= most)


def _listed(title: str, rows: Rows) -> str:
    if not rows:
        return ""
    merges: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for r in rows:
        merges.setdefault(pair_key(r), []).append(r)
    lines = []
    for (case_a, a, case_b, b), mine in list(merges.items())[:_MOST_LISTED]:
        error = f"{mine[0]['error_m']:.2f} m, {mine[0]['error_deg']:.1f} deg, " if mine[0]["T_true"] else ""
        seeds = ", ".join(str(r["seed"]) for r in mine)
        stated = mine[0]["probability"]
        lines.append(f"- {case_a}/{a} with {case_b}/{b}: {error}stated {stated:.3f}, seed {seeds}\n")
    if len(merges) > _MOST_LISTED:
        lines.append(f"- and {len(merges) - _MOST_LISTED} more pairs\n")
    return f"{title}:\n\n{''.join(lines)}\n"
