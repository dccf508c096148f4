"""Draws a `Drawing` with VTK. To be imported only where `vofem.io.probe` found that VTK works.

VTK is used directly, because pyvista takes a second to be imported.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2
from numpy.typing import NDArray
from PIL import Image
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLookupTable, vtkPoints, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow, vtkTextActor

from vofem.io.pictures.drawing import Drawing, Label, Line, Strip, moment_colors

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

# Heights towards the viewer, by which kinds of shapes cover each other.
_BEHIND, _PATCH, _STRIP, _LINE, _DOT = 0.0, 1.0, 2.0, 3.0, 4.0

_SHADES = 256


def draw(drawing: Drawing) -> bytes:
    """Return the picture as the bytes of a PNG file."""
    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    polygons = _Polygons()
    for patch in drawing.patches:
        polygons.add(patch.points[None], _PATCH, patch.color)
    for line in drawing.lines:
        _line(polygons, line)
    for dots in drawing.dots:
        polygons.discs(dots.points, 0.5 * dots.diameter, _DOT, dots.color)
    if polygons.corners:
        renderer.AddActor(polygons.actor())
    table = _colors(drawing.limit)
    for strip in drawing.strips:
        renderer.AddActor(_strip(strip, table))
    for label in drawing.labels:
        renderer.AddViewProp(_text(label))
    picture = io.BytesIO()
    Image.fromarray(_pixels(renderer, drawing.size)[0]).save(picture, "PNG")
    return picture.getvalue()


def try_window() -> str:
    """Draw a red square and check the colour of its middle; return the name of VTK's window, or "blank".

    Some drivers report no error and draw nothing.
    """
    renderer = vtkRenderer()
    polygons = _Polygons()
    polygons.add(np.array([[[8.0, 8.0], [24.0, 8.0], [24.0, 24.0], [8.0, 24.0]]]), _PATCH, "#ff0000")
    renderer.AddActor(polygons.actor())
    pixels, name = _pixels(renderer, (32, 32))
    red, green, blue = pixels[16, 16]
    return name if red > 200 and green < 60 and blue < 60 else "blank"


def _pixels(renderer: Any, size: tuple[int, int]) -> tuple[Bytes, str]:
    """Return colours of pixels, shape (height, width, 3), and the name of the window that drew them."""
    width, height = size
    # Shapes are drawn larger than the picture and reduced, which makes their edges smooth.
    smooth = vtkmodules.vtkRenderingOpenGL2.vtkSSAAPass()
    smooth.SetDelegatePass(vtkmodules.vtkRenderingOpenGL2.vtkRenderStepsPass())
    renderer.SetPass(smooth)
    # World coordinates are pixels.
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(0.5 * width, 0.5 * height, 0.0)
    camera.SetPosition(0.5 * width, 0.5 * height, 100.0)
    camera.SetViewUp(0.0, 1.0, 0.0)
    camera.SetParallelScale(0.5 * height)
    camera.SetClippingRange(1.0, 200.0)
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(width, height)
    window.AddRenderer(renderer)
    try:
        window.Render()
        found = vtkUnsignedCharArray()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, found, 0)
        pixels = vtk_to_numpy(found).reshape(height, width, 3)[::-1].copy()
        return pixels, str(window.GetClassName())
    finally:
        window.Finalize()


class _Polygons:
    """Filled convex polygons, each in a colour of its own, gathered for one actor: VTK draws one large mesh faster."""

    def __init__(self) -> None:
        self.corners: list[Array] = []
        self._each: list[NDArray[np.int64]] = []
        self._colors: list[Bytes] = []

    def add(self, corners: Array, z: float, color: str) -> None:
        """Add polygons of k corners each, given as (n, k, 2)."""
        count, each = corners.shape[:2]
        self.corners.append(_raised(corners, z))
        self._each.append(np.full(count, each))
        self._colors.append(np.tile(_rgb(color), (count, 1)))

    def discs(self, centers: Array, radius: float, z: float, color: str) -> None:
        """Add filled circles: how OpenGL draws round points depends on the driver."""
        angle = np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
        rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.add(centers[:, None, :] + rim, z, color)

    def actor(self) -> Any:
        """Return the actor that a renderer draws."""
        mesh = _mesh(np.concatenate(self.corners), np.concatenate(self._each))
        mesh.GetCellData().SetScalars(numpy_to_vtk(np.concatenate(self._colors), deep=True))
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(mesh)
        mapper.SetColorModeToDirectScalars()
        return _unlit(mapper)


def _rgb(color: str) -> Bytes:
    """Return the channels of a colour "#rrggbb"."""
    return np.frombuffer(bytes.fromhex(color[1:]), dtype=np.uint8)


def _raised(corners: Array, z: float) -> Array:
    """Return corners of any shape (..., 2) as points (n, 3) at a height."""
    flat = corners.reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), z)])


def _mesh(points: Array, each: NDArray[np.int64]) -> Any:
    """Return polygons of so many points each, which follow each other."""
    places, cells, mesh = vtkPoints(), vtkCellArray(), vtkPolyData()
    places.SetData(numpy_to_vtk(points.astype(np.float32), deep=True))
    ends = np.concatenate([[0], np.cumsum(each)])
    cells.SetData(numpy_to_vtkIdTypeArray(ends, deep=True), numpy_to_vtkIdTypeArray(np.arange(len(points)), deep=True))
    mesh.SetPoints(places)
    mesh.SetPolys(cells)
    return mesh


def _unlit(mapper: Any) -> Any:
    """Return an actor that shows colours as they are."""
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    return actor


def _line(polygons: _Polygons, line: Line) -> None:
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
    polygons.add(corners, z, line.color)
    bends = np.sum(step[:-1] * step[1:], axis=1) < 0.98
    if np.any(bends):
        polygons.discs(end[:-1][bends], half, z, line.color)


def _colors(limit: float) -> Any:
    """Return the colours of values between -limit and limit."""
    table = vtkLookupTable()
    table.SetNumberOfTableValues(_SHADES)
    table.SetRange(-limit, limit)
    for k, color in enumerate(moment_colors(_SHADES)):
        red, green, blue = color.tolist()
        table.SetTableValue(k, red, green, blue, 1.0)
    return table


def _strip(strip: Strip, table: Any) -> Any:
    low, high = np.stack([strip.x, strip.low], axis=1), np.stack([strip.x, strip.high], axis=1)
    corners = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    mesh = _mesh(_raised(corners, _STRIP), np.full(len(corners), 4))
    values = strip.values
    at_corners = np.stack([values[:-1], values[1:], values[1:], values[:-1]], axis=1).ravel()
    mesh.GetPointData().SetScalars(numpy_to_vtk(at_corners, deep=True))
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    mapper.SetLookupTable(table)
    mapper.UseLookupTableScalarRangeOn()
    # Within a polygon values are interpolated, not colours.
    mapper.InterpolateScalarsBeforeMappingOn()
    return _unlit(mapper)


def _text(label: Label) -> Any:
    actor = vtkTextActor()
    actor.SetInput(label.text)
    actor.GetPositionCoordinate().SetCoordinateSystemToDisplay()
    actor.SetPosition(label.x, label.y)
    style = actor.GetTextProperty()
    style.SetFontFamilyToArial()
    style.SetFontSize(max(1, round(label.size)))
    style.SetColor(*(_rgb(label.color) / 255.0))
    style.SetBold(label.bold)
    {"left": style.SetJustificationToLeft, "center": style.SetJustificationToCentered}.get(
        label.align, style.SetJustificationToRight
    )()
    style.SetVerticalJustificationToCentered()
    return actor
