"""Errors of a merge against ground truth: per pair, per map, and in sum. No files but in evaluate_files.

Pair error: T_a_b of the result (both maps in one component) against the truth's. The translation error is the
distance between the two images of the centre of b's known cells, so it does not depend on where b's frame has
its origin; the rotation error is the angle between the two.

Map error: the frame of a component is arbitrary, so a map's error needs an anchor: the map of the component
against which most others are right, and among those the one with the lowest median error. The error of a
map is that of its pair with the anchor. The anchor itself has none; its verdict is that of the best map
seen from it.

Which truth a pair is held against: see Truth.reference. What counts as placed: see mapmeld.acceptance.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapmeld import json_fields
from mapmeld.acceptance import judge_acceptance
from mapmeld.errors import MapFileError, MapmeldError
from mapmeld.evaluation import Evaluation, MapError, PairError, Summary
from mapmeld.grid import UNKNOWN, OccupancyGrid
from mapmeld.map_io import read_map
from mapmeld.map_yaml import one_line
from mapmeld.measurement import Measurement, Rig
from mapmeld.placement import Placement, parse_placements
from mapmeld.session_file import digest
from mapmeld.truth import Truth, parse_truth

__all__ = [
    "Evaluation",
    "MapError",
    "PairError",
    "Summary",
    "centre_of_known_cells",
    "evaluate",
    "evaluate_files",
]

XY = Sequence[float]
"""(x, y) in metres."""


def evaluate(
    result: Mapping[str, Any],
    truth: Mapping[str, Any],
    centres: Mapping[str, XY],
    resolutions: Mapping[str, float] | None = None,
) -> Evaluation:
    """The errors of a merge result against the truth of its case.

    result, truth: the contents of result.json and truth.json.
    centres: (x, y) in metres, in each map's own frame, of the centre of its known cells; needed for every map
        that the result places.
    resolutions: side of a cell in metres, by map; without it, the truth's `resolution` stands for all.

    The order of the maps in the result, and the frames of its components, do not matter. Raises MapmeldError
    for missing or malformed fields, for maps that the truth does not know, and for a placed map without a
    centre or resolution: an error measured elsewhere would be another quantity.
    """
    return _evaluate(parse_placements(result), parse_truth(truth), centres, resolutions, "result", "truth")


def evaluate_files(
    result_path: str | Path, truth_path: str | Path, maps_dir: str | Path | None = None
) -> Evaluation:
    """`evaluate` on files; the maps are read from maps_dir/NAME.yaml, by default from the truth's folder.

    Raises MapmeldError as `evaluate` does, for files that cannot be read or are no JSON, when the file
    of a placed map is not there (all such maps are listed), and when a map that was merged is still where the
    result says and not the truth's of that name.
    """
    result = json_fields.read_object(result_path)
    placements = parse_placements(result, str(result_path))
    truth = parse_truth(json_fields.read_object(truth_path), str(truth_path))
    _check_known(placements, truth, str(result_path), str(truth_path))
    folder = Path(truth_path).parent if maps_dir is None else Path(maps_dir)
    placed = [p.name for p in placements.values() if p.T_component_map is not None]
    missing = [name for name in placed if not (folder / f"{name}.yaml").is_file()]
    if missing:
        raise MapmeldError(
            f"{folder}: no map file NAME.yaml for {_listed(missing)}; errors are measured at the centre of a "
            "map's known cells, so give the folder of the maps"
        )
    grids = {name: read_map(folder / f"{name}.yaml") for name in placed}
    _check_same(grids, result, Path(result_path), folder)
    centres = {name: c for name, grid in grids.items() if (c := centre_of_known_cells(grid)) is not None}
    resolutions = {name: grid.resolution for name, grid in grids.items()}
    return _evaluate(placements, truth, centres, resolutions, str(result_path), str(truth_path))


def _check_same(
    grids: Mapping[str, OccupancyGrid], result: Mapping[str, Any], result_path: Path, folder: Path
) -> None:
    """Raises for a saved map of the result that is not the truth's: two cases may name maps alike."""
    for m in result["maps"]:
        file = m.get("file")
        if m["name"] not in grids or not isinstance(file, dict) or file.get("topic") is not None:
            continue
        merged, ours = result_path.parent / str(file.get("path")), folder / f"{m['name']}.yaml"
        try:
            is_ours = digest(read_map(merged)) == digest(grids[m["name"]])
        except MapFileError:
            continue  # It is gone: the names must do.
        if not is_ours:
            raise MapmeldError(
                one_line(
                    f"{merged}: the map that was merged is another than {ours}; is the truth of another "
                    "case? --maps gives the folder of the maps"
                )
            )


