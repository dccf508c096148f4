"""Draws a `Drawing` with VTK. To be imported only where `vofem.io.probe` found that VTK works."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from vofem.io.drawing import COLORMAP, Drawing, Label, Line, Strip

Array = NDArray[np.float64]

# Heights towards the viewer, by which kinds of shapes cover each other.
_PATCH, _BEHIND, _STRIP, _LINE, _DOT = 0.0, 1.0, 2.0, 3.0, 4.0


def draw(drawing: Drawing) -> bytes:
    """Return the picture as the bytes of a PNG file."""
    width, height = drawing.size
    # A theme of its own: what a user sets for other plots has no influence here.
    plotter = pyvista.Plotter(off_screen=True, window_size=drawing.size, theme=pyvista.themes.DocumentTheme())
    try:
        plotter.set_background("white")
        for patch in drawing.patches:
            _add(plotter, _polygon(patch.points), color=patch.color)
        for line in drawing.lines:
            _line(plotter, line)
        for strip in drawing.strips:
            _strip(plotter, strip, drawing.limit)
        for dots in drawing.dots:
            _add(plotter, _discs(dots.points, 0.5 * dots.diameter), color=dots.color)
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


def _polygon(points: Array) -> Any:
    return pyvista.PolyData(_flat(points, _PATCH), faces=np.concatenate([[len(points)], np.arange(len(points))]))


def _discs(centers: Array, radius: float) -> Any:
    """Return filled circles: the round points of OpenGL are left to the driver."""
    angle = np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
    rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = (centers[:, None, :] + rim).reshape(-1, 2)
    corners = np.arange(len(points)).reshape(-1, angle.size)
    faces = np.column_stack([np.full(len(centers), angle.size), corners])
    return pyvista.PolyData(_flat(points, _DOT), faces=faces.ravel())


def _line(plotter: Any, line: Line) -> None:
    """Add a polyline as a band of triangles: wide lines of OpenGL have gaps at their corners."""
    points, half = line.points, 0.5 * line.width
    step = np.diff(points, axis=0)
    keep = np.hypot(*step.T) > 1e-9
    points = np.concatenate([points[:1], points[1:][keep]])
    if len(points) < 2:
        return
    along = step[keep] / np.hypot(*step[keep].T)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    before, after = np.concatenate([normal[:1], normal]), np.concatenate([normal, normal[-1:]])
    # A mitre, cut short where the line turns back on itself.
    miter = before + after
    miter /= np.maximum(np.sum(miter * after, axis=1), 0.3)[:, None]
    left, right = points + half * miter, points - half * miter
    z = _BEHIND if line.behind else _LINE
    _add(plotter, _band(left, right, z), color=line.color)


def _band(one: Array, other: Array, z: float) -> Any:
    k = np.arange(len(one) - 1)
    corners = np.column_stack([np.full(k.size, 4), k, k + 1, len(one) + k + 1, len(one) + k])
    return pyvista.PolyData(_flat(np.concatenate([one, other]), z), faces=corners.ravel())


def _strip(plotter: Any, strip: Strip, limit: float) -> None:
    band = _band(np.stack([strip.x, strip.low], axis=1), np.stack([strip.x, strip.high], axis=1), _STRIP)
    band["moment"] = np.concatenate([strip.values, strip.values])
    _add(
        plotter,
        band,
        scalars="moment",
        cmap=COLORMAP,
        clim=(-limit, limit),
        opacity=strip.opacity,
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
