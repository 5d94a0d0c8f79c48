"""`mapmeld studio`: a local web page where a person steers the merge."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from mapmeld import cli_known
from mapmeld.cli_common import reported


@reported
def studio(
    maps: Annotated[
        list[Path],
        typer.Argument(
            help="Saved maps (yaml files of map_server, or folders of them) and ROS bags (a folder, .mcap, "
            ".db3 or .bag).",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Folder that Save writes to, as `mapmeld merge -o` does."),
    ] = Path("studio_out"),
    session: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help=cli_known.SESSION_HELP, show_default=False),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0 takes a free one.")] = 0,
    browser: Annotated[
        bool,
        typer.Option("--browser/--no-browser", help="Open the page in the browser, where there is a screen."),
    ] = True,
    config: Annotated[
        Path | None, typer.Option(help="YAML file of options, nested by stage.", show_default=False)
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="STAGE.KEY=VALUE",
            help="One option, stronger than --config; may be repeated.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Save into a folder that holds other files; they stay.")
    ] = False,
) -> None:
    """Look at a merge in the browser and put it right: drag, click corners, snap, pin, forbid, solve, save.

    The page is served on this machine alone, at an address with a random token. Ctrl-C ends it.
    """
    from mapmeld.bag import is_bag
    from mapmeld.cli_options import gather_options
    from mapmeld.config import overlay
    from mapmeld.errors import MapmeldError
    from mapmeld.known import Known
    from mapmeld.map_folder import with_folders_opened
    from mapmeld.map_inputs import check_paths, read_inputs
    from mapmeld.output import OutputFolder

    try:
        from mapmeld.studio.serving import bound, serve
    except ImportError as error:
        raise MapmeldError(
            f"studio: needs {error.name or 'starlette and uvicorn'}, which is not installed; "
            "pip install starlette uvicorn"
        ) from None
    from mapmeld.studio.workbench import Workbench

    maps = with_folders_opened(maps)
    check_paths(maps)
    saved = cli_known.read_session_option(session)
    options = overlay({} if saved is None else saved.config, gather_options(config, settings or []))
    # What stands in the way of saving is better known before there is work to lose.
    with OutputFolder(output, force=force, inputs=[p for p in maps if not is_bag(p)]):
        pass
    place = bound(port)
    try:
        inputs = read_inputs(maps)
        for line in inputs.warnings:
            print(f"mapmeld: warning: {line}", file=sys.stderr)
        if saved is not None and session is not None:
            saved.check(inputs.grids, session)
        known = Known() if saved is None else saved.known
        files = {g.name: f for g, f in zip(inputs.grids, inputs.files, strict=True)}
        bench = Workbench(inputs.grids, options, known, output, force=force, files=files)
    except BaseException:
        place.close()
        raise

    with contextlib.ExitStack() as stack:

        def ready(address: str) -> None:
            print(f"The workbench is at\n\n    {address}\n\nCtrl-C ends it.", flush=True)
            if browser and _has_screen():
                _open(stack.enter_context(tempfile.TemporaryDirectory()), address)

        serve(bench, place, ready)


def _open(folder: str, address: str) -> None:
    """Opens the browser by way of a file that nobody else can read: other users of the machine see what a
    program was called with, and the token is part of the address."""
    import webbrowser

    way = Path(folder) / "studio.html"
    link = f'<a href="{address}">Mapmeld studio</a>'
    way.write_text(f'<meta http-equiv="refresh" content="0; url={address}">{link}')
    webbrowser.open(way.as_uri())


def _has_screen() -> bool:
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
