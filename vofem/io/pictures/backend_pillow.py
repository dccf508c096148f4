"""Draws a `Drawing` with Pillow: ten times as fast as with matplotlib, for the frames of movies."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.io.pictures.drawing import Drawing, Label, Line, Strip, moment_colors

Array = NDArray[np.float64]

#: Pixels that are drawn for each pixel of the picture, in each direction: their mean has smooth edges.
_FINE = 2


def pixels(drawing: Drawing) -> NDArray[np.uint8]:
    """Return a drawing as colours of pixels, shape (height, width, 3)."""
    from PIL import Image, ImageDraw

    width, height = drawing.size
    image = Image.new("RGB", (width * _FINE, height * _FINE), "white")
    brush = _Brush(ImageDraw.Draw(image), height)
    for line in drawing.lines:
        if line.behind:
            brush.line(line)
    for patch in drawing.patches:
        brush.polygon(patch.points, patch.color)
    colors = _color_table()
    for strip in drawing.strips:
        brush.strip(strip, drawing.limit, colors)
    for line in drawing.lines:
        if not line.behind:
            brush.line(line)
    for dots in drawing.dots:
        for x, y in dots.points:
            brush.disc(x, y, 0.5 * dots.diameter, dots.color)
    for label in drawing.labels:
        brush.text(label)
    return np.asarray(image.reduce(_FINE))


@functools.cache
def _color_table() -> list[tuple[int, int, int]]:
    table = np.round(255.0 * moment_colors(256)).astype(int)
    return [(int(r), int(g), int(b)) for r, g, b in table]


@functools.cache
def _font(size: int, bold: bool) -> Any:
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


class _Brush:
    """Draws shapes of a drawing, whose y points up, into an image, whose y points down."""

    def __init__(self, draw: Any, height: int) -> None:
        self._draw, self._height = draw, height

    def _place(self, points: Array) -> list[tuple[float, float]]:
        return [(_FINE * float(x), _FINE * (self._height - float(y))) for x, y in points]

    def polygon(self, points: Array, color: Any) -> None:
        self._draw.polygon(self._place(points), fill=color)

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        (left, top), (right, bottom) = self._place(np.array([[x - radius, y + radius], [x + radius, y - radius]]))
        self._draw.ellipse((left, top, right, bottom), fill=color)

    def line(self, line: Line) -> None:
        self._draw.line(
            self._place(line.points), fill=line.color, width=max(1, round(_FINE * line.width)), joint="curve"
        )

    def strip(self, strip: Strip, limit: float, colors: list[tuple[int, int, int]]) -> None:
        values = 0.5 * (strip.values[1:] + strip.values[:-1]) / limit
        index = np.clip(np.round(127.5 * (1.0 + values)), 0, 255).astype(int)
        for k, color in enumerate(index.tolist()):
            corners = [
                [strip.x[k], strip.low[k]], [strip.x[k + 1], strip.low[k + 1]],
                [strip.x[k + 1], strip.high[k + 1]], [strip.x[k], strip.high[k]],
            ]  # fmt: skip
            self.polygon(np.array(corners), colors[color])

    def text(self, label: Label) -> None:
        anchor = {"left": "l", "center": "m", "right": "r"}[label.align] + "m"
        ((x, y),) = self._place(np.array([[label.x, label.y]]))
        # Sizes are heights of lines; a font's own size is smaller than its line.
        font = _font(max(6, round(0.86 * _FINE * label.size)), label.bold)
        self._draw.text((x, y), label.text, fill=label.color, font=font, anchor=anchor)
