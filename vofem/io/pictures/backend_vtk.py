"""Draws a `Drawing` with VTK. To be imported only where `vofem.io.probe` found that VTK works."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from vofem.io.pictures.drawing import COLORMAP, Drawing, Label, Line, Strip

Array = NDArray[np.float64]

# Heights towards the viewer, by which kinds of shapes cover each other.
_BEHIND, _PATCH, _STRIP, _LINE, _DOT = 0.0, 1.0, 2.0, 3.0, 4.0


def draw(drawing: Drawing) -> bytes:
    """Return the picture as the bytes of a PNG file."""
    width, height = drawing.size
    # A theme of its own: what a user sets for other plots has no influence here.
    plotter = pyvista.Plotter(off_screen=True, window_size=drawing.size, theme=pyvista.themes.DocumentTheme())
    try:
        plotter.set_background("white")
        for patch in drawing.patches:
            _add(plotter, _polygons(patch.points[None], _PATCH), color=patch.color)
        for line in drawing.lines:
            _line(plotter, line)
        for strip in drawing.strips:
            _strip(plotter, strip, drawing.limit)
        for dots in drawing.dots:
            _add(plotter, _discs(dots.points, 0.5 * dots.diameter, _DOT), color=dots.color)
        for label in drawing.labels:
            plotter.add_actor(_text(label), render=False)
        plotter.enable_anti_aliasing("ssaa")
        # World coordinates are pixels.
        plotter.camera.parallel_projection = True
        plotter.camera.focal_point = (0.5 * width, 0.5 * height, 0.0)
        plotter.camera.position = (0.5 * width, 0.5 * height, 100.0)
        plotter.camera.up = (0.0, 1.0, 0.0)
        plotter.camera.parallel_scale = 0.5 * height
        plotter.camera.clipping_range = (1.0, 200.0)
        plotter.render()
        picture = io.BytesIO()
        plotter.screenshot(picture)
        return picture.getvalue()
    finally:
        plotter.close()


def _add(plotter: Any, mesh: Any, **options: Any) -> None:
    plotter.add_mesh(mesh, lighting=False, reset_camera=False, render=False, show_scalar_bar=False, **options)


def _flat(points: Array, z: float) -> Array:
    return np.column_stack([points, np.full(len(points), z)])


def _polygons(corners: Array, z: float) -> Any:
    """Return polygons of k corners each, given as (n, k, 2)."""
    count, each = corners.shape[:2]
    numbers = np.arange(count * each).reshape(count, each)
    faces = np.column_stack([np.full(count, each), numbers])
    return pyvista.PolyData(_flat(corners.reshape(-1, 2), z), faces=faces.ravel())


def _discs(centers: Array, radius: float, z: float) -> Any:
    """Return filled circles: the round points of OpenGL are left to the driver."""
    angle = np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
    rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _polygons(centers[:, None, :] + rim, z)


def _line(plotter: Any, line: Line) -> None:
    """Add a polyline as rectangles, with discs where it bends: wide lines of OpenGL have gaps at their corners."""
    points, half = line.points, 0.5 * line.width
    step = np.diff(points, axis=0)
    size = np.hypot(*step.T)
    start, end, step = points[:-1][size > 0], points[1:][size > 0], step[size > 0] / size[size > 0, None]
    if not len(step):
        return
    normal = half * np.stack([-step[:, 1], step[:, 0]], axis=1)
    corners = np.stack([start + normal, end + normal, end - normal, start - normal], axis=1)
    z = _BEHIND if line.behind else _LINE
    _add(plotter, _polygons(corners, z), color=line.color)
    bends = np.sum(step[:-1] * step[1:], axis=1) < 0.98
    if np.any(bends):
        _add(plotter, _discs(end[:-1][bends], half, z), color=line.color)


def _strip(plotter: Any, strip: Strip, limit: float) -> None:
    low, high = np.stack([strip.x, strip.low], axis=1), np.stack([strip.x, strip.high], axis=1)
    band = _polygons(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1), _STRIP)
    values = strip.values
    band["moment"] = np.stack([values[:-1], values[1:], values[1:], values[:-1]], axis=1).ravel()
    _add(
        plotter,
        band,
        scalars="moment",
        cmap=COLORMAP,
        clim=(-limit, limit),
        interpolate_before_map=True,
    )


def _text(label: Label) -> Any:
    actor = pyvista.Text(label.text, position=(label.x, label.y))
    actor.GetPositionCoordinate().SetCoordinateSystemToDisplay()
    actor.SetPosition(label.x, label.y)
    style = actor.GetTextProperty()
    style.SetFontFamilyToArial()
    style.SetFontSize(max(1, round(label.size)))
    style.SetColor(*pyvista.Color(label.color).float_rgb)
    style.SetBold(label.bold)
    {"left": style.SetJustificationToLeft, "center": style.SetJustificationToCentered}.get(
        label.align, style.SetJustificationToRight
    )()
    style.SetVerticalJustificationToCentered()
    return actor
