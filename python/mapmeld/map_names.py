"""What saved maps are called: names tell maps apart."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mapmeld.errors import MapmeldError


def saved_names(paths: Sequence[Path]) -> dict[Path, str]:
    """The names of saved maps: like their files without suffix; where several files are called alike
    (robot1/map.yaml, robot2/map.yaml), with as many of the folders before it as tell them apart (robot1/map).

    Raises MapmeldError for a path that is given twice, and for two that only their suffixes tell apart.
    """
    by_file: dict[str, Path] = {}
    for path in paths:
        # Not Path.resolve, which raises for links that lead in circles.
        real = os.path.realpath(path)
        if real in by_file:
            raise MapmeldError(f"{path}: is given twice (as {by_file[real]}); give every map once")
        by_file[real] = path
    parts = {path: _parts(path) for path in paths}
    depth = dict.fromkeys(paths, 1)
    while True:
        names = {path: "/".join(parts[path][-depth[path] :]) for path in paths}
        times = Counter(names.values())
        alike = [path for path in paths if times[names[path]] > 1 and depth[path] < len(parts[path])]
        if not alike:
            break
        for path in alike:
            depth[path] += 1
    by_name: dict[str, Path] = {}
    for path, name in names.items():
        other = by_name.setdefault(name, path)
        if other is not path:
            raise MapmeldError(f"{path}: is called like {other} but for the suffix; rename one")
    return names


def name_among(path: Path, names: Sequence[str]) -> str | None:
    """The one of the names that a saved map was merged under: its own, with or without its folders."""
    parts = _parts(path)
    longest_first = ("/".join(parts[k:]) for k in range(len(parts)))
    return next((name for name in longest_first if name in names), None)


def _parts(path: Path) -> list[str]:
    """Folders and name of a file, its suffix left out."""
    # Not resolved: a link is called like itself.
    file = Path(os.path.abspath(path))
    return [*file.parent.parts[1:], file.stem]
