"""`mapmeld replay`: bags in, how the estimate developed out."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mapmeld.cli_common import reported

if TYPE_CHECKING:
    from mapmeld.replay import Moment
    from mapmeld.result import MergeResult

_MOST_CHANGES = 40
"""Rows of the table; all of them with --verbose."""


@reported
def replay(
    bags: Annotated[
        list[Path],
        typer.Argument(
            metavar="BAGS...", help="ROS bags: a folder, .mcap, .db3 or .bag.", show_default=False
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="Output folder, new or empty or of an earlier replay or merge: estimates.jsonl, "
            "development.png, merged.yaml and .pgm, result.json, report.png.",
            show_default=False,
        ),
    ],
    topics: Annotated[
        str | None,
        typer.Option(help="Topics of the maps, separated by commas; guessed.", show_default=False),
    ] = None,
    step: Annotated[
        float,
        typer.Option(help="Seconds of the bag's time between estimates; 0: one for every new map."),
    ] = 1.0,
    config: Annotated[
        Path | None, typer.Option(help="YAML file of options, as for merge.", show_default=False)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="STAGE.KEY=VALUE", help="One option; may be repeated.", show_default=False
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no summary.")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Tell every change.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds other files; they stay.")
    ] = False,
) -> None:
    """Replay recorded maps through the estimator, as a node would have heard them.

    Several bags are replayed side by side, by their recorders' clocks. An estimate is made whenever maps
    changed, at most once a step, and where it links maps that they count as done: after 20 s without a change
    and at the end.
    estimates.jsonl has each of them, the other files are those of the last one.
    """
    from mapmeld.bag import is_bag
    from mapmeld.cli_options import gather_options
    from mapmeld.errors import MapmeldError
    from mapmeld.map_inputs import check_bag_options, check_paths

    started = time.perf_counter()
    if not math.isfinite(step) or step < 0:
        raise MapmeldError(f"--step {step}: must be a number of seconds, 0 or more")
    for path in bags:
        if not is_bag(path):
            raise MapmeldError(f"{path}: is no bag; give a rosbag2 folder or an .mcap, .db3 or .bag file")
    check_paths(bags)
    named, _ = check_bag_options(bags, topics, None)
    options = gather_options(config, settings or [])

    from mapmeld.estimator import Estimator
    from mapmeld.map_inputs import choose_robots, open_bags
    from mapmeld.output import (
        DEVELOPMENT,
        ESTIMATES,
        OutputFolder,
        saying,
        write_merged_maps,
        write_report,
        write_result,
    )
    from mapmeld.replay import Replay
    from mapmeld.replay_files import moment_line, result_of_estimate
    from mapmeld.replay_picture import draw_development

    warnings: list[str] = []
    moments: list[Moment] = []
    with OutputFolder(output, force=force) as out:
        with (
            open_bags(bags) as opened,
            _progress(quiet) as progress,
            saying(out.staged / ESTIMATES),
            (out.staged / ESTIMATES).open("w", encoding="ascii") as lines,
        ):
            robots = choose_robots(opened, named, warnings)
            run = Replay(robots, Estimator(options), step, progress)
            for moment in run:
                moments.append(moment)
                lines.write(moment_line(moment))
        if run.estimate is None:
            raise MapmeldError(
                f"{', '.join(map(str, bags))}: no map with cells on {', '.join(r.topic for r in robots)}; "
                "there is nothing to replay"
            )
        result = result_of_estimate(run.estimate, {"total": time.perf_counter() - started})
        write_merged_maps(out.staged, result)
        write_report(out.staged, result, [run.maps[m.name] for m in result.maps])
        with saying(out.staged / DEVELOPMENT):
            draw_development(out.staged / DEVELOPMENT, moments, run.seconds)
        write_result(out.staged, result, out.folder)
        out.commit()
    missing = [r for r in robots if r.name not in run.maps]
    warnings += [f"{r.bag.path}: {r.topic} has no map with cells; {r.name} is left out" for r in missing]
    _tell(moments, result, warnings, output, time.perf_counter() - started, quiet, verbose)


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[float, float], object] | None]:
    """A bar of the bags' time on stderr, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("bag time"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} s"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _tell(
    moments: list[Moment],
    result: MergeResult,
    warnings: list[str],
    output: Path,
    seconds: float,
    quiet: bool,
    verbose: bool,
) -> None:
    if quiet:
        return
    from mapmeld.cli_common import stdout_console
    from mapmeld.merge_view import summary_table
    from mapmeld.merge_view import warnings as merge_warnings
    from mapmeld.replay_view import changes, changes_table

    console = stdout_console()
    found = changes(moments)
    shown = found if verbose else found[-_MOST_CHANGES:]
    if len(shown) < len(found):
        console.print(f"The last {len(shown)} of {len(found)} changes (-v shows all):", markup=False)
    console.print(changes_table(shown))
    console.print()
    console.print(summary_table(result))
    longest = max(m.seconds for m in moments)
    console.print(
        f"{len(moments)} estimates, the slowest {longest:.2f} s. Wrote {output} in {seconds:.2f} s.",
        markup=False,
        soft_wrap=True,
    )
    for line in [*warnings, *merge_warnings(result)]:
        print(f"mapmeld: warning: {line}", file=sys.stderr)
