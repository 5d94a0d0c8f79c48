"""Fits the probability of a merge on some buildings and reports it on others.

    python benchmarks/calibrate.py -o report.md --json rows.json    # collect, fit, report
    python benchmarks/calibrate.py --from rows.json                 # fit and report again

Pairs of maps are registered; the features of each pair's best mode (`verdict::features` of the core) and
whether it is right make one row. Every pair is asked both ways round: what chance
reaches is a matter of chance itself. A logistic model is fitted to all rows whose walls tell anything: its
weights are the default of `evidence.weights`. The tables are of models fitted without the building that they
are asked about: every recorded building, and every kind of simulated one, in turn. Recorded cases are looked
for as benchmarks/trust.py does.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import bench_report
import calibrate_rows
import trust_score
from calibrate_rows import Row
from mapmeld import default_config

RIDGE = 0.5
"""Penalty on the squared weights of standardised features, in units of one row's log-likelihood."""
SAME_BUILDING = 1.6
"""Weight of a wrong row of one building beside any other: who merges maps has them from one building, where
what looks alike is rarely so by chance, while most rows here are of strangers. At more, right merges
of buildings left out are lost much faster than wrong ones."""
FITTED_FROM = 4.0
"""Log-likelihood ratio of a row, nats, from which it is fitted: what shows less is never merged."""
EVIDENCE = default_config()["evidence"]
ACCEPTED = EVIDENCE["min_probability"]
"""Probability from which maps are merged."""
CACHE = bench_report.REPOSITORY / "target" / "calibrate"


def main(argv: Sequence[str] | None = None) -> None:
    args = _arguments(argv)
    if args.kept is not None:
        kept = json.loads(args.kept.read_text(encoding="utf-8"))
    else:
        kept = {"header": bench_report.header("Calibration of the verdict"), "rows": _collect(args)}
        if args.json is not None:
            args.json.write_text(json.dumps(kept) + "\n", encoding="utf-8")
    bench_report.write(kept["header"] + report(kept["rows"]), args.output)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scale", type=float, default=1.0, help="share of the buildings and pairs to take")
    parser.add_argument("--jobs", type=int, default=bench_report.usable_cores(), help="processes")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of simulated buildings")
    parser.add_argument("--json", type=Path, help="file to keep the rows in")
    parser.add_argument("--from", dest="kept", type=Path, help="fit such a file, measure nothing")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    return parser.parse_args(argv)


def _collect(args: argparse.Namespace) -> list[Row]:
    buildings = calibrate_rows.buildings(args.scale, args.cache)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(args.jobs, context) as pool:
        list(pool.map(calibrate_rows.build, buildings))
        asked = calibrate_rows.pairs([b.folder for b in buildings], args.scale)
        asked = [way for pair in asked for way in (pair, pair.turned)]
        rows = []
        for k, row in enumerate(pool.map(calibrate_rows.measure, asked, chunksize=8), start=1):
            rows += [row] if row is not None else []
            if k % 500 == 0:
                bench_report.tell(f"{k} of {len(asked)} pairs")
    return rows


def fit(
    features: NDArray[np.float64], right: NDArray[np.bool_], counts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The constant and the weight of each feature: logistic regression with a ridge, by Newton's method.

    counts: how often each row counts.
    """
    tells = features[:, 0] ** 2 >= FITTED_FROM
    features, right, counts = features[tells], right[tells], counts[tells]
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-9
    x = np.column_stack([np.ones(len(features)), (features - mean) / scale])
    penalty = np.diag([0.0, *[RIDGE] * features.shape[1]])
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1 / (1 + np.exp(-x @ w))
        gradient = x.T @ (counts * (right - p)) - penalty @ w
        step = np.linalg.solve((x.T * (counts * p * (1 - p))) @ x + penalty, gradient)
        w += step
        if np.abs(step).max() < 1e-9:
            break
    weights = w[1:] / scale
    return np.concatenate([[w[0] - weights @ mean], weights])


def log_odds(weights: NDArray[np.float64], features: NDArray[np.float64]) -> NDArray[np.float64]:
    """The log-odds that the fitted model gives each row."""
    odds: NDArray[np.float64] = weights[0] + features @ weights[1:]
    return odds


def predict(weights: NDArray[np.float64], features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of each row, as the core makes it (`verdict::probability`)."""
    walls = (features[:, 0] ** 2 - EVIDENCE["even_log_likelihood"]) / EVIDENCE["temperature"]
    p: NDArray[np.float64] = 1 / (1 + np.exp(-np.minimum(log_odds(weights, features), walls)))
    return p


def left_out(rows: Sequence[Row]) -> NDArray[np.float64]:
    """Probability of each row by a model that has seen nothing of its buildings."""
    features, right, counts = _arrays(rows)
    found = np.full(len(rows), np.nan)
    of_row = [set(r["buildings"]) for r in rows]
    for some in {tuple(sorted(b)) for b in of_row}:
        inside = np.array([b == set(some) for b in of_row])
        seen = np.array([not b & set(some) for b in of_row])
        found[inside] = predict(fit(features[seen], right[seen], counts[seen]), features[inside])
    return found


def report(rows: Sequence[Row]) -> str:
    features, right, counts = _arrays(rows)
    p = left_out(rows)
    groups = sorted({r["group"] for r in rows})
    table = []
    for g in [*groups, "ALL"]:
        at = np.array([r["group"] == g or g == "ALL" for r in rows])
        q, so = p[at], right[at]
        accepted = q >= ACCEPTED
        table.append(
            (
                g,
                int(at.sum()),
                int(so.sum()),
                int((accepted & so).sum()),
                int((accepted & ~so).sum()),
                f"{q[~so].max():.3f}" if (~so).any() else "-",
                f"{trust_score.brier(q.tolist(), so.tolist()):.4f}",
                f"{trust_score.expected_error(q.tolist(), so.tolist()):.4f}",
                f"{int((~so[q > 0.99]).sum())} of {int((q > 0.99).sum())}",
            )
        )
    columns = (
        "buildings", "pairs", "best mode right",
        f"right above {ACCEPTED}", f"wrong above {ACCEPTED}", "highest of the wrong",
        "Brier", "ECE", "wrong above 0.99",
    )  # fmt: skip
    weights = ", ".join(f"{v:.3f}" for v in fit(features, right, counts))
    shown = bench_report.table(columns, table)
    return f"\n## Buildings left out\n\n{shown}\n## Fitted to all\n\n    {weights}\n"


def _arrays(rows: Sequence[Row]) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Features, whether each row is right, and how often it counts."""
    right = np.array([r["right"] for r in rows], dtype=bool)
    strangers = np.array([r["group"] == calibrate_rows.STRANGERS for r in rows])
    counts = np.where(right | strangers, 1.0, SAME_BUILDING)
    return np.array([r["features"] for r in rows]), right, counts


if __name__ == "__main__":
    main()
