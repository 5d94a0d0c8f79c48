"""Shows a merge on a terminal: the summary table, warnings, details."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mapmeld.contradictions import contradictions
from mapmeld.result import MergeResult, PlacedMap
from mapmeld.true_size import wrong_sizes

if TYPE_CHECKING:
    from rich.table import Table

_NONE = "-"
"""What stands for a value that does not exist. Never 0: a pose of 0 is a claim."""

_MOST_CONTRADICTIONS = 3
"""So many are told of in full."""


def summary_table(result: MergeResult) -> Table:
    """A row a map: component, pose in the frame of the component's reference map, standard deviations,
    status, and the probability of its place.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    # Narrow enough for 80 columns with names of ten letters; numbers are never cut.
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("map", overflow="fold")
    for head in ("comp", "x m", "y m", "theta deg", "sd x m", "sd y m", "sd deg"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("status", no_wrap=True)
    table.add_column("prob", justify="right", no_wrap=True)
    for placed in result.maps:
        # Text, not str: rich would read [brackets] in a map's name as markup.
        table.add_row(*(Text(cell) for cell in _cells(placed, result)))
    return table


def warnings(result: MergeResult) -> list[str]:
    """What a user must know before using the merged map, a sentence a line."""
    lines = []
    parts = len(result.merged_maps)
    if parts > 1:
        lines.append(
            f"the maps fall into {parts} components; nothing that is sure enough joins them "
            f"(-v shows every pair). Each is a merged map of its own: {_files(result)}"
        )
    unmerged = [
        m for m in result.maps if m.status == "blank" or (parts > 1 and m.status not in ("merged", "pinned"))
    ]
    # A prior is what places a map where no wall does; one map alone has nothing to be placed by.
    unmerged += [m for m in result.maps if parts == 1 and m.status in ("prior", "no evidence")]
    lines += [f"map {m.name}: {m.status}: {m.reason}" for m in unmerged]
    against = contradictions(result)
    lines += [str(c) for c in against[:_MOST_CONTRADICTIONS]]
    if len(against) > _MOST_CONTRADICTIONS:
        lines.append(f"so do {len(against) - _MOST_CONTRADICTIONS} more pairs")
    lines += [str(w) for w in wrong_sizes(result.pairs)]
    return lines


def _files(result: MergeResult) -> str:
    """Which component is in which file, as far as they can be told in a line."""
    named = [(k, c.merged.name) for k, c in enumerate(result.components) if c.merged is not None]
    told = ", ".join(f"component {k} is {name}.yaml" for k, name in named[:3])
    return told + (", and so on" if len(named) > 3 else "")


def details(result: MergeResult) -> list[str]:
    """Components, hypotheses, pairs and times, a line each."""
    lines = []
    for k, c in enumerate(result.components):
        rms = "" if c.rms_m is None else f", walls fit to {c.rms_m * 100:.1f} cm"
        size = "" if c.merged is None else f", {c.merged.width} x {c.merged.height} cells"
        conflicts = (
            f", {c.conflict_cells} of {c.shared_cells} shared cells in conflict" if c.shared_cells else ""
        )
        lines.append(f"component {k}: {' > '.join(c.order)}{rms}{size}{conflicts}")
    lines.append("hypotheses: " + ", ".join(f"{h.probability:.3f}" for h in result.hypotheses))
    if result.known is not None:
        lines += [f"known: {line}" for line in result.known.lines()]
    for p in result.pairs:
        if p.modes:
            best, decoy = p.modes[0], p.decoy_log_likelihood
            mirrored = _NONE if decoy is None else f"{decoy:.1f}"
            lines.append(
                f"pair {p.a}, {p.b}: {p.status}, probability {p.probability:.2f}, "
                f"{best.shared_length:.1f} m of wall in common, log-likelihood {best.log_likelihood:.1f} "
                f"(mirror image {mirrored}), {len(p.modes)} modes of {p.candidates} candidates"
            )
        else:
            lines.append(f"pair {p.a}, {p.b}: no mode of {p.candidates} candidates")
    lines.append("seconds: " + ", ".join(f"{stage} {s:.3f}" for stage, s in result.seconds.items()))
    return lines


def _cells(m: PlacedMap, result: MergeResult) -> list[str]:
    if m.T_component_map is None or m.covariance is None:
        return [m.name, str(m.component), *[_NONE] * 6, m.status, _NONE]
    x, y, theta = m.T_component_map.tolist()
    component = result.components[m.component]
    if component.reference == m.name and not component.in_world:
        deviations = [_NONE] * 3
    else:
        sx, sy, st = (math.sqrt(max(v, 0.0)) for v in m.covariance.diagonal().tolist())
        deviations = [f"{sx:.3f}", f"{sy:.3f}", f"{math.degrees(st):.2f}"]
    pose = [_number(x, 3), _number(y, 3), _number(math.degrees(theta), 2)]
    # A map alone was placed by nobody: there is nothing to be sure of.
    share = _NONE if len(result.components[m.component].order) == 1 else f"{m.probability:.2f}"
    return [m.name, str(m.component), *pose, *deviations, m.status, share]


def _number(value: float, digits: int) -> str:
    """So many digits, and no minus before what rounds to zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"
