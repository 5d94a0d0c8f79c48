"""`mapmeld figures`: the paper's figures 1 to 4, from our own runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapmeld.cli_common import reported


@reported
def figures(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the pictures.")] = Path("figs"),
    seed: Annotated[int, typer.Option("--seed", help="Seed of every random draw.")] = 1,
) -> None:
    """Draw the paper's figures 1 to 4 from runs on the bundled maps (PNG and SVG)."""
    from mapmeld.figures import write_figures

    for path in write_figures(output, seed=seed):
        print(path)
