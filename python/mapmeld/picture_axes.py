"""A part of a picture that shows metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mapmeld.palette import RGB
from mapmeld.picture import INK, Box, Picture, Point, text_width

_FRAME: RGB = (0.7, 0.7, 0.7)
_TICK = 4
"""Length of a tick, pixels."""


@dataclass(frozen=True)
class Axes:
    """Where metres are in a picture. view: left, right, bottom, top in metres; corner: the lowest left point
    of the view in the picture; scale: pixels a metre."""

    view: tuple[float, float, float, float]
    corner: Point
    scale: float

    @classmethod
    def within(cls, view: tuple[float, float, float, float], box: Box) -> Axes:
        """As large as a box allows, in its middle; at its top."""
        left, right, bottom, top = view
        scale = min((box[2] - box[0]) / (right - left), (box[3] - box[1]) / (top - bottom))
        x = (box[0] + box[2] - scale * (right - left)) / 2
        return cls(view, (x, box[1] + scale * (top - bottom)), scale)

    @property
    def box(self) -> Box:
        """Of the view in the picture."""
        left, right, bottom, top = self.view
        x, y = self.corner
        return x, y - self.scale * (top - bottom), x + self.scale * (right - left), y

    def at(self, x: float, y: float) -> Point:
        """Where a point in metres is in the picture."""
        return (
            self.corner[0] + self.scale * (x - self.view[0]),
            self.corner[1] - self.scale * (y - self.view[2]),
        )

    def frame(self, picture: Picture, size: int, most: int, names: tuple[str, str] | None) -> None:
        """Draws the rim, at most so many ticks a side with their numbers, and what the axes are."""
        left, top, right, bottom = self.box
        x_ticks, y_ticks = ticks(self.view[0], self.view[1], most), ticks(self.view[2], self.view[3], most)
        for value, text in x_ticks:
            x = self.at(value, 0.0)[0]
            picture.line([(x, bottom), (x, bottom + _TICK)], INK)
            picture.text((x, bottom + _TICK + 2), text, size, "ma")
        for value, text in y_ticks:
            y = self.at(0.0, value)[1]
            picture.line([(left - _TICK, y), (left, y)], INK)
            picture.text((left - _TICK - 3, y), text, size, "rm")
        picture.line([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], _FRAME)
        if names is not None:
            widest = max((text_width(text, size) for _, text in y_ticks), default=0.0)
            picture.text(((left + right) / 2, bottom + 1.6 * size + _TICK), names[0], size + 1, "ma")
            picture.upright((left - _TICK - widest - 1.2 * size, (top + bottom) / 2), names[1], size + 1)


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round values from low to high, at most so many, with their text."""
    step = 10.0 ** math.floor(math.log10((high - low) / most))
    for factor in (1.0, 2.0, 5.0, 10.0, 20.0):
        first, last = math.ceil(low / (factor * step)), math.floor(high / (factor * step))
        if last - first < most:
            break
    step *= factor
    digits = max(0, -math.floor(math.log10(step)))
    return [
        (k * step, f"{k * step:.{digits}f}".replace("-", "\N{MINUS SIGN}")) for k in range(first, last + 1)
    ]
