"""What a map may snap to: the maps near it, and how much chance alone reaches on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mapmeld.grid import OccupancyGrid
from mapmeld.studio import layout
from mapmeld.studio.desk import Desk
from mapmeld.studio.layout import Pose


def neighbours(
    names: Sequence[str],
    desk: Desk,
    grids: Mapping[str, OccupancyGrid],
    boxes: Mapping[str, layout.Box],
) -> tuple[dict[str, Pose], float]:
    """The maps whose boxes touch those of the named ones and that are not forbidden to match them, with their
    poses; and the most that a mirror image reached between the two, nats."""
    moved = {n: desk.poses[n] for n in names}
    if not moved:
        return {}, 0.0
    near = layout.box_of(moved, grids, boxes)
    base = {
        n: T
        for n, T in desk.poses.items()
        if n not in moved
        and not any(desk.known.is_forbidden(n, m) for m in moved)
        and _touch(near, layout.box_of({n: T}, grids, boxes))
    }
    pairs = () if desk.result is None else desk.result.pairs
    across = [p for p in pairs if (p.a in base and p.b in moved) or (p.b in base and p.a in moved)]
    return base, max([0.0, *(p.decoy_log_likelihood or 0.0 for p in across)])


def _touch(a: layout.Box, b: layout.Box) -> bool:
    return a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3]
