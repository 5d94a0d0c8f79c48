"""`mapmeld evaluate`: the errors of a result against a truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapmeld.cli_common import NOT_MET, file_of, print_json, reported


@reported
def evaluate(
    result: Annotated[
        Path, typer.Argument(help="result.json of a merge, or its folder.", show_default=False)
    ],
    truth: Annotated[Path, typer.Argument(help="truth.json of its case, or its folder.", show_default=False)],
    maps: Annotated[
        Path | None,
        typer.Option(help="Folder of the maps; that of the truth if not given.", show_default=False),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="End with 3 where a pair is wrong or the acceptance rule fails.")
    ] = False,
) -> None:
    """Measure the errors of every map and pair against the truth.

    Translation errors are measured at the centre of a map's known cells. docs/command_line.md explains the
    tables.
    """
    from mapmeld.metrics import evaluate_files
    from mapmeld.output import RESULT

    evaluation = evaluate_files(file_of(result, RESULT), file_of(truth, "truth.json"), maps)
    if json:
        print_json(evaluation.to_dict())
    else:
        from mapmeld.metrics_view import format_table

        print(format_table(evaluation))
    if strict and (evaluation.summary.wrong or evaluation.acceptance.holds is False):
        raise typer.Exit(NOT_MET)
