"""session.json: what was known when maps were merged, so that the same merge can be made again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mapmeld import json_fields
from mapmeld.config import effective_config
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.known import Known
from mapmeld.map_yaml import one_line

_FORMAT = 1


@dataclass(frozen=True)
class Session:
    """maps: digests of the maps that it is about, by name. config: options, partial. known: of these maps."""

    maps: Mapping[str, str]
    config: Mapping[str, Any] = field(default_factory=dict)
    known: Known = field(default_factory=Known)

    @staticmethod
    def of(grids: Sequence[OccupancyGrid], config: Mapping[str, Any], known: Known) -> Session:
        """The session of a merge of these maps with these options."""
        return Session({g.name: digest(g) for g in grids}, config, known)

    def to_json(self) -> str:
        """The text of the file. Threads are left out, since the result does not depend on them."""
        content = {
            "session": _FORMAT,
            "maps": [{"name": name, "digest": text} for name, text in self.maps.items()],
            "config": {key: value for key, value in self.config.items() if key != "threads"},
            "known": self.known.to_dict(),
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"

    def check(self, grids: Sequence[OccupancyGrid], path: str | Path) -> None:
        """Raises MapmeldError, naming `path` and the map, when these are not the maps that it is about."""
        given = {g.name: g for g in grids}
        missing = [n for n in self.maps if n not in given]
        more = [n for n in given if n not in self.maps]
        changed = [n for n, text in self.maps.items() if n in given and digest(given[n]) != text]
        problems = [
            f"{what}: {', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"
            for what, names in (
                ("it knows maps that are not given", missing),
                ("maps are given that it does not know", more),
                ("maps have changed since", changed),
            )
            if names
        ]
        if problems:
            raise MapmeldError(
                one_line(
                    f"{path}: does not fit these maps: {'; '.join(problems)}; give the maps that it "
                    "was saved with, or begin without it"
                )
            )


def read_session(path: str | Path) -> Session:
    """Reads a session.json. Raises MapmeldError, naming the file and the field."""
    content = json_fields.read_object(path)
    where = str(path)
    if content.get("session") != _FORMAT:
        raise MapmeldError(f"{where}: is no session of this version of mapmeld ('session' must be {_FORMAT})")
    maps = {}
    for i, item in enumerate(json_fields.objects(content, "maps", where)):
        at = f"{where}: maps[{i}]"
        maps[json_fields.string(item, "name", at)] = json_fields.string(item, "digest", at)
    config, known = (json_fields.required(content, key, where) for key in ("config", "known"))
    if not isinstance(config, dict) or not isinstance(known, dict):
        raise MapmeldError(f"{where}: 'config' and 'known' must be objects")
    effective_config(config, f"{where}: config")
    told = Known.from_dict(known, f"{where}: known")
    told.check_names(list(maps), f"{where}: known")
    return Session(maps, config, told)


def digest(grid: OccupancyGrid) -> str:
    """Tells maps apart by what they show: cells, resolution, origin."""
    numbers = np.array([grid.resolution, *grid.origin], dtype="<f8").tobytes()
    shape = np.array(grid.data.shape, dtype="<i8").tobytes()
    return hashlib.sha256(shape + numbers + grid.data.tobytes()).hexdigest()[:32]
