"""`mapmeld demo`: merges the maps that come with the package and draws what it saw."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapmeld import cli_merge
from mapmeld.cli_common import reported


@reported
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for maps and pictures.")] = Path(
        "demo_out"
    ),
) -> None:
    """Merge the ten bundled maps, compare with their truth, write pictures, tell where."""
    from mapmeld.datasets import bundled
    from mapmeld.inspect_picture import render_inspection
    from mapmeld.map_features import features
    from mapmeld.map_io import read_map
    from mapmeld.metrics import evaluate_files
    from mapmeld.metrics_view import summary_lines
    from mapmeld.output import make_folder, replace_file

    case = bundled()
    paths = sorted(case.glob("*.yaml"))
    cli_merge.merge(paths, output=output / "merge")
    for line in summary_lines(evaluate_files(output / "merge" / "result.json", case / "truth.json")):
        print(line)
    make_folder(output / "inspect")
    for path in paths:
        grid = read_map(path)
        replace_file(output / "inspect" / f"{grid.name}.png", render_inspection(grid, features(grid)))
    print(f"\nThe maps that went in:   {case}")
    print(f"What each shows:         {output / 'inspect'} (classes, lines, corners)")
    print(f"Each map at its place:   {output / 'merge' / 'report.png'}")
    print(f"The merged map:          {output / 'merge' / 'merged.yaml'} and .pgm")
    print(f"Poses and evidence:      {output / 'merge' / 'result.json'}")
