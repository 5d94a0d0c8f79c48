"""`mapmeld report`: the page of an earlier merge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapmeld.cli_common import file_of, reported


@reported
def report(
    result: Annotated[
        Path, typer.Argument(help="The result.json of a merge, or its folder.", show_default=False)
    ],
    maps: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Yaml files of maps that are not where the result says any more.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The page; report.html beside the result.", show_default=False),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also write its pictures as PNG and SVG there.", show_default=False),
    ] = None,
) -> None:
    """Write the report of an earlier merge: one HTML file that needs no network.

    The maps are read again from where result.json says that they were, seen from its folder.
    """
    from mapmeld.output import PAGE, RESULT, replace_file
    from mapmeld.report_page import page, retold
    from mapmeld.result_file import read_maps, read_result

    result = file_of(result, RESULT)
    target = result.parent / PAGE if output is None else output
    _check_target(target, [result, *(maps or [])])
    if figures is not None:
        from mapmeld.report_page.figures import check_folder

        check_folder(figures)
    found = read_result(result)
    story = retold(found, read_maps(found, result, maps or []))
    replace_file(target, page(story).encode())
    print(target)
    if figures is not None:
        from mapmeld.report_page.figures import write_figures

        for path in write_figures(figures, story):
            print(path)


def _check_target(target: Path, inputs: list[Path]) -> None:
    """Before there is work to lose."""
    from mapmeld.errors import MapmeldError

    if not inputs[0].is_file():
        return  # Reading it says what is wrong; the page lies beside it, so its place would be blamed.
    if target.is_dir() or not target.absolute().parent.is_dir():
        raise MapmeldError(f"{target}: is no file in a folder that is there; choose another place with -o")
    if target.resolve() in (path.resolve() for path in inputs):
        raise MapmeldError(f"{target}: is an input; choose another place with -o")
