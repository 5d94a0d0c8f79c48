"""Registered pairs that outlive a merge: a folder that several processes may use at once."""

from __future__ import annotations

import time
from pathlib import Path

from mapmeld import _core
from mapmeld.errors import MapmeldError

_TAG = (
    "Signature: 8a477f597d28d172789f06886806bc55\n# This folder is a cache of mapmeld; it may be deleted.\n"
)


_STALE = 3600.0
"""Age of a file, in seconds, after which nobody is still writing it."""


class PairStore:
    """Registered pairs by what their maps show, on disk or, without a folder, in memory.

    A pair is found again when its two maps show the same, whatever they are called, the options of the stages
    before the filter are the same, and so is the code. A damaged file is registered anew and replaced.

    Raises MapmeldError for a folder that cannot be made.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = None if folder is None else Path(folder)
        if self.folder is None:
            self._store = _core.Store()
            return
        if self.folder.exists() and not self.folder.is_dir():
            raise MapmeldError(f"cache {self.folder}: is a file; give a folder")
        try:
            self._store = _core.Store(self.folder)
            for left in self.folder.glob("*/.*.tmp"):
                # Of a process that ended while it wrote; younger ones may be under way.
                if time.time() - left.stat().st_mtime > _STALE:
                    left.unlink(missing_ok=True)
            tag = self.folder / "CACHEDIR.TAG"
            if not tag.exists():
                tag.write_text(_TAG, encoding="ascii")
        except OSError as e:
            raise MapmeldError(f"cache {self.folder}: cannot be made or written ({e.strerror or e})") from e

    @property
    def core(self) -> _core.Store:
        """What the core takes."""
        return self._store

    def put(self, key: str, pair: bytes) -> None:
        """Keeps a pair that was registered elsewhere."""
        self._store.put(key, pair)

    def has(self, key: str) -> bool:
        """Whether a pair is kept, and whole."""
        return self._store.has(key)

    def warnings(self) -> list[str]:
        """What went wrong on disk so far; each was made up for by registering pairs anew."""
        unreadable, unwritable = self._store.failures()
        found = []
        if unreadable:
            found.append(f"cache {self.folder}: {_pairs(unreadable)} damaged or unreadable, registered anew")
        if unwritable:
            found.append(f"cache {self.folder}: {_pairs(unwritable)} could not be written; is there space?")
        return found


def _pairs(count: int) -> str:
    return "1 pair" if count == 1 else f"{count} pairs"
