"""Writes what the node knows to a folder, as `mapmeld merge` writes its output."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from mapmeld import OccupancyGrid, write_map
from mapmeld.output import RESULT, OutputFolder
from mapmeld_ros.robots import Robot
from mapmeld_ros.session import Known, Refused


def save(
    folder: str, force: bool, known: Known, merged: Mapping[str, OccupancyGrid], robots: tuple[Robot, ...]
) -> list[str]:
    """Writes merged.yaml and .pgm (merged_2, ... for further components) and result.json: all files or none.

    merged: the merged maps by the frames of their components. Returns the files' paths. Raises Refused when
    there is nothing to write, and MapmeldError when it cannot be written.
    """
    if not folder.strip():
        raise Refused("folder: is empty; name a folder on the node's machine")
    if known.estimate.result is None or not merged:
        raise Refused("there is no merged map yet; wait for the first one")
    with OutputFolder(folder, force=force) as out:
        files = {}
        for named in sorted(known.names, key=lambda n: n.number):
            if named.frame in merged:
                name = "merged" if named.number == 1 else f"merged_{named.number}"
                write_map(out.staged / f"{name}.yaml", merged[named.frame])
                files[named.frame] = f"{name}.yaml"
        content = json.dumps(result_content(known, files, robots), indent=1, allow_nan=False)
        (out.staged / RESULT).write_text(content + "\n", encoding="ascii")
        written = sorted(path.name for path in out.staged.iterdir())
        out.commit()
        return [str(out.folder / name) for name in written]


def result_content(known: Known, files: Mapping[str, str], robots: tuple[Robot, ...]) -> dict[str, Any]:
    """The keys of result.json: the evidence as the merge itself says it, places as they are held.

    files: the map file of a component's frame. `frame` and `topic` are added to what docs/result.md
        describes.
    """
    estimate = known.estimate
    assert estimate.result is not None
    content = estimate.result.to_dict()
    by_name = {r.name: r for r in robots}
    content["maps"] = [
        {
            "name": r.name,
            "component": r.component,
            "T_component_map": None if r.T_world_map is None else r.T_world_map.tolist(),
            "covariance": None if r.covariance is None else r.covariance.tolist(),
            "status": r.status,
            "probability": float(r.probability),
            "reason": r.reason,
            "frame": by_name[r.name].frame if r.name in by_name else None,
        }
        for r in estimate.robots
    ]
    content["components"] = [
        {
            "reference": c.anchor,
            "order": list(c.names),
            "rms_m": None,
            "merged": files.get(named.frame),
            "shared_cells": None,
            "conflict_cells": None,
            "frame": named.frame,
            "is_world": c.is_world,
        }
        for c, named in zip(estimate.components, known.names, strict=True)
    ]
    content["order"] = list(estimate.components[0].names) if estimate.components else []
    return content
