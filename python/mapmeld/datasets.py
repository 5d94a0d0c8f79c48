"""The cases that come with the package: small folders of maps with their truth, ready to be merged.

Each is a case folder (NN_name.yaml and image, truth.json); the `options` in its truth.json are the
SimulateOptions that made it.
"""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from mapmeld.errors import MapmeldError


def names() -> list[str]:
    """The names of the bundled cases, sorted."""
    folder = files("mapmeld").joinpath("data")
    if not folder.is_dir():
        return []
    return sorted(entry.name for entry in folder.iterdir() if entry.joinpath("truth.json").is_file())


def bundled(name: str = "maze10") -> Path:
    """The folder of a bundled case. Treat it as read-only.

    Raises MapmeldError for a name that is none, and for a package that does not lie in a folder (one that is
    imported from a zip archive).
    """
    known = names()
    if name not in known:
        raise MapmeldError(f"no bundled case {name!r}; there are: {', '.join(known) or 'none'}")
    entry = files("mapmeld").joinpath("data", name)
    with as_file(entry) as path:
        folder = Path(path)
    if not folder.is_dir():
        raise MapmeldError(f"bundled case {name!r}: the package lies in an archive; install it unpacked")
    return folder
