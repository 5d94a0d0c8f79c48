"""Records a merge for the Rerun viewer, https://rerun.io, as an extra: it hears what the merge tells."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_yaml import one_line
from mapmeld.output import saying
from mapmeld.recorder import Recorder, blueprint

VIEWER = "viewer"
"""In the place of a file: opens the viewer."""
_INSTALL = "pip install 'rerun-sdk>=0.41,<0.42'"
_PORT, _PATIENCE_S = 9876, 5.0
"""Where the viewer listens, and how long it is waited for."""


@contextlib.contextmanager
def recording(target: str | Path, grids: Sequence[OccupancyGrid]) -> Iterator[Recorder]:
    """A recorder into a file, or for VIEWER into a viewer that it opens.

    grids: the maps that are going to be merged, in order. The file is there when all of it is recorded, or
    not at all. Raises MapmeldError if the library is not installed, or the file or viewer cannot be opened.
    """
    rerun = load_rerun()
    stream = rerun.RecordingStream("mapmeld")
    if target == VIEWER:
        _open_viewer(rerun, stream)
        stream.connect_grpc(default_blueprint=blueprint())
        yield Recorder(rerun, stream, grids)
        stream.flush(timeout_sec=_PATIENCE_S)
        return
    path = Path(target)
    draft = path.with_name(f".mapmeld-{os.urandom(8).hex()}.rrd")
    try:
        with saying(path):
            draft.touch()
        stream.save(draft, default_blueprint=blueprint())
        yield Recorder(rerun, stream, grids)
        stream.flush()
        stream.disconnect()
        with saying(path):
            os.replace(draft, path)
    finally:
        stream.disconnect()
        draft.unlink(missing_ok=True)


def _open_viewer(rerun: Any, stream: Any) -> None:
    """Starts the viewer, or finds it running; raises MapmeldError when it does not listen after a while."""
    # Beside this interpreter, which need not be in the search path.
    program = Path(sys.executable).with_name("rerun")
    problem = "it does not listen; is there a screen?"
    try:
        path = str(program) if program.is_file() else None
        rerun.spawn(connect=False, executable_path=path, recording=stream)
        with socket.create_connection(("127.0.0.1", _PORT), timeout=_PATIENCE_S):
            return
    except RuntimeError as error:
        problem = str(error).partition("\n")[0]
    except OSError:
        pass
    raise MapmeldError(
        one_line(f"--rerun: the viewer does not open: {problem} A recording can be written: --rerun FILE.rrd")
    )


def check_target(target: str) -> None:
    """Raises MapmeldError for a recording that cannot be made, before there is work to lose."""
    load_rerun()
    path = Path(target)
    if target == VIEWER:
        return
    if path.suffix != ".rrd":
        raise MapmeldError(one_line(f"--rerun {target}: the file must end in .rrd; choose another name"))
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise MapmeldError(
            one_line(f"--rerun {target}: is no file in a folder that is there; choose another")
        )


def load_rerun() -> Any:
    """The library; raises MapmeldError that tells how to get it."""
    try:
        import rerun
    except ImportError as error:
        raise MapmeldError(
            f"--rerun: needs the library rerun-sdk, which is not installed; {_INSTALL}"
        ) from error
    if not hasattr(rerun, "GridMap"):
        raise MapmeldError(f"--rerun: rerun-sdk {rerun.__version__} is too old; {_INSTALL}")
    return rerun
