"""Gathers a merge's options from the command line; errors name the place that an option came from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any


def gather_options(
    config: Path | None, settings: Sequence[str], flags: Sequence[tuple[str, dict[str, Any]]] = ()
) -> dict[str, Any]:
    """The options given, partial: of the file, over them --set in turn, over these the flags.

    flags: (name of the flag, its options). Raises ConfigError, naming file or flag and the key.
    """
    from mapmeld.config import effective_config, load_config, overlay, parse_setting

    options: dict[str, Any] = {} if config is None else load_config(config)
    given = [(f"--set {text}", parse_setting(text)) for text in settings]
    for source, setting in [*given, *flags]:
        effective_config(setting, source)
        options = overlay(options, setting)
    return options


def with_rerun(arguments: Sequence[str]) -> list[str]:
    """The arguments with `--rerun` alone written as --rerun=viewer: typer knows no option whose value may be
    left out. What ends in .rrd after it is its file, all else is not."""
    out: list[str] = []
    for k, argument in enumerate(arguments):
        following = "".join(arguments[k + 1 : k + 2])
        is_alone = argument == "--rerun" and not following.endswith(".rrd")
        out.append("--rerun=viewer" if is_alone else argument)
    return out
