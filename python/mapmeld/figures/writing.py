"""Writes the figures into a folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mapmeld.errors import MapmeldError
from mapmeld.figures import drawing, merges, motion, poses, update
from mapmeld.figures.study import study as make_study
from mapmeld.grid import OccupancyGrid
from mapmeld.map_yaml import one_line
from mapmeld.output import replace_file

KINDS = ("png", "svg")


def write_figures(
    folder: str | os.PathLike[str],
    *,
    maps: Sequence[OccupancyGrid] | None = None,
    seed: int = 1,
) -> list[Path]:
    """Draws the paper's figures 1 to 4 from our own runs, each as PNG and SVG; answers the files.

    folder: made when it is not there; files of the same name in it are replaced. maps: None for the ten that
    come with the package; others must overlap, and figure 2 is left out when no particle doubts
    where a map goes. seed: of the merges and samples; the same seed and maps give the same files.

    All is computed and drawn before anything is written. Raises MapmeldError for maps that do not overlap,
    and a folder that cannot be written to.
    """
    target = Path(folder)
    _refuse_early(target)
    pictures = [
        (target / f"{name}.{kind}", drawing.render(figure, kind))
        for name, figure in _figures(maps, seed)
        for kind in KINDS
    ]
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise MapmeldError(one_line(f"{target}: cannot be made: {reason}; choose another folder")) from error
    for path, content in pictures:
        replace_file(path, content)
    return [path for path, _ in pictures]


def _figures(maps: Sequence[OccupancyGrid] | None, seed: int) -> list[tuple[str, Any]]:
    study = make_study(maps, seed)
    candidates = poses.compute_poses(study)
    shown = candidates.shown
    updated = update.compute_update(study)
    figures = [("fig1_motion", motion.draw_motion(study, motion.compute_motion(study, shown.a, shown.b)))]
    if updated is not None:
        figures.append(("fig2_update", update.draw_update(study, updated)))
    figures.append(("fig3_poses", poses.draw_poses(study, candidates)))
    figures.append(("fig4_merges", merges.draw_merges(study, merges.compute_merges(study))))
    return figures


def _refuse_early(target: Path) -> None:
    """Finds out whether the folder can be written to before there is work to lose."""
    place = target.absolute()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        raise MapmeldError(one_line(f"{target}: {place} is no folder; choose another one"))
    if not os.access(place, os.W_OK | os.X_OK):
        raise MapmeldError(one_line(f"{target}: cannot be written: {place} is closed; choose another folder"))
