"""Writes what the node knows to a folder, as `mapmeld merge` writes its output."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapmeld import OccupancyGrid, write_map
from mapmeld.output import RESULT, OutputFolder, saying
from mapmeld.replay_files import result_of_estimate
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
    with OutputFolder(Path(folder).absolute(), force=force) as out:
        files = {}
        for named in sorted(known.names, key=lambda n: n.number):
            if named.frame in merged:
                name = "merged" if named.number == 1 else f"merged_{named.number}"
                write_map(out.staged / f"{name}.yaml", merged[named.frame])
                files[named.frame] = f"{name}.yaml"
        content = json.dumps(result_content(known, files, robots), indent=1, allow_nan=False)
        with saying(out.folder / RESULT):
            (out.staged / RESULT).write_text(content + "\n", encoding="ascii")
            written = sorted(path.name for path in out.staged.iterdir())
        out.commit()
        return [str(out.folder / name) for name in written]


def result_content(known: Known, files: Mapping[str, str], robots: tuple[Robot, ...]) -> dict[str, Any]:
    """The keys of result.json as a replay writes them: hypotheses and probability are of the places that are
    held, in their frames.

    files: the map file of a component's frame. `frame` and `is_world` are added to what docs/result.md
    describes.
    """
    content = result_of_estimate(known.estimate, {}).to_dict()
    frames = {r.name: r.frame for r in robots}
    for placed in content["maps"]:
        placed["frame"] = frames.get(placed["name"])
    for component in content["components"]:
        component |= {"merged": None, "frame": None, "is_world": False}
    # Blank maps come after these, in components of their own that have no frame.
    held = zip(known.estimate.components, known.names, strict=True)
    for component, (c, named) in zip(content["components"], held, strict=False):
        component |= {"merged": files.get(named.frame), "frame": named.frame, "is_world": c.is_world}
    return content
