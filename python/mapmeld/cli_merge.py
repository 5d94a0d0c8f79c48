"""`mapmeld merge`: map files and bags in, an output folder out."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapmeld import cli_known
from mapmeld.cli_common import NOT_MET, reported

if TYPE_CHECKING:
    from mapmeld.map_inputs import MapInputs
    from mapmeld.merging import Progress
    from mapmeld.result import MergeResult


@reported
def merge(
    maps: Annotated[
        list[Path],
        typer.Argument(
            help="Saved maps (yaml files of map_server, or folders of them) and ROS bags (a folder, .mcap, "
            ".db3 or .bag).",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Output folder, new or empty or of an earlier merge: merged.yaml and .pgm, result.json, "
            "report.png. May be left out with --json.",
            show_default=False,
        ),
    ] = None,
    topics: Annotated[
        str | None,
        typer.Option(
            help="Topics of the bags' maps, separated by commas; guessed. The last map of each is taken.",
            show_default=False,
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Of bags, the last map at or before: seconds from the bag's start, or a date. The end.",
            show_default=False,
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            help="Known order in which maps connect: names, separated by commas. Maps left out come after, "
            "in any order.",
            show_default=False,
        ),
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Name of the map whose frame is the world.", show_default=False)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of every random draw; 1.", show_default=False)
    ] = None,
    particles: Annotated[
        int | None, typer.Option(help="Number of particles; 100.", show_default=False)
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(help="Number of threads; all cores. The result is the same.", show_default=False),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(help="Cell size of merged maps, metres; finest of the inputs.", show_default=False),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="YAML file of options, nested by stage.", show_default=False)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="STAGE.KEY=VALUE",
            help="One option, stronger than --config; may be repeated. The options above are stronger still.",
            show_default=False,
        ),
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help=cli_known.SESSION_HELP, show_default=False),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=X,Y,THETA,SX,SY,STHETA", help=cli_known.PRIOR_HELP, show_default=False),
    ] = None,
    pin: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=X,Y,THETA", help=cli_known.PIN_HELP, show_default=False),
    ] = None,
    points: Annotated[
        list[str] | None,
        typer.Option(metavar="A,B=XA,YA,XB,YB,...", help=cli_known.POINTS_HELP, show_default=False),
    ] = None,
    forbid: Annotated[
        list[str] | None,
        typer.Option(metavar="A,B", help=cli_known.FORBID_HELP, show_default=False),
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder that keeps registered pairs: the next merge registers only those of changed maps.",
            show_default=False,
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Dask scheduler whose workers register pairs, tcp://host:8786; local: this machine's cores.",
            show_default=False,
        ),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Also write result.json there; - prints it.", show_default=False),
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Also write report.html, all of the merge on one page.")
    ] = False,
    figures: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Also write the report's pictures as PNG and SVG there.", show_default=False
        ),
    ] = None,
    rerun: Annotated[
        str | None,
        typer.Option(
            metavar="[FILE.rrd]",
            help="Record the merge for the Rerun viewer; without a file, open it (needs rerun-sdk).",
            show_default=False,
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, summary or warnings.")] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Tell also of pairs, particles and times.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds other files; they stay.")
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="End with 3 where not all make one merged map; all is written.")
    ] = False,
) -> None:
    """Merge maps whose frames, overlaps and order are unknown.

    A map is called like its file without suffix, with its folder where files are called alike (robot1/map);
    one of a bag like its namespace (/robot1/map: robot1). Maps that share too little evidence stay apart:
    every component becomes a merged map of its own, the largest merged.yaml, then merged_2.yaml, ...
    """
    from mapmeld.bag import is_bag
    from mapmeld.cli_options import gather_options
    from mapmeld.config import overlay
    from mapmeld.errors import MapmeldError
    from mapmeld.map_folder import with_folders_opened
    from mapmeld.map_inputs import check_bag_options, check_paths, read_inputs
    from mapmeld.merge_extras import Extras

    started = time.perf_counter()
    if output is None and json is None:
        raise MapmeldError("no output folder; give one with -o DIR, or --json - to print the result")
    extras = Extras(report, figures, rerun, output)
    notes: list[str] = []
    maps = with_folders_opened(maps, notes)
    check_paths(maps)
    named, moment = check_bag_options(maps, topics, at)
    flags = [
        *_flag("--seed", seed, "seed"),
        *_flag("--particles", particles, "filter", "particles"),
        *_flag("--threads", threads, "threads"),
        *_flag("--resolution", resolution, "fuse", "resolution"),
    ]
    saved_session = cli_known.read_session_option(session)
    base = {} if saved_session is None else saved_session.config
    options = overlay(base, gather_options(config, settings or [], flags))
    known = cli_known.gather_known(saved_session, prior, pin, points, forbid)
    names = None if order is None else [name.strip() for name in order.split(",") if name.strip()]
    if names == []:
        raise MapmeldError("--order: names no map; write a,b,c")
    if json is not None and str(json) != "-":
        _check_json(json, maps)

    from mapmeld.merging import merge as merge_maps
    from mapmeld.output import (
        OutputFolder,
        replace_file,
        write_merged_maps,
        write_report,
        write_result,
        write_session,
    )
    from mapmeld.pair_store import PairStore

    with contextlib.ExitStack() as stack:
        saved = [path for path in maps if not is_bag(path)]
        out = None if output is None else stack.enter_context(OutputFolder(output, force=force, inputs=saved))
        with _progress(quiet) as progress:
            inputs = read_inputs(maps, named, moment, progress)
            inputs.notes += notes
            grids = inputs.grids
            if saved_session is not None and session is not None:
                saved_session.check(grids, session)
            read_seconds = time.perf_counter() - started
            listener = extras.listen(stack, grids)
            store = None if cache is None else PairStore(cache)
            result = merge_maps(
                grids,
                order=names,
                reference=reference,
                config=options,
                known=known,
                progress=progress,
                listener=listener,
                cache=store,
                dask=dask,
            )
        extra = {"read": read_seconds}
        if out is not None:
            clock = time.perf_counter()
            write_merged_maps(out.staged, result)
            extra["write"] = time.perf_counter() - clock
            clock = time.perf_counter()
            write_report(out.staged, result, grids)
            extra["report"] = time.perf_counter() - clock
        result = _with_files(result, inputs)
        clock = time.perf_counter()
        if extras.draw(result, grids, extra, out):
            extra["page"] = time.perf_counter() - clock
        extra["total"] = time.perf_counter() - started
        result = dataclasses.replace(result, seconds={**result.seconds, **extra})
        if out is not None:
            write_result(out.staged, result, out.folder)
            if known is not None:
                from mapmeld.session_file import Session

                write_session(out.staged, Session.of(grids, options, known))
        if json is not None and str(json) != "-":
            replace_file(json, result.to_json(json.parent).encode())
        extras.save()
        if out is not None:
            out.commit()
    troubles = [] if store is None else store.warnings()
    _tell(result, inputs, output, json, quiet, verbose, troubles)
    if strict and len(result.merged_maps) != 1:
        raise typer.Exit(NOT_MET)


def _with_files(result: MergeResult, inputs: MapInputs) -> MergeResult:
    """The result, with where its maps were read from."""
    placed = zip(result.maps, inputs.files, strict=True)
    return dataclasses.replace(result, maps=tuple(dataclasses.replace(m, file=file) for m, file in placed))


def _flag(name: str, value: object, *path: str) -> list[tuple[str, dict[str, Any]]]:
    """The option at `path`, if its flag was given."""
    if value is None:
        return []
    options: Any = value
    for key in reversed(path):
        options = {key: options}
    return [(name, options)]


def _check_json(path: Path, maps: list[Path]) -> None:
    from mapmeld.errors import MapmeldError

    if path.is_dir() or not path.absolute().parent.is_dir():
        raise MapmeldError(f"--json {path}: is no file in a folder that is there; choose another place")
    target = path.resolve()
    if any(target == m.resolve() or (m.is_dir() and target.parent == m.resolve()) for m in maps):
        raise MapmeldError(f"--json {path}: is one of the maps, or in a bag; choose another place")


_STAGES = {
    "read": "maps read",
    "prepare": "maps prepared",
    "register": "pairs registered",
    "filter": "maps placed",
    "join": "parts joined",
    "fuse": "maps fused",
}


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Progress | None]:
    """A progress bar on stderr, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:>16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(_STAGES["read"], total=None)

        def show(stage: str, done: int, total: int) -> None:
            bar.update(task, description=_STAGES.get(stage, stage), completed=done, total=total)

        yield show


def _tell(
    result: MergeResult,
    inputs: MapInputs,
    output: Path | None,
    json: Path | None,
    quiet: bool,
    verbose: bool,
    troubles: list[str],
) -> None:
    from mapmeld.cli_common import stdout_console
    from mapmeld.merge_view import details, summary_table, warnings

    if json is not None and str(json) == "-":
        print(result.to_json(), end="")
    elif not quiet:
        console = stdout_console()
        console.print(summary_table(result))
        if verbose:
            for line in [*inputs.notes, *details(result)]:
                console.print(line, markup=False)
        if output is not None:
            console.print(f"Wrote {output} in {result.seconds['total']:.2f} s.", markup=False, soft_wrap=True)
    if not quiet:
        for line in [*inputs.warnings, *troubles, *warnings(result)]:
            print(f"mapmeld: warning: {line}", file=sys.stderr)
