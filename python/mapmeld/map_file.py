"""Where a map was read from, and how result.json names the place."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class MapFile:
    """The file that a map was read from.

    path: of the yaml, or of a bag. topic, nanoseconds: of the map's message in a bag and when it was
        recorded; None for a saved map.
    """

    path: Path
    topic: str | None = None
    nanoseconds: int | None = None

    def to_dict(self, folder: Path) -> dict[str, Any]:
        """As in result.json: the path as seen from `folder`, so that both can be moved together."""
        path = self.path.parent.resolve() / self.path.name
        try:
            shown = Path(os.path.relpath(path, folder.resolve()))
        except ValueError:  # another drive of Windows, to which no relative path leads
            shown = path
        return {"path": shown.as_posix(), "topic": self.topic, "nanoseconds": self.nanoseconds}