def centre_of_known_cells(grid: OccupancyGrid) -> tuple[float, float] | None:
    """Mean (x, y) in metres, in map coordinates, of the cells that are not unknown; None when all are."""
    rows, cols = np.nonzero(grid.data != UNKNOWN)
    if rows.size == 0:
        return None
    x, y = grid.cell_centers(rows, cols).mean(axis=0)
    return float(x), float(y)


def _evaluate(
    placements: Mapping[str, Placement],
    truth: Truth,
    centres: Mapping[str, XY],
    resolutions: Mapping[str, float] | None,
    result_label: str,
    truth_label: str,
) -> Evaluation:
    _check_known(placements, truth, result_label, truth_label)
    names = [name for name in truth.T_world_map if name in placements]
    rig = Rig(placements, truth, centres, _resolutions(placements, truth, resolutions, truth_label))
    _check_centres(placements, centres, result_label)

    pairs = []
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            known = truth.pair(first, second)
            a, b = (known.a, known.b) if known else (first, second)
            pairs.append(_pair_error(rig, a, b))

    components: dict[int, list[str]] = {}
    for name in names:
        component = rig.component(name)
        if component is not None:
            components.setdefault(component, []).append(name)
    anchors = {component: _anchor(rig, members) for component, members in components.items()}
    acceptance, accepted, via = judge_acceptance(rig, names, components, anchors)
    maps = [
        _map_error(rig, placements[name], names, components, anchors, accepted[name], via.get(name))
        for name in names
    ]
    return Evaluation(
        maps=tuple(maps),
        pairs=tuple(pairs),
        summary=_summary(maps, pairs, len(components)),
        acceptance=acceptance,
        not_in_result=tuple(name for name in truth.T_world_map if name not in placements),
    )


def _pair_error(rig: Rig, a: str, b: str) -> PairError:
    measured = rig.measure(a, b)
    reference = rig.truth.reference(a, b)
    joined = rig.joined(a, b)
    return PairError(
        a=a,
        b=b,
        overlap_occupied=rig.truth.shared(a, b),
        rms_m=reference.rms_m if reference else None,
        reference=reference.source if reference else None,
        joined=joined,
        translation_error_m=measured.translation_m if measured else None,
        rotation_error_deg=measured.rotation_deg if measured else None,
        right=measured is not None and measured.right,
        fine=measured is not None and measured.fine,
        wrong=measured is not None and measured.wrong,
        verdict=measured.verdict if measured else ("no truth" if reference is None else "apart"),
    )


def _seen_from(rig: Rig, anchor: str, members: Sequence[str]) -> list[Measurement]:
    """The measured errors of the other members, seen from the anchor."""
    measured = (rig.measure(anchor, name) for name in members if name != anchor)
    return [m for m in measured if m is not None]


def _anchor(rig: Rig, members: Sequence[str]) -> str:
    """The member against which most others are right; of equals the lowest median error, then truth's order.

    The count comes first because the median says nothing once more than half of the maps are misplaced.
    """

    def rank(name: str) -> tuple[int, float]:
        seen = _seen_from(rig, name, members)
        ratios = [m.ratio for m in seen]
        return -sum(m.right for m in seen), statistics.median(ratios) if ratios else math.inf

    return min(members, key=rank)


