"""Shows a replay on a terminal: what changed, and when."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from mapmeld.estimate import RobotEstimate
from mapmeld.replay import Moment

_NONE = "-"


def changes(moments: Sequence[Moment]) -> list[tuple[Moment, RobotEstimate]]:
    """The robots that came, got another status, or were placed anew, at the moments when they did."""
    before: dict[str, RobotEstimate] = {}
    found = []
    for m in moments:
        for r in m.robots:
            old = before.get(r.name)
            if old is None or (old.status, old.placements) != (r.status, r.placements):
                found.append((m, r))
            before[r.name] = r
    return found


def changes_table(found: Sequence[tuple[Moment, RobotEstimate]]) -> Table:
    """A row a change: when, which robot, what it is now, where, in whose frame."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("time s", justify="right", no_wrap=True)
    table.add_column("map", overflow="fold")
    table.add_column("status", no_wrap=True)
    for head in ("prob", "x m", "y m", "theta deg"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("in frame of", overflow="fold")
    for m, r in found:
        pose, anchor = [_NONE] * 3, _NONE
        if r.T_world_map is not None and r.component is not None:
            x, y, theta = r.T_world_map.tolist()
            pose = [f"{x:.3f}", f"{y:.3f}", f"{math.degrees(theta):.2f}"]
            anchor = m.components[r.component].anchor
        # As in the table of a merge: of a map that shares nothing with others there is nothing to be sure of.
        share = _NONE if r.status in ("no evidence", "blank") else f"{r.probability:.2f}"
        cells = [f"{m.since_start:.3f}", r.name, r.status, share, *pose, anchor]
        # Text, not str: rich would read [brackets] in a map's name as markup.
        table.add_row(*(Text(cell) for cell in cells))
    return table
