"""The output folder of a merge or replay: written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from mapmeld.errors import MapFileError, MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.map_io import write_map
from mapmeld.map_yaml import one_line, read_map_yaml
from mapmeld.result import MergeResult

if TYPE_CHECKING:
    from mapmeld.session_file import Session

RESULT, REPORT, PAGE, SESSION = "result.json", "report.png", "report.html", "session.json"
ESTIMATES, DEVELOPMENT = "estimates.jsonl", "development.png"
"""What a replay writes beside these."""

_OURS = {RESULT, REPORT, PAGE, SESSION, ESTIMATES, DEVELOPMENT}
_STAGING = ".mapmeld-"
_MERGED = re.compile(r"merged(_[0-9]+)?\.(yaml|pgm)")
# What every result.json has. A folder whose result.json has it was written by a merge.
_RESULT_KEYS = {"maps", "order", "components", "hypotheses", "pairs", "seconds", "config", "version", "seed"}


def write_output(
    folder: str | os.PathLike[str], result: MergeResult, maps: Sequence[OccupancyGrid], *, force: bool = False
) -> None:
    """Writes merged.yaml and .pgm (merged_2, ... for further components), result.json and report.png.

    maps: those that were merged, for the report. Either all files are there afterwards or the folder is as
    it was. The folder may be new, empty, or hold the output of an earlier merge or replay, which is replaced;
    other files in it are an error unless `force`, which writes beside them. Raises MapmeldError for these,
    and when something cannot be written.
    """
    with OutputFolder(folder, force=force) as out:
        write_merged_maps(out.staged, result)
        write_report(out.staged, result, maps)
        write_result(out.staged, result, out.folder)
        out.commit()


def write_merged_maps(folder: Path, result: MergeResult) -> None:
    """Writes every merged map of the result as <name>.yaml and .pgm, trinary."""
    for grid in result.merged_maps:
        write_map(folder / f"{grid.name}.yaml", grid)


def write_report(folder: Path, result: MergeResult, maps: Sequence[OccupancyGrid]) -> None:
    """Draws report.png."""
    from mapmeld.report import draw_report

    with saying(folder / REPORT):
        draw_report(folder / REPORT, result, maps)


def write_page(folder: Path, html: str) -> None:
    """Writes report.html."""
    with saying(folder / PAGE):
        (folder / PAGE).write_text(html, encoding="utf-8")


def write_result(folder: Path, result: MergeResult, home: Path) -> None:
    """Writes result.json. home: the folder that it will lie in, from which it names the maps' files."""
    with saying(folder / RESULT):
        (folder / RESULT).write_text(result.to_json(home), encoding="ascii")


def write_session(folder: Path, session: Session) -> None:
    """Writes session.json."""
    with saying(folder / SESSION):
        (folder / SESSION).write_text(session.to_json(), encoding="ascii")


