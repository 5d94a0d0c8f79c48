"""`mapmeld simulate`: a case of several maps with exact truth."""

from __future__ import annotations

import dataclasses
import enum
from pathlib import Path
from typing import Annotated, Any

import typer

from mapmeld.cli_common import reported


class _Image(str, enum.Enum):
    pgm = "pgm"
    png = "png"


@reported
def simulate(
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Folder for the maps and truth.json, new or empty.", show_default=False
        ),
    ],
    world: Annotated[
        str | None,
        typer.Option(
            help="maze, office, floor, cells, halls, wings, symmetric, concourse, warehouse, home, "
            "corridors, or a map's yaml file; maze.",
            show_default=False,
        ),
    ] = None,
    robots: Annotated[int | None, typer.Option(help="Number of robots, so of maps; 10.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the world and the robots; 0.")] = None,
    drift: Annotated[float | None, typer.Option(help="Odometry drift: 0 none, 1 light; 0.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Any field of mapmeld.simulate.SimulateOptions, its value as YAML; may be repeated.",
            show_default=False,
        ),
    ] = None,
    image: Annotated[_Image, typer.Option(help="Image format of the maps.")] = _Image.pgm,
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds other files; they stay.")
    ] = False,
) -> None:
    """Simulate robots that map a world, each in its own random frame, with the truth.

    The same options give the same files.
    """
    from mapmeld.config import parse_setting
    from mapmeld.errors import ConfigError
    from mapmeld.output import OutputFolder
    from mapmeld.simulate import SimulateOptions, write_case
    from mapmeld.simulate import simulate as run

    values: dict[str, Any] = {}
    for text in settings or []:
        values |= parse_setting(text)
    flags = {"world": world, "robots": robots, "seed": seed, "drift": drift}
    values |= {key: value for key, value in flags.items() if value is not None}
    try:
        options = SimulateOptions.from_dict(values)
    except ConfigError as error:
        known = ", ".join(field.name for field in dataclasses.fields(SimulateOptions))
        hint = f"; known are {known}" if "no such option" in str(error) else ""
        raise ConfigError(f"simulate: {error}{hint}") from None
    with OutputFolder(output, force=force) as out:
        case = run(options)
        write_case(case, out.staged, image_format=image.value)
        out.commit()
    print(f"Wrote {len(case.maps)} maps and truth.json to {output}.")
