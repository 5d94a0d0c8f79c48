"""How well the merge places maps: the acceptance rule over many seeds, and errors on real buildings.

    python benchmarks/acceptance.py                                  # all cases; minutes
    python benchmarks/acceptance.py --cases maze10 --seeds 3
    python benchmarks/acceptance.py --model psi_gamma                # the paper's perception model

Order unknown. Bundled cases are always there; others are looked for in $MAPMELD_SHARED/data, by default
../shared/data as seen from the repository. Prints Markdown.
"""

from __future__ import annotations

import argparse
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import bench_cases
import bench_report
import mapmeld
from mapmeld.evaluation import Evaluation, MapError
from mapmeld.tolerance import ACCEPTED, SHARES_ENOUGH

MAZES = ("maze10", "mazeA_k3", "mazeA_k3_drift", "mazeA_k6", "mazeA_k6_drift", "mazeA_k10", "mazeA_k10_drift")
BUILDINGS = ("fr079_ov50", "fr079_k4_drift", "intel_k3_drift", "seattle_ov50", "intel_k10_drift")
MODELS = ("oriented_walls", "psi_gamma")
NEEDED = 0.95
"""Share of the seeds that must pass."""


@dataclass(frozen=True)
class Trial:
    """One merge of a case."""

    evaluation: Evaluation
    seconds: float

    @property
    def passed(self) -> bool:
        return self.evaluation.acceptance.holds is True


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", metavar="CASE", help="names; all without it")
    parser.add_argument("--seeds", type=int, help="seeds 1, 2, ..; 20 of mazes and 3 of buildings without it")
    parser.add_argument("--particles", type=int, default=100)
    parser.add_argument("--threads", type=int, help="all cores without it")
    parser.add_argument("--model", choices=MODELS, default=MODELS[0], help="perception.model")
    parser.add_argument("-o", "--output", type=Path, help="file for the Markdown; stdout without it")
    args = parser.parse_args(argv)

    trials: dict[str, list[Trial]] = {}
    absent: list[str] = []
    for name in args.cases or (*MAZES, *BUILDINGS):
        folder = bench_cases.find(name)
        if folder is None:
            bench_report.tell(f"{name}: not here")
            absent.append(name)
            continue
        case = bench_cases.load(folder)
        seeds = args.seeds or (3 if name in BUILDINGS else 20)
        trials[name] = []
        for seed in range(1, seeds + 1):
            trials[name].append(_run(case, seed, args.particles, args.threads, args.model))
            bench_report.tell(f"{name}, seed {seed}: {_in_short(trials[name][-1])}")

    limits = [
        f"Order unknown, {args.particles} particles, perception.model {args.model}, seeds from 1; maps in "
        "memory.",
        f"A seed passes when every map that shares at least {SHARES_ENOUGH:.2f} of its occupied cells with "
        f"another lies within {ACCEPTED.cells:g} cells (or the residual that the truth states, if larger) "
        f"and {ACCEPTED.degrees:g} degrees, at the centre of its known cells: of its component's anchor, or "
        "of a map that passes and shares as much with it (mapmeld.acceptance).",
        "Truth of buildings is that of corrected laser logs, not surveyed.",
    ]
    if absent:
        limits.append(
            f"Not measured, because not found among the bundled cases or in the shared folder "
            f"(MAPMELD_SHARED): {', '.join(absent)}."
        )
    text = bench_report.header("Acceptance", limits)
    text += f"\n## Cases\n\n{_summary(trials)}\n{LEGEND}"
    for name in trials:
        if name not in MAZES:
            text += f"\n## {name}\n\n{_per_map(trials[name])}\n{_counts(trials[name])}"
    bench_report.write(text, args.output)


def _run(case: bench_cases.Case, seed: int, particles: int, threads: int | None, model: str) -> Trial:
    result = mapmeld.merge(
        case.maps, particles=particles, seed=seed, threads=threads, config={"perception": {"model": model}}
    )
    return Trial(case.judge(result), result.seconds["merge"])


def _in_short(trial: Trial) -> str:
    a = trial.evaluation.acceptance
    failing = f"; not: {', '.join(a.failing)}" if a.failing else ""
    return f"{a.accepted} of {a.asked} maps accepted, {trial.seconds:.2f} s{failing}"