def replace_file(path: Path, content: bytes) -> None:
    """Writes a file in one step: whoever reads meanwhile finds the old content or the new one."""
    draft = path.with_name(f"{_STAGING}{os.urandom(8).hex()}")
    with saying(path):
        if path.is_dir():
            raise IsADirectoryError(None, "is a folder")
        try:
            draft.write_bytes(content)
            os.replace(draft, path)
        finally:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Makes a folder and those above it, where they are not there."""
    with saying(path):
        path.mkdir(parents=True, exist_ok=True)


def earlier_output(folder: Path) -> set[str]:
    """Names of the files in a folder that an earlier merge wrote: those that its result.json speaks for."""
    try:
        result = json.loads((folder / RESULT).read_bytes())
        if not isinstance(result, dict) or not result.keys() >= _RESULT_KEYS:
            return set()
        merged = [str(c["merged"]) for c in result["components"] if c["merged"] is not None]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return set()
    names = set(_OURS)
    for name in merged:
        names |= {name, f"{name.removesuffix('.yaml')}.pgm"}
    # The file may have been edited: no name but ours counts, least of all one that leads elsewhere.
    return {n for n in names if n in _OURS or _MERGED.fullmatch(n)}


class OutputFolder:
    """A folder that gets its files all at once: they are written to `staged`, then moved by `commit`.

    As a context manager: what was not committed at the end leaves no trace. Entering finds out whether the
    folder can be written to, before there is work to lose.

    inputs: yaml files that are being read, which must not be replaced. The rest is as in write_output.
    """

    def __init__(
        self, folder: str | os.PathLike[str], *, force: bool = False, inputs: Iterable[Path] = ()
    ) -> None:
        self.folder = Path(folder)
        self._force = force
        self._inputs = list(inputs)

    def __enter__(self) -> OutputFolder:
        with saying(self.folder):
            self._exists = self.folder.is_dir()
            if not self._exists and os.path.lexists(self.folder):
                raise MapmeldError(f"{self.folder}: is there and no folder; choose another name")
            if self._exists:
                self._refuse_inputs()
                self._refuse_foreign(earlier_output(self.folder))
            # Within a folder that is there, since its parent may be closed to us or another file system.
            base = self.folder if self._exists else _existing_parent(self.folder)
            self._work = base / f"{_STAGING}{os.urandom(8).hex()}"
            self._work.mkdir()
            self.staged = self._work / "new"
            self.staged.mkdir()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        shutil.rmtree(self._work, ignore_errors=True)

    def commit(self) -> None:
        """Moves the staged files to their place; raises MapmeldError, and undoes it, when that fails."""
        with saying(self.folder):
            if self._exists:
                self._exchange()
            else:
                self.folder.parent.mkdir(parents=True, exist_ok=True)
                os.rename(self.staged, self.folder)

    def _exchange(self) -> None:
        earlier = earlier_output(self.folder)
        self._refuse_foreign(earlier)
        new = os.listdir(self.staged)
        leaving = [name for name in {*earlier, *new} if os.path.lexists(self.folder / name)]
        for name in leaving:
            if (self.folder / name).is_dir():
                raise MapmeldError(f"{self.folder / name}: is a folder; choose another output folder")
        kept = self._work / "old"
        kept.mkdir()
        # result.json goes first and comes last: where it is, the files that it names are.
        moves = [(self.folder / n, kept / n) for n in sorted(leaving, key=lambda n: (n != RESULT, n))]
        moves += [(self.staged / n, self.folder / n) for n in sorted(new, key=lambda n: (n == RESULT, n))]
        done: list[tuple[Path, Path]] = []
        try:
            for source, target in moves:
                os.rename(source, target)
                done.append((source, target))
        except BaseException:
            for source, target in reversed(done):
                with contextlib.suppress(OSError):
                    os.rename(target, source)
            raise

    def _refuse_foreign(self, earlier: set[str]) -> None:
        if self._force:
            return
        foreign = sorted(
            entry.name
            for entry in os.scandir(self.folder)
            if not entry.name.startswith(_STAGING)
            and not (entry.name in earlier and entry.is_file(follow_symlinks=False))
        )
        if foreign:
            some = ", ".join(foreign[:3]) + (f" and {len(foreign) - 3} more" if len(foreign) > 3 else "")
            raise MapmeldError(
                one_line(
                    f"{self.folder}: holds files that no earlier merge wrote ({some}); choose a new folder, "
                    "or --force to write beside them"
                )
            )

    def _refuse_inputs(self) -> None:
        here = self.folder.resolve()
        for path in self._inputs:
            for file in (path, read_map_yaml(path).image):
                ours = file.name in _OURS or _MERGED.fullmatch(file.name)
                if ours and file.resolve().parent == here:
                    raise MapmeldError(
                        one_line(f"{file}: is an input, and an output has its name; choose another folder")
                    )


def _existing_parent(folder: Path) -> Path:
    for parent in folder.absolute().parents:
        if os.path.lexists(parent):
            return parent
    return Path("/")


@contextlib.contextmanager
def saying(path: Path) -> Iterator[None]:
    """Turns what the operating system says into one line about `path`."""
    try:
        yield
    except (OSError, MapFileError) as error:
        if isinstance(error, MapFileError):
            raise
        reason = error.strerror or str(error)
        raise MapmeldError(
            one_line(f"{path}: cannot be written: {reason}; choose a place that can be written to")
        ) from error
