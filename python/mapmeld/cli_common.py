"""What the commands share: exit codes, error lines, consoles."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import typer

if TYPE_CHECKING:
    from rich.console import Console

DONE, INTERNAL_ERROR, BAD_INPUT, NOT_MET, INTERRUPTED = 0, 1, 2, 3, 130

EXIT_CODES = (
    "Exit codes: 0 done (also when maps stay apart), 2 bad input or usage, 3 what --strict asks is not so, "
    "130 interrupted, "
    "1 internal error (a bug; MAPMELD_TRACEBACK=1 shows where)."
)

P = ParamSpec("P")
R = TypeVar("R")


def file_of(path: Path, name: str) -> Path:
    """A file, or the one of that name in a folder."""
    return path / name if path.is_dir() else path


def reported(command: Callable[P, R]) -> Callable[P, R]:
    """A command that ends in one line on stderr and an exit code where the function raises."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except (typer.Exit, typer.Abort):
            raise
        except BaseException as error:
            code = report_error(error)
            raise typer.Exit(code) from None

    return run


def report_error(error: BaseException) -> int:
    """Says on stderr what is wrong, in one line; answers the exit code. Usage errors are raised again."""
    from mapmeld.errors import MapmeldError

    if isinstance(error, KeyboardInterrupt):
        complain("interrupted; nothing was written")
        return INTERRUPTED
    if isinstance(error, MapmeldError):
        complain(str(error))
        return BAD_INPUT
    if isinstance(error, BrokenPipeError):
        # Whoever read our output has enough. Python would complain again when it closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    if not isinstance(error, Exception) or type(error).__module__.partition(".")[0] in ("click", "typer"):
        raise error
    if isinstance(error, MemoryError):
        complain("out of memory; merge fewer maps at once, or coarser ones")
        return BAD_INPUT
    if os.environ.get("MAPMELD_TRACEBACK"):
        raise error
    complain(
        f"internal error: {type(error).__name__}: {error}; MAPMELD_TRACEBACK=1 shows where; please report it"
    )
    return INTERNAL_ERROR


def complain(text: str) -> None:
    """One line on stderr."""
    line = " ".join(text.split())
    print(f"mapmeld: {line}", file=sys.stderr)


def print_json(value: Any) -> None:
    """JSON on stdout."""
    import json

    print(json.dumps(value, indent=1, allow_nan=False))


def stdout_console() -> Console:
    """Where tables go. Lines in a pipe or file are never cut."""
    from rich.console import Console

    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=200)