def _map_error(
    rig: Rig,
    placement: Placement,
    names: Sequence[str],
    components: Mapping[int, Sequence[str]],
    anchors: Mapping[int, str],
    accepted: bool | None,
    via: str | None,
) -> MapError:
    name = placement.name
    component = rig.component(name)
    anchor = None if component is None else anchors[component]
    measured = None
    if component is None or anchor is None:
        verdict = "not placed"
    elif len(components[component]) == 1:
        anchor, verdict = None, "alone"
    elif anchor == name:
        seen = _seen_from(rig, anchor, components[component])
        verdict = min(seen, key=lambda m: m.ratio).verdict if seen else "no truth"
    else:
        measured = rig.measure(anchor, name)
        verdict = measured.verdict if measured else "no truth"
    return MapError(
        name=name,
        status=placement.status,
        component=component,
        anchor=anchor,
        translation_error_m=measured.translation_m if measured else None,
        rotation_error_deg=measured.rotation_deg if measured else None,
        rms_m=measured.reference.rms_m if measured else None,
        reference=measured.reference.source if measured else None,
        shares=rig.shares(name, names),
        verdict=verdict,
        accepted=accepted,
        accepted_via=via,
    )


def _summary(maps: Sequence[MapError], pairs: Sequence[PairError], components: int) -> Summary:
    with_truth = [p for p in pairs if p.reference is not None]
    right = [p.translation_error_m for p in with_truth if p.right and p.translation_error_m is not None]
    right_with = {m.name: 1 for m in maps}
    for p in with_truth:
        right_with[p.a] += p.right
        right_with[p.b] += p.right
    most = max(right_with.values(), default=0)
    return Summary(
        maps=len(maps),
        placed_maps=sum(m.component is not None for m in maps),
        right_maps=most if most > 1 else 0,
        components=components,
        pairs=len(with_truth),
        joined=sum(p.joined for p in with_truth),
        right=sum(p.right for p in with_truth),
        fine=sum(p.fine for p in with_truth),
        wrong=sum(p.wrong for p in with_truth),
        median_right_m=statistics.median(right) if right else None,
    )


def _check_known(
    placements: Mapping[str, Placement], truth: Truth, result_label: str, truth_label: str
) -> None:
    unknown = [name for name in placements if name not in truth.T_world_map]
    if unknown:
        raise MapmeldError(f"{result_label}: maps: {truth_label} does not know {_listed(unknown)}")


def _check_centres(placements: Mapping[str, Placement], centres: Mapping[str, XY], result_label: str) -> None:
    placed = [p.name for p in placements.values() if p.T_component_map is not None]
    lacking = [name for name in placed if name not in centres]
    if lacking:
        raise MapmeldError(
            f"{result_label}: maps: no centre of known cells for {_listed(lacking)}, yet placed; "
            "an error cannot be measured for a map that knows nothing"
        )
    for name in placed:
        if len(centres[name]) != 2 or not all(math.isfinite(v) for v in centres[name]):
            raise MapmeldError(f"centres: that of map {name!r} must be two finite numbers (x, y)")


def _resolutions(
    placements: Mapping[str, Placement],
    truth: Truth,
    resolutions: Mapping[str, float] | None,
    truth_label: str,
) -> dict[str, float]:
    """Side of a cell in metres of every placed map."""
    found: dict[str, float] = {}
    for name, placement in placements.items():
        if placement.T_component_map is None:
            continue
        value = truth.resolution if resolutions is None else resolutions.get(name)
        if value is None:
            place = f"{truth_label}: key 'resolution' is missing" if resolutions is None else "resolutions"
            raise MapmeldError(f"{place}: the size of the cells of map {name!r} is not known")
        found[name] = value
    return found


def _listed(names: Sequence[str]) -> str:
    return "maps " + ", ".join(repr(name) for name in names) if len(names) > 1 else f"map {names[0]!r}"
