"""What happens in a merge, as a listener hears it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

Listener = Callable[[str, float, Mapping[str, Any]], object]
"""Hears (name, seconds since the start, data) of every event, on the calling thread and after the fact.

Maps are told by their index, poses as [x, y, theta] in metres and radians, maps in a world as (index,
T_world_map), the world being the frame of the map where the virtual robot started.

prepared: maps: map, boundary (n, 2) and corners (n, 2), map coordinates, metres.
registered: pairs: a, b, candidates, status, probability and modes, as in Pair.
stepped: travel, step (from 1), joining (the robot travels among merged maps), effective_sample_size,
    resampled, log_evidence. candidates, the poses that particles could go to: maps, log_mass, and over all
    candidates of the step Psi~ (psi) and gamma~ (gamma) of the paper, whatever model weighs them. particles,
    before resampling: maps, in the order in which they were merged, and weight.
refined: components of several maps: maps, the poses before and after the joint refinement, covariances
    (n, 3, 3), rms (metres). Once after the travels, and again when merged maps have joined.
"""
