"""The command line. Each command is a file of its own, read when it is asked for."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import typer

from mapmeld.cli_common import EXIT_CODES, report_error
from mapmeld.cli_options import with_rerun

COMMANDS = ("merge", "studio", "replay", "report", "inspect", "evaluate", "figures", "simulate", "demo")
"""In the order of --help. Each is the function of its name in cli_<name>.py."""


def build_app(commands: Sequence[str] = COMMANDS) -> typer.Typer:
    """The program with these commands."""
    app = typer.Typer(
        name="mapmeld",
        help="Merges the occupancy grids of many robots into one map.",
        epilog=EXIT_CODES,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    for name in commands:
        app.command(name, epilog=EXIT_CODES)(getattr(import_module(f"mapmeld.cli_{name}"), name))
    return app


def _print_version(wanted: bool) -> None:
    if wanted:
        from mapmeld import _core

        print(f"mapmeld {_core.__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point of the command `mapmeld`. Raises SystemExit with the exit codes of cli_common."""
    # OpenBLAS, which numpy brings, starts a thread for each core when it loads, and they spin: nearly half of
    # what importing numpy costs. Nothing here multiplies matrices that are worth a second thread.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Python ends with two searches for garbage among all that was imported. The memory goes back anyway.
    atexit.register(gc.freeze)
    arguments = with_rerun(sys.argv[1:])
    if arguments[:1] == ["merge"]:
        # What it imports is no garbage, and would be searched for it over and over; it does not run for long.
        gc.set_threshold(100_000)
    # The other commands are for --help, and for saying what there is where the name is wrong.
    asked = arguments[:1] if arguments and arguments[0] in COMMANDS else COMMANDS
    try:
        build_app(asked)(args=arguments)
    except Exception as error:
        sys.exit(report_error(error))
    except KeyboardInterrupt as error:
        sys.exit(report_error(error))
