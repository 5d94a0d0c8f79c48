"""Tables of the trust benchmark: whether what a merge states of itself holds, and what lies beneath it."""

from __future__ import annotations

import statistics
from typing import Any

import bench_report
import trust_score
from trust_peers import FEATURES
from trust_tables import BANDS, Goal, Rows, Section, middle, number, share

_SAME_M, _SAME_DEG = 1e-6, 1e-5
_SURE = 0.99


def calibration(rows: Rows) -> Section:
    """Stated probabilities against what was so, over all merges of pairs."""
    text, goals = "", []
    for title, key, held, asked in (
        ("joined pairs", "probability", "right", [r for r in rows if r["joined"]]),
        ("best mode, all pairs", "mode_probability", "mode_right", list(rows)),
    ):
        asked = [r for r in asked if r.get(key) is not None]
        if not asked:
            text += f"### {title[0].upper()}{title[1:]}\n\nNo probability is stated.\n\n"
            continue
        stated, so = [float(r[key]) for r in asked], [bool(r[held]) for r in asked]
        ece = trust_score.expected_error(stated, so)
        sure = [h for p, h in zip(stated, so, strict=True) if p > _SURE]
        table = [
            (
                f"{k / 10:.1f} to {(k + 1) / 10:.1f}",
                len(b),
                number(statistics.mean(p for p, _ in b) if b else None, 3),
                number(statistics.mean(h for _, h in b) if b else None, 3),
            )
            for k, b in enumerate(trust_score.bins(stated, so))
        ]
        text += f"### {title[0].upper()}{title[1:]}\n\n"
        text += bench_report.table(("stated", "answers", "mean stated", "share right"), table)
        text += f"\nExpected calibration error {ece:.4f}, Brier score {trust_score.brier(stated, so):.4f}; "
        text += f"{len(sure)} answers above {_SURE}, {len(sure) - sum(sure)} of them not right.\n\n"
        goals += [
            Goal(f"calibration error, {title}", f"{ece:.3f}", "at most 0.05", ece <= 0.05),
            Goal(
                f"not right above {_SURE}, {title}", f"{len(sure) - sum(sure)} of {len(sure)}", "0", all(sure)
            ),
        ]
    return text, goals


def invariance(rows: Rows) -> Section:
    """The same maps in other orders."""
    names = list(dict.fromkeys(name for r in rows for name in r["variants"]))
    table, differing = [], 0
    for what, some in (
        ("two maps", [r for r in rows if r["maps"] == 2]),
        ("whole cases", [r for r in rows if r["maps"] > 2]),
    ):
        for name in names:
            seen = [r["variants"][name] for r in some if name in r["variants"]]
            if not seen:
                continue
            unlike = [v for v in seen if not _same(v)]
            differing += len(unlike)
            table.append(
                (
                    what,
                    name,
                    len(seen),
                    sum(not v["same_parts"] for v in seen),
                    sum(not v["same_statuses"] for v in seen),
                    len(unlike),
                    f"{max(v['metres'] for v in seen):.1e}",
                    f"{max(v['degrees'] for v in seen):.1e}",
                )
            )
    columns = (
        "merges",
        "inputs",
        "count",
        "other parts",
        "other status",
        "differing",
        "largest m",
        "largest deg",
    )
    asked = sum(len(r["variants"]) for r in rows)
    goal = Goal("answers that depend on the inputs' order", f"{differing} of {asked}", "0", not differing)
    unlike_rows = [r for r in rows if not all(_same(v) for v in r["variants"].values())]
    listed = "".join(f"- {r['case']}\n" for r in unlike_rows[:20])
    return bench_report.table(columns, table) + INVARIANCE_LEGEND + (f"\n{listed}" if listed else ""), [goal]


INVARIANCE_LEGEND = f"""
*other parts*: maps were grouped into components in another way; *other status*: some map's status changed;
*differing*: either, or a relative pose that moved by more than {_SAME_M:g} m or {_SAME_DEG:g} degrees (at
the centre of known cells).
"""


def _same(v: dict[str, Any]) -> bool:
    alike = bool(v["same_parts"] and v["same_statuses"])
    return alike and v["metres"] <= _SAME_M and v["degrees"] <= _SAME_DEG


