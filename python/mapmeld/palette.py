"""Colours that tell maps apart, also for colour-blind eyes."""

from __future__ import annotations

RGB = tuple[float, float, float]
"""Red, green and blue, 0..1."""

# Okabe and Ito's colours without their black (text) and yellow (too faint for thin walls on white), and four
# that stay apart from these in hue or lightness when red and green look alike.
_HUES: tuple[RGB, ...] = (
    (0.00, 0.45, 0.70),  # blue
    (0.84, 0.37, 0.00),  # vermilion
    (0.00, 0.62, 0.45),  # green
    (0.80, 0.47, 0.65),  # pink
    (0.90, 0.62, 0.00),  # orange
    (0.34, 0.71, 0.91),  # sky blue
    (0.45, 0.13, 0.38),  # plum
    (0.43, 0.42, 0.10),  # olive
    (0.55, 0.55, 0.58),  # grey
    (0.10, 0.15, 0.45),  # navy
)


def map_colour(index: int) -> RGB:
    """The colour of map `index`, counted from 0: ten hues, then the same darker, and over again."""
    hue = _HUES[index % len(_HUES)]
    if index // len(_HUES) % 2 == 1:
        return hue[0] * 0.6, hue[1] * 0.6, hue[2] * 0.6
    return hue
