"""Folders of saved maps, as a command is given them in the place of their files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mapmeld.bag import is_bag
from mapmeld.errors import MapFileError
from mapmeld.map_yaml import YAML_SUFFIXES, is_saved_map, one_line
from mapmeld.output import earlier_output


def with_folders_opened(paths: Sequence[Path], notes: list[str] | None = None) -> list[Path]:
    """The paths, and in the place of a folder that is no bag the saved maps in it, ordered by their names.

    Passed over, and told of in the notes, are yaml files of other things and what an earlier merge wrote;
    hidden files, and links to maps of the same folder, without a word. Raises MapFileError for a folder
    without maps, one that holds both maps and bags, and one that cannot be read.
    """
    found: list[Path] = []
    for path in paths:
        try:
            found += _opened(path, [] if notes is None else notes)
        except OSError as error:
            raise MapFileError(
                one_line(f"{path}: cannot be read: {error.strerror or error}; check who may read it")
            ) from error
    return found


def _opened(path: Path, notes: list[str]) -> list[Path]:
    if not path.is_dir():
        return [path]
    inside = sorted(f for f in path.iterdir() if not f.name.startswith(".") and not f.is_dir())
    passed_over: list[str] = []
    maps = _maps(path, inside, passed_over)
    bags = [path] if is_bag(path) else [f for f in inside if is_bag(f)]
    if maps and bags:
        raise MapFileError(
            one_line(f"{path}: holds saved maps and a bag; give those of its files that are to merge")
        )
    if bags:
        return bags
    notes += passed_over
    if not maps:
        deeper = sorted({f.parent.name for f in path.glob("*/*") if f.suffix.lower() in YAML_SUFFIXES})
        hint = (
            f"give {path}/*/, as {', '.join(deeper[:3])} in it may hold some"
            if deeper
            else "give another one"
        )
        raise MapFileError(
            one_line(
                f"{path}: is a folder without saved maps (yaml files that name an image), and no bag; {hint}"
            )
        )
    return maps


def _maps(folder: Path, inside: Sequence[Path], notes: list[str]) -> list[Path]:
    earlier = earlier_output(folder)
    home = os.path.realpath(folder)
    maps: dict[str, Path] = {}
    for file in inside:
        if file.suffix.lower() not in YAML_SUFFIXES:
            continue
        # Not Path.resolve, which raises for links that lead in circles.
        real = os.path.realpath(file)
        if os.path.dirname(real) == home and os.path.basename(real) in earlier:
            notes.append(f"{file}: an earlier merge wrote it; it is passed over")
        elif not is_saved_map(file):
            notes.append(f"{file}: is no saved map; it is passed over")
        elif real not in maps or (maps[real].is_symlink() and not file.is_symlink()):
            # The file itself before a link to it.
            maps[real] = file
    return sorted(maps.values())