def covariance(rows: Rows) -> Section:
    """Normalised errors squared of pairs that are right; hand-held maps, whose truth is loose, left out."""
    asked = [r for r in rows if r["right"] and r["nees"] is not None and r["family"] != "halmstad"]
    kinds = {
        "undrifted": [r for r in asked if not r["bent"]],
        "undrifted, simulated": [r for r in asked if not r["bent"] and not r["laser"]],
        "undrifted, laser": [r for r in asked if not r["bent"] and r["laser"]],
        "drifted, simulated": [r for r in asked if r["bent"] and not r["laser"]],
        "drifted, laser": [r for r in asked if r["bent"] and r["laser"]],
    }
    table = []
    for kind, mine in kinds.items():
        values = sorted(r["nees"] for r in mine)
        mean = statistics.mean(values) if values else None
        far = sum(v > 11.34 for v in values)
        table.append((kind, len(mine), number(mean, 2), number(middle(mine, "nees"), 2), far))
    values = [r["nees"] for r in kinds["undrifted"]]
    found = statistics.mean(values) if values else None
    goal = Goal(
        "normalised error squared, undrifted, mean",
        number(found, 2),
        "1.5 to 6",
        None if found is None else 1.5 <= found <= 6,
    )
    text = bench_report.table(("pairs", "count", "mean", "median", "above 11.34"), table)
    return text + "\nThree degrees of freedom: mean 3, median 2.37, one in a hundred above 11.34.\n", [goal]


def recall(rows: Rows) -> Section:
    """Whether the right pose is among candidates and modes."""
    text = ""
    for band, meaning in BANDS.items():
        mine = [r for r in rows if r["band"] == band]
        if not mine:
            continue
        groups = {f: [r for r in mine if r["family"] == f] for f in sorted({r["family"] for r in mine})}
        groups["ALL"] = mine
        sources = sorted({s for r in rows for s in r["candidates"]})
        table = []
        for family, some in groups.items():
            cells = []
            for s in sources:
                tried = sum(r["candidates"].get(s, 0) for r in some) / len(some)
                cells.append(f"{100 * sum(s in r['right_from'] for r in some) / len(some):.1f} ({tried:.0f})")
            any_source = 100 * sum(bool(r["right_from"]) for r in some) / len(some)
            among = 100 * sum(r["rank"] is not None for r in some) / len(some)
            first = 100 * sum(r["rank"] == 0 for r in some) / len(some)
            table.append((family, len(some), *cells, f"{any_source:.1f}", f"{among:.1f}", f"{first:.1f}"))
        columns = ("family", "pairs", *sources, "any source", "among modes", "first mode")
        text += f"### {meaning[0].upper()}{meaning[1:]} in common\n\n{bench_report.table(columns, table)}\n"
    text += "Percentages of pairs with a right pose; in brackets the mean number of candidates.\n"
    return text, []


def peers(rows: Rows) -> Section:
    """Other methods on the same pairs, and Mapmeld beside them."""
    table = []
    for method in dict.fromkeys(r["method"] for r in rows):
        mine = [r for r in rows if r["method"] == method]
        strangers = [r for r in mine if r["T_true"] is None]
        asked = [r for r in mine if r["T_true"] is not None]
        ours = method == "mapmeld"
        own = [r for r in mine if r["accepted"]]
        # Strict: an answer at the very score of a wrong one is not safe.
        bad = max((r["score"] for r in mine if r["wrong"]), default=float("-inf"))
        for band in BANDS:
            some = [r for r in asked if r["band"] == band]
            if not some:
                continue
            taken = [r for r in some if r["accepted"]]
            safe = sum(r["right"] and r["score"] > bad for r in some)
            no_test = all(r["accepted"] is None for r in some)
            table.append(
                (
                    method.upper() if method in (*FEATURES, "fft") else "Mapmeld",
                    band,
                    len(some),
                    "-" if no_test else f"{100 * sum(r['right'] for r in taken) / len(some):.1f}",
                    "-" if no_test else sum(r["wrong"] for r in taken),
                    "-" if no_test else f"{sum(r['T_true'] is None for r in own)} of {len(strangers)}",
                    "-" if ours else number(share(some, "right"), 1),
                    "-" if ours else f"{100 * safe / len(some):.1f}",
                    number(middle(some, "cpu"), 2),
                )
            )
    columns = (
        *("method", "walls", "pairs", "right %", "wrong", "strangers merged"),
        *("right % at any score", "right % with none wrong", "median CPU s"),
    )
    return bench_report.table(columns, table) + PEERS_LEGEND, []


PEERS_LEGEND = """
*walls*: many is a quarter or more in common, few is 5 % to a quarter. *right %*, *wrong*, *strangers
merged*: of what the method itself accepts (features: confidence 1.0; correlation has no test of its own).
*right % at any score*: of its best answer, accepted or not; *with none wrong*: of the answers whose score
is above every wrong one's, strangers included, a threshold that could only be known afterwards. CPU time is
of the whole pair, reading left out.
"""
