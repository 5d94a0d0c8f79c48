"""What Save writes, and when it would not be what is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_yaml import one_line
from mapmeld.output import (
    OutputFolder,
    write_merged_maps,
    write_page,
    write_report,
    write_result,
    write_session,
)
from mapmeld.result import MergeResult
from mapmeld.session_file import Session
from mapmeld.studio.desk import Desk

_MOST_NAMES = 5


class Busy(MapmeldError):
    """Something else must end first."""


def saved_result(desk: Desk) -> MergeResult:
    """The result that a save of the desk writes. Raises Busy where it is not what is shown: something became
    known since the solve, or maps were moved."""
    if desk.result is None or desk.solved != desk.known:
        raise Busy("something has changed since the last solve; solve again, then save")
    moved = desk.moved
    if moved:
        more = f" and {len(moved) - _MOST_NAMES} more" if len(moved) > _MOST_NAMES else ""
        raise Busy(
            one_line(
                f"{', '.join(moved[:_MOST_NAMES])}{more}: moved since the last solve, which the files do not "
                "tell; pin what you moved and solve again, or undo, then save"
            )
        )
    return desk.result


def write(
    folder: Path,
    force: bool,
    result: MergeResult,
    grids: Sequence[OccupancyGrid],
    given: Mapping[str, Any],
    desk: Desk,
) -> list[str]:
    """Writes what `mapmeld merge --report` writes, and session.json, all or nothing; names of the files.
    given: the options, partial. Raises MapmeldError when the folder cannot be written to."""
    from mapmeld.report_page import page, story_of

    with OutputFolder(folder, force=force) as out:
        write_merged_maps(out.staged, result)
        write_report(out.staged, result, grids)
        write_page(out.staged, page(story_of(result, grids)))
        write_result(out.staged, result, out.folder)
        write_session(out.staged, Session.of(grids, given, desk.known))
        files = sorted(p.name for p in out.staged.iterdir())
        out.commit()
    return files
