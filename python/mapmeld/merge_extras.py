"""What `mapmeld merge` makes beside its output where it is asked to: the page, pictures, a recording."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mapmeld.errors import MapmeldError
from mapmeld.events import Listener
from mapmeld.grid import OccupancyGrid
from mapmeld.output import OutputFolder, write_page
from mapmeld.result import MergeResult

if TYPE_CHECKING:
    from mapmeld.recorder import Recorder


class Extras:
    """What is asked for.

    page: report.html in the output folder. figures: a folder for pictures. rerun: a file, or
    recording.VIEWER. Raises MapmeldError for what cannot be made, before there is work to lose.
    """

    def __init__(self, page: bool, figures: Path | None, rerun: str | None, output: Path | None) -> None:
        self._page, self._figures, self._rerun = page, figures, rerun
        self._recorder: Recorder | None = None
        self._drawn: list[tuple[str, bytes]] = []
        if page and output is None:
            raise MapmeldError("--report: goes into the output folder; give one with -o DIR")
        if figures is not None:
            from mapmeld.report_page.figures import check_folder

            check_folder(figures)
        if rerun is not None:
            from mapmeld.recording import check_target

            check_target(rerun)

    def listen(self, stack: contextlib.ExitStack, grids: Sequence[OccupancyGrid]) -> Listener | None:
        """The listener of the merge of these maps, None where nothing is recorded. Closed with the stack."""
        if self._rerun is None:
            return None
        from mapmeld.recording import recording

        self._recorder = stack.enter_context(recording(self._rerun, grids))
        return self._recorder.hear

    def draw(
        self,
        result: MergeResult,
        grids: Sequence[OccupancyGrid],
        seconds: Mapping[str, float],
        out: OutputFolder | None,
    ) -> bool:
        """Makes all of it from the result, the page among the staged files. seconds: of the stages after the
        merge. False when there was nothing to make."""
        if self._recorder is not None:
            self._recorder.finish(result)
        if not self._page and self._figures is None:
            return False
        from mapmeld.report_page import page, story_of

        story = story_of(dataclasses.replace(result, seconds={**result.seconds, **seconds}), grids)
        if self._page and out is not None:
            write_page(out.staged, page(story))
        if self._figures is not None:
            from mapmeld.report_page.figures import draw_figures

            self._drawn = draw_figures(story)
        return True

    def save(self) -> None:
        """Writes the pictures that were drawn."""
        if self._figures is not None:
            from mapmeld.report_page.figures import save_figures

            save_figures(self._figures, self._drawn)
