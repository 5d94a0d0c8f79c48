"""What a pin takes: a place to other maps, and a world that they share."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from mapmeld import se2
from mapmeld.errors import MapmeldError
from mapmeld.estimate import Prior
from mapmeld.grid import OccupancyGrid
from mapmeld.map_yaml import one_line
from mapmeld.studio import layout
from mapmeld.studio.desk import Desk
from mapmeld.studio.layout import as_pose

SOFT_SIGMA = (0.3, 0.3, 0.1)
"""Standard deviations of a soft pin: metres, metres, radians."""


def pinned(
    name: str,
    sigma: Sequence[float] | None,
    desk: Desk,
    grids: Mapping[str, OccupancyGrid],
    boxes: Mapping[str, layout.Box],
) -> tuple[Desk, str | None]:
    """The desk with a map pinned where it lies, with sigma (metres, metres, radians) softly.

    A pin says where a map lies to other pins. So the first one pins the map below as well, whose name is the
    second value, and makes the world: the frame that the part of that map has. Raises MapmeldError for a map
    whose place to the others nobody has told: it neither lies on one of them nor was moved."""
    pins, priors = dict(desk.known.pins), dict(desk.known.priors)
    pins.pop(name, None)
    priors.pop(name, None)
    fixed = [n for n in (*pins, *priors) if n in grids]
    own = _part(name, desk)
    outside = {n: T for n, T in desk.poses.items() if n not in own}
    inside = {n: desk.poses[n] for n in own if n != name}
    below = layout.most_shared(name, outside, desk.poses, grids, boxes)
    below = below or layout.most_shared(name, inside, desk.poses, grids, boxes) or next(iter(inside), None)
    to = fixed[0] if fixed else below or _first_other(name, desk, grids)
    is_told = bool(set(fixed) & set(own)) if fixed else bool(inside)
    is_told = is_told or below in outside or to is None or desk.was_moved(name, to)
    if not is_told:
        raise MapmeldError(
            one_line(
                f"pin: {name} lies beside the other maps only to be seen, which is no place; drag it onto "
                "the map that it belongs to first, or click corners (K)"
            )
        )
    also = None if fixed else to
    world = desk if also is None else in_world(desk, also)
    if also is not None:
        pins[also] = world.poses[also]
    if sigma is None:
        pins[name] = world.poses[name]
    else:
        priors[name] = Prior(world.poses[name], sigma)
    return dataclasses.replace(world, known=dataclasses.replace(world.known, pins=pins, priors=priors)), also


def in_world(desk: Desk, lead: str) -> Desk:
    """The desk in the frame of the part that a map is of: its reference map, or the map itself where it was
    moved away from that, lies at the identity. What is pinned moves along."""
    first = lead
    if desk.result is not None:
        m = next(m for m in desk.result.maps if m.name == lead)
        reference = desk.result.components[m.component].reference
        if not desk.was_moved(lead, reference):
            first = reference
    T = se2.inverse(desk.poses[first])
    if np.allclose(T, 0.0, atol=1e-12):
        return desk

    def into(poses: Mapping[str, layout.Pose]) -> dict[str, layout.Pose]:
        # Not nearly but exactly the identity, since files tell it.
        return {
            n: (0.0, 0.0, 0.0) if n == first else as_pose(se2.compose(T, own)) for n, own in poses.items()
        }

    pins = into(desk.known.pins)
    placed = into({n: p.T_world_map for n, p in desk.known.priors.items()})
    priors = {n: Prior(placed[n], p.sigma) for n, p in desk.known.priors.items()}
    known = dataclasses.replace(desk.known, pins=pins, priors=priors)
    laid = {n: as_pose(se2.compose(T, own)) for n, own in desk.laid.items()}
    return dataclasses.replace(desk, poses=into(desk.poses), laid=laid, known=known, frame=desk.frame + 1)


def _part(name: str, desk: Desk) -> Sequence[str]:
    if desk.result is None:
        return [name]
    m = next(m for m in desk.result.maps if m.name == name)
    return desk.result.components[m.component].order


def _first_other(name: str, desk: Desk, grids: Mapping[str, OccupancyGrid]) -> str | None:
    order = [] if desk.result is None else [c.reference for c in desk.result.components]
    return next((n for n in [*order, *grids] if n != name), None)
