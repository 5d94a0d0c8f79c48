"""A solve: the merge of what is on the bench with what is known, in a session that keeps pairs."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from typing import Any

from mapmeld import _core
from mapmeld.known import Known, told
from mapmeld.map_file import MapFile
from mapmeld.merging import Progress, result_of
from mapmeld.result import MergeResult


def solved(
    session: _core.Session,
    known: Known,
    progress: Progress,
    centres: Mapping[str, tuple[float, float]],
    config: dict[str, Any],
    files: Mapping[str, MapFile],
) -> MergeResult:
    """The result, as `merge` would tell it. What `progress` raises ends it. centres: of the
    known cells of each map, map coordinates. files: where maps are from."""
    started = time.perf_counter()
    found = session.merge([], known.core_priors(), progress, known.relations(), known.forbidden)
    seconds = {**found["seconds"], "merge": time.perf_counter() - started}
    result = told(result_of(found, session.names(), config, seconds, centres), known)
    maps = (dataclasses.replace(m, file=files.get(m.name)) for m in result.maps)
    return dataclasses.replace(result, maps=tuple(maps))
