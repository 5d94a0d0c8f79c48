"""Growing the set cells of a raster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def dilate(mask: NDArray[np.bool_], radius: int, start: int = 0) -> NDArray[np.bool_]:
    """The cells within Chebyshev distance `radius` cells of a set cell.

    mask: shape (height, width), bool; not changed.
    start: the radius by which `mask` has been grown already, so that a growing sequence costs each step once.
    """
    grown = mask.copy()
    while start < radius:
        # A square of radius r, shifted by up to 2 r + 1 to both sides, leaves no gap.
        shift = min(radius - start, 2 * start + 1)
        for axis in (0, 1):
            before = grown.copy()
            view, past = np.moveaxis(grown, axis, 0), np.moveaxis(before, axis, 0)
            view[shift:] |= past[: max(0, len(past) - shift)]
            view[: max(0, len(past) - shift)] |= past[shift:]
        start += shift
    return grown
