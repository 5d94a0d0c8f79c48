"""`mapmeld inspect`: what the merge sees in one map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mapmeld.cli_common import print_json, reported

if TYPE_CHECKING:
    from mapmeld.map_features import MapFeatures


@reported
def inspect(
    file: Annotated[
        Path, typer.Argument(metavar="MAP", help="Saved map: a yaml file of map_server.", show_default=False)
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Picture to write; FOLDER_NAME_inspect.png here if not given, none with --json.",
            show_default=False,
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="YAML file of options, as for merge.", show_default=False)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="STAGE.KEY=VALUE", help="One option; may be repeated.", show_default=False
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print counts, lines and corners as JSON.")] = False,
) -> None:
    """Show what the merge sees in a map: classes, oriented walls, lines, corners.

    Corners are drawn with their two arms and the opening angle on the side of free space.
    """
    from mapmeld.cli_options import gather_options
    from mapmeld.errors import MapmeldError
    from mapmeld.map_features import features
    from mapmeld.map_io import read_map
    from mapmeld.map_yaml import read_map_yaml

    options = gather_options(config, settings or [])
    if output is not None and output.suffix.lower() != ".png":
        raise MapmeldError(f"{output}: the picture is a PNG file; give it a name that ends in .png")
    grid = read_map(file)
    seen = features(grid, options)
    picture = output
    if picture is None and not json:
        # Maps of several robots may all be called map.yaml: robot1_map_inspect.png.
        folder = f"{file.parent.name}_" if file.parent.name not in ("", "..") else ""
        picture = Path(f"{folder}{grid.name}_inspect.png")
    if picture is not None and picture.resolve() == read_map_yaml(file).image.resolve():
        raise MapmeldError(f"{picture}: is the map's own image; choose another name for the picture")
    if picture is not None:
        from mapmeld.inspect_picture import render_inspection
        from mapmeld.output import replace_file

        replace_file(picture, render_inspection(grid, seen))
    if json:
        print_json(seen.to_dict())
    else:
        for line in _lines(seen):
            print(line)
        print(f"Wrote {picture}.")


def _lines(seen: MapFeatures) -> list[str]:
    height, width = seen.shape
    corners = seen.corners.opening
    inner = int((corners < math.pi).sum())
    return [
        f"{seen.name}: {width} x {height} cells of {seen.resolution:g} m "
        f"({seen.extent[0]:.2f} x {seen.extent[1]:.2f} m)",
        f"cells: {seen.free} free, {seen.occupied} occupied, {seen.unknown} unknown{_specks(seen)}",
        f"boundary points: {len(seen.boundary.position)}",
        f"lines: {len(seen.lines.start)}",
        f"corners: {len(corners)} ({inner} inner, {len(corners) - inner} outer)",
    ]


def _specks(seen: MapFeatures) -> str:
    if not seen.specks:
        return ""
    return f"; {seen.specks} of the unknown and occupied ones are specks, and taken for free floor"