LEGEND = """
*goal*: at least 19 of 20 seeds (95 %) pass; asked of the mazes only. *maps*: fewest accepted of those asked,
over the seeds. *pairs*: the same for single pairs that share enough, each by itself: stricter, since it
forgives no map by another neighbour. *worst map*: largest error of a map asked, to its component's anchor;
where bent maps (drift) are far from their anchor, their true place is known by their first poses only, and
the error says little. *worst pair*: largest error of a pair that shares enough and was joined. *wrong*: most
joined pairs off by more than 1 m (or thrice the residual) or 10 degrees. *components*: how many, in how many
seeds.
"""


def _summary(trials: dict[str, list[Trial]]) -> str:
    rows = []
    for name, runs in trials.items():
        evaluations = [t.evaluation for t in runs]
        asked = [m for e in evaluations for m in e.maps if m.accepted is not None]
        pairs = [p for e in evaluations for p in e.pairs if (p.overlap_occupied or 0) >= SHARES_ENOUGH]
        passed = sum(t.passed for t in runs)
        verdicts = [e.acceptance for e in evaluations]
        rows.append(
            (
                name,
                f"{passed} of {len(runs)}",
                "-" if name in BUILDINGS else "met" if passed >= NEEDED * len(runs) else "missed",
                f"{min(a.accepted for a in verdicts)} of {verdicts[0].asked}",
                f"{min(a.pairs_accepted for a in verdicts)} of {verdicts[0].pairs_asked}",
                _worst((m.translation_error_m, m.rotation_error_deg) for m in asked),
                _worst((p.translation_error_m, p.rotation_error_deg) for p in pairs),
                max(e.summary.wrong for e in evaluations),
                _tally(str(e.summary.components) for e in evaluations),
                f"{statistics.median(t.seconds for t in runs):.2f}",
            )
        )
    columns = (
        "case",
        "seeds passed",
        "goal",
        "maps",
        "pairs",
        "worst map",
        "worst pair",
        "wrong",
        "components",
        "median s",
    )
    return bench_report.table(columns, rows)


def _worst(errors: Iterable[tuple[float | None, float | None]]) -> str:
    """The largest translation and the largest rotation, which need not be of one map."""
    known = [(t, r) for t, r in errors if t is not None and r is not None]
    if not known:
        return "-"
    return f"{max(t for t, _ in known):.3f} m, {max(r for _, r in known):.2f} deg"


def _tally(values: Iterable[str]) -> str:
    """Each value with how often it came, the most frequent first; alone without a number."""
    counts = Counter(values).most_common()
    return counts[0][0] if len(counts) == 1 else ", ".join(f"{v} ({n}x)" for v, n in counts)


def _per_map(trials: Sequence[Trial]) -> str:
    rows = []
    for maps in zip(*(t.evaluation.maps for t in trials), strict=True):
        seen: Sequence[MapError] = maps
        shares = seen[0].shares
        rows.append(
            (
                seen[0].name,
                "-" if shares is None else f"{shares:.2f}",
                _tally(str(m.component) for m in seen),
                _tally(m.status for m in seen),
                _each("anchor" if m.anchor == m.name else _number(m.translation_error_m, 3) for m in seen),
                _each("anchor" if m.anchor == m.name else _number(m.rotation_error_deg, 2) for m in seen),
                _tally(m.verdict for m in seen),
                _tally("not asked" if m.accepted is None else "yes" if m.accepted else "no" for m in seen),
            )
        )
    columns = ("map", "shares", "component", "status", "error m", "error deg", "verdict", "accepted")
    return bench_report.table(columns, rows)


def _each(values: Iterable[str]) -> str:
    """The value of each seed; once when all have the same."""
    listed = list(values)
    return listed[0] if len(set(listed)) == 1 else " / ".join(listed)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _counts(trials: Sequence[Trial]) -> str:
    lines = []
    for k, t in enumerate(trials, start=1):
        s = t.evaluation.summary
        lines.append(
            f"- seed {k}: of {s.pairs} pairs with truth {s.joined} joined, {s.right} right, {s.fine} fine, "
            f"{s.wrong} wrong; {s.components} component(s); {t.seconds:.2f} s\n"
        )
    return "".join(lines)


if __name__ == "__main__":
    main()
