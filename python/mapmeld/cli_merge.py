"""`mapmeld merge`: map files in, an output folder out."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapmeld.cli_common import reported

if TYPE_CHECKING:
    from mapmeld.merging import Progress
    from mapmeld.result import MergeResult


@reported
def merge(
    maps: Annotated[
        list[Path], typer.Argument(help="Saved maps: yaml files of map_server.", show_default=False)
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
    order: Annotated[
        str | None,
        typer.Option(
            help="Known order in which maps connect: names, separated by commas.", show_default=False
        ),
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Name of the map whose frame is the world.", show_default=False)
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of every random draw.", show_default=False)] = None,
    particles: Annotated[int | None, typer.Option(help="Number of particles.", show_default=False)] = None,
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
    json: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Also write result.json there; - prints it.", show_default=False),
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no summary.")] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Tell also of pairs, particles and times.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds other files; they stay.")
    ] = False,
) -> None:
    """Merge maps whose frames, overlaps and order are unknown.

    A map is called like its file without suffix. Maps that share too little evidence stay apart: every
    connected component becomes a merged map of its own, the largest merged.yaml, then merged_2.yaml, ...
    """
    from mapmeld.cli_options import gather_options
    from mapmeld.errors import MapmeldError

    started = time.perf_counter()
    if output is None and json is None:
        raise MapmeldError("no output folder; give one with -o DIR, or --json - to print the result")
    _check_files(maps)
    flags = [
        *_flag("--seed", seed, "seed"),
        *_flag("--particles", particles, "filter", "particles"),
        *_flag("--threads", threads, "threads"),
        *_flag("--resolution", resolution, "fuse", "resolution"),
    ]
    options = gather_options(config, settings or [], flags)
    names = None if order is None else [name.strip() for name in order.split(",") if name.strip()]
    if json is not None and str(json) != "-":
        _check_json(json, maps)

    from mapmeld.map_io import read_map
    from mapmeld.merging import merge as merge_maps
    from mapmeld.output import OutputFolder, replace_file, write_merged_maps, write_report, write_result

    with contextlib.ExitStack() as stack:
        out = None if output is None else stack.enter_context(OutputFolder(output, force=force, inputs=maps))
        if out is not None:
            threading.Thread(target=_load_matplotlib, daemon=True).start()
        grids = [read_map(path) for path in maps]
        read_seconds = time.perf_counter() - started
        with _progress(quiet) as progress:
            result = merge_maps(grids, order=names, reference=reference, config=options, progress=progress)
        extra = {"read": read_seconds}
        if out is not None:
            clock = time.perf_counter()
            write_merged_maps(out.staged, result)
            extra["write"] = time.perf_counter() - clock
            clock = time.perf_counter()
            write_report(out.staged, result, grids)
            extra["report"] = time.perf_counter() - clock
        extra["total"] = time.perf_counter() - started
        result = dataclasses.replace(result, seconds={**result.seconds, **extra})
        if out is not None:
            write_result(out.staged, result)
        if json is not None and str(json) != "-":
            replace_file(json, result.to_json().encode())
        if out is not None:
            out.commit()
    _tell(result, output, json, quiet, verbose)


def _load_matplotlib() -> None:
    """Loads what the report needs, which takes half a second, while the core needs no interpreter."""
    with contextlib.suppress(Exception):
        import matplotlib.backends.backend_agg
        import matplotlib.figure  # noqa: F401


def _check_files(maps: list[Path]) -> None:
    from mapmeld.errors import MapmeldError

    by_file: dict[Path, Path] = {}
    by_stem: dict[str, Path] = {}
    for path in maps:
        same = by_file.setdefault(path.resolve(), path)
        if same is not path:
            raise MapmeldError(f"{path}: is given twice (as {same}); give every map once")
        namesake = by_stem.setdefault(path.stem, path)
        if namesake is not path:
            raise MapmeldError(
                f"{path}: would be called {path.stem!r}, as {namesake} is; rename one, names tell maps apart"
            )


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
    if path.resolve() in {m.resolve() for m in maps}:
        raise MapmeldError(f"--json {path}: is one of the maps; choose another place")


_STAGES = {
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
        task = bar.add_task(_STAGES["prepare"], total=None)

        def show(stage: str, done: int, total: int) -> None:
            bar.update(task, description=_STAGES.get(stage, stage), completed=done, total=total)

        yield show


def _tell(result: MergeResult, output: Path | None, json: Path | None, quiet: bool, verbose: bool) -> None:
    from mapmeld.cli_common import stdout_console
    from mapmeld.merge_view import details, summary_table, warnings

    if json is not None and str(json) == "-":
        print(result.to_json(), end="")
    elif not quiet:
        console = stdout_console()
        console.print(summary_table(result))
        if verbose:
            for line in details(result):
                console.print(line, markup=False)
        if output is not None:
            console.print(f"Wrote {output} in {result.seconds['total']:.2f} s.", markup=False, soft_wrap=True)
    if not quiet:
        for line in warnings(result):
            print(f"mapmeld: warning: {line}", file=sys.stderr)
