"""The command line. Each command is a file of its own and imports what it needs when it runs."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from mapmeld import (
    cli_demo,
    cli_evaluate,
    cli_figures,
    cli_inspect,
    cli_merge,
    cli_replay,
    cli_report,
    cli_simulate,
    cli_studio,
)
from mapmeld.cli_common import EXIT_CODES, report_error
from mapmeld.cli_options import with_rerun

app = typer.Typer(
    name="mapmeld",
    help="Merges the occupancy grids of many robots into one map.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("merge", epilog=EXIT_CODES)(cli_merge.merge)
app.command("studio", epilog=EXIT_CODES)(cli_studio.studio)
app.command("replay", epilog=EXIT_CODES)(cli_replay.replay)
app.command("report", epilog=EXIT_CODES)(cli_report.report)
app.command("inspect", epilog=EXIT_CODES)(cli_inspect.inspect)
app.command("evaluate", epilog=EXIT_CODES)(cli_evaluate.evaluate)
app.command("figures", epilog=EXIT_CODES)(cli_figures.figures)
app.command("simulate", epilog=EXIT_CODES)(cli_simulate.simulate)
app.command("demo", epilog=EXIT_CODES)(cli_demo.demo)


def _print_version(wanted: bool) -> None:
    if wanted:
        from mapmeld import _core

        print(f"mapmeld {_core.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point of the command `mapmeld`. Raises SystemExit with the exit codes of cli_common."""
    try:
        app(args=with_rerun(sys.argv[1:]))
    except Exception as error:
        sys.exit(report_error(error))
    except KeyboardInterrupt as error:
        sys.exit(report_error(error))
