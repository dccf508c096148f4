"""Draws a `Drawing` with matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vofem.io.pictures.drawing import COLORMAP, Drawing, Strip

_DPI = 100.0

#: Colours along a strip.
_COLUMNS = 1024


def draw(drawing: Drawing, path: Path) -> None:
    """Write a drawing to a file, in the format of its suffix."""
    # Figure is used and not pyplot, because it shares no state with other code and opens no window.
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon

    width, height = drawing.size
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.axis("off")
    points = 72.0 / _DPI
    for patch in drawing.patches:
        axes.add_patch(Polygon(patch.points, closed=True, facecolor=patch.color, edgecolor="none", zorder=2))
    for line in drawing.lines:
        axes.plot(*line.points.T, color=line.color, linewidth=line.width * points, zorder=1 if line.behind else 4)
    for strip in drawing.strips:
        _strip(axes, strip, drawing.limit)
    for dots in drawing.dots:
        axes.plot(*dots.points.T, "o", color=dots.color, markersize=dots.diameter * points, markeredgewidth=0, zorder=5)
    for label in drawing.labels:
        axes.text(
            label.x,
            label.y,
            # A name is text, not mathematics.
            label.text.replace("$", r"\$"),
            color=label.color,
            fontsize=label.size * points,
            fontweight="bold" if label.bold else "normal",
            ha=label.align,
            va="center",
            zorder=6,
        )
    # An image sets the limits to its own.
    axes.set(xlim=(0, width), ylim=(0, height))
    figure.savefig(path, dpi=_DPI, facecolor="white")


def _strip(axes: Any, strip: Strip, limit: float) -> None:
    """Add an image that is clipped by the outline: triangles of colour show seams in some viewers."""
    from matplotlib.patches import Polygon

    outline = np.concatenate([np.stack([strip.x, strip.low], axis=1), np.stack([strip.x, strip.high], axis=1)[::-1]])
    (left, bottom), (right, top) = outline.min(axis=0), outline.max(axis=0)
    if not (right > left and top > bottom):
        return  # a diagram of zero moment
    values = np.interp(np.linspace(left, right, _COLUMNS), strip.x, strip.values)
    image = axes.imshow(
        values[None, :],
        extent=(left, right, bottom, top),
        aspect="auto",
        cmap=COLORMAP,
        vmin=-limit,
        vmax=limit,
        interpolation="bilinear",
        zorder=3,
    )
    image.set_clip_path(Polygon(outline, closed=True, transform=axes.transData))
