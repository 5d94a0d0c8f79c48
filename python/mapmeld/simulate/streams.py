"""Random streams: one generator for each purpose and robot, all from one seed.

A purpose has a stream of its own so that, say, switching drift on changes neither the path nor the noise.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """What a stream is for. The numbers are part of the seed: a new purpose goes at the end."""

    WORLD = 1
    HOMES = 2
    PATH = 3
    LIDAR = 4
    FRAME = 5
    DRIFT = 6


def stream(seed: int, purpose: Purpose, robot: int = 0) -> np.random.Generator:
    """The generator of (seed, purpose, robot)."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(purpose), robot)))
