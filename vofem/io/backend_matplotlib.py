"""Draws a `Drawing` with matplotlib."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vofem.io.drawing import COLORMAP, Drawing, Strip

_DPI = 100.0


def draw(drawing: Drawing, path: Path) -> None:
    """Write a drawing to a file, in the format of its suffix."""
    # Figure, not pyplot: no state that other code shares, no window, no choice of a backend.
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon

    width, height = drawing.size
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    points = 72.0 / _DPI
    for patch in drawing.patches:
        axes.add_patch(Polygon(patch.points, closed=True, facecolor=patch.color, edgecolor="none", zorder=1))
    for line in drawing.lines:
        axes.plot(*line.points.T, color=line.color, linewidth=line.width * points, zorder=2 if line.behind else 4)
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
    figure.savefig(path, dpi=_DPI, facecolor="white")


def _strip(axes: object, strip: Strip, limit: float) -> None:
    x = np.stack([strip.x, strip.x])
    y = np.stack([strip.low, strip.high])
    values = np.stack([strip.values, strip.values])
    axes.pcolormesh(  # type: ignore[attr-defined]
        x,
        y,
        values,
        cmap=COLORMAP,
        vmin=-limit,
        vmax=limit,
        shading="gouraud",
        alpha=strip.opacity,
        rasterized=True,
        zorder=3,
    )
