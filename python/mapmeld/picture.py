"""A picture with text in it, drawn with Pillow, which loads in a tenth of the time of a plotting library."""

from __future__ import annotations

import functools
import importlib.util
import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mapmeld.palette import RGB

Point = tuple[float, float]
"""Pixels from the left and from the top."""
Box = tuple[float, float, float, float]
"""Left, top, right and bottom, pixels."""

INK: RGB = (0.15, 0.15, 0.15)
_FINER = 4
"""How many times as large discs are drawn first."""


class Picture:
    """A white picture of so many pixels. Colours are red, green and blue, 0..1; sizes are pixels."""

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (width, height), "white")
        self._draw = ImageDraw.Draw(self._image)

    def text(self, at: Point, text: str, size: int, anchor: str = "la", bold: bool = False) -> None:
        """A line of text; anchor: Pillow's, where in the text `at` is."""
        self._draw.text(at, text, fill=_bytes(INK), font=_font(size, bold), anchor=anchor)

    def upright(self, at: Point, text: str, size: int) -> None:
        """A line of text that reads upwards, its middle at a point."""
        width, height = math.ceil(text_width(text, size)), 2 * size
        tile = Image.new("RGB", (width, height), "white")
        ImageDraw.Draw(tile).text(
            (width / 2, height / 2), text, fill=_bytes(INK), font=_font(size), anchor="mm"
        )
        tile = tile.transpose(Image.Transpose.ROTATE_90)
        self._image.paste(tile, (round(at[0] - tile.width / 2), round(at[1] - tile.height / 2)))

    def line(self, points: Sequence[Point], colour: RGB) -> None:
        """A line of one pixel."""
        self._draw.line([*points], fill=_bytes(colour))

    def rectangle(self, box: Box, fill: RGB, rim: RGB) -> None:
        """A rectangle with a rim of two pixels."""
        self._draw.rectangle(box, fill=_bytes(fill), outline=_bytes(rim), width=2)

    def disc(self, at: Point, radius: float, rim: RGB, width: float) -> None:
        """A white disc with a rim."""
        half = math.ceil(radius) + 1
        corner = (round(at[0]) - half, round(at[1]) - half)
        center = tuple(_FINER * (v - c) for v, c in zip(at, corner, strict=True))
        for size, colour in ((radius, rim), (radius - width, (1.0, 1.0, 1.0))):
            # Drawn large and made smaller: Pillow's own edges are jagged.
            mask = Image.new("L", (2 * half * _FINER,) * 2)
            low, high = ([c + sign * _FINER * size for c in center] for sign in (-1, 1))
            ImageDraw.Draw(mask).ellipse([*low, *high], fill=255)
            self._image.paste(_bytes(colour), corner, mask.resize((2 * half,) * 2, Image.Resampling.BOX))

    def arrow(self, start: Point, tip: Point, colour: RGB, size: float) -> None:
        """A line that ends in a tip."""
        angle = math.atan2(tip[1] - start[1], tip[0] - start[0])
        back = [
            (tip[0] - size * math.cos(angle + turn), tip[1] - size * math.sin(angle + turn))
            for turn in (0.4, -0.4)
        ]
        self.line([start, tip], colour)
        self._draw.polygon([tip, *back], fill=_bytes(colour))

    def raster(self, rgb: NDArray[np.uint8], box: Box) -> None:
        """Pixels, the first row at the top, stretched over a box without smoothing."""
        left, top, right, bottom = (round(v) for v in box)
        size = (max(right - left, 1), max(bottom - top, 1))
        tile = Image.fromarray(rgb).resize(size, Image.Resampling.NEAREST)
        self._image.paste(tile, (left, top))

    def png(self) -> bytes:
        """The picture as a PNG file."""
        data = io.BytesIO()
        # Pillow loads the code of one format where a name tells it, of five where `format` does.
        data.name = "picture.png"
        self._image.save(data, compress_level=3)
        return data.getvalue()


def text_width(text: str, size: int) -> float:
    """Of a line of text, pixels."""
    return float(_font(size).getlength(text))


@functools.cache
def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Matplotlib's font, which has the letters of most languages; Pillow's own where it is missing."""
    found = importlib.util.find_spec("matplotlib")
    if found is not None and found.origin is not None:
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        file = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / name
        if file.is_file():
            return ImageFont.truetype(file, size)
    return ImageFont.load_default(size)


def _bytes(colour: RGB) -> tuple[int, int, int]:
    red, green, blue = (round(255 * v) for v in colour)
    return red, green, blue
