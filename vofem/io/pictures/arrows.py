"""Arrows of a side view: loads, and the forces of closed contacts."""

from __future__ import annotations

import numpy as np

from vofem.io.pictures import shapes
from vofem.io.pictures.drawing import CLOSED, CLOSED_TEXT, Drawing, Label
from vofem.io.pictures.layout import Layout, full_scale, moves_across
from vofem.io.pictures.snapshot import Push, Snapshot
from vofem.io.pictures.units import spell

#: Length in pixels of the arrow of the largest force, and the shortest arrow that is drawn.
_LONG, _SHORT = 74.0, 5.0

#: Colour of loads, and of the highlight behind closed contacts.
LOAD, GLOW = "#2f6fae", "#ffec9e"

_UNITS = {"force": "N", "moment": "N·m", "line": "N/m"}


def add_loads(drawing: Drawing, view: Snapshot, layout: Layout) -> None:
    """Add the loads: an arrow for each force, an arc for each moment, a row of arrows for a load along a beam."""
    for push in view.pushes:
        if push.kind == "weight":
            _weight(drawing, layout, push)
        elif push.largest > 0.0 and push.kind == "moment":
            _moment(drawing, layout, push)
        elif push.largest > 0.0:
            bodies = {point.body for point in push.points}
            above = [k for k in view.links if (k.a.body in bodies and k.side == "above") or k.b is not None]
            taken = [layout.seen(p, 1.0)[0] for k in above for p in (k.a, k.b) if p is not None and p.body in bodies]
            _forces(drawing, layout, push, taken)


def add_contact_forces(drawing: Drawing, view: Snapshot, layout: Layout) -> None:
    """Highlight every closed contact, and add arrows for the forces with which it pushes bodies apart."""
    for link in view.links:
        if link.status not in ("closed", "pinned") or link.rotation or not moves_across(link.a.body):
            continue
        # Of two bodies a is pushed down and b up; a stop below pushes up.
        ends = [(link.a, 1.0 if link.side == "below" else -1.0)]
        if link.b is not None:
            lower_is_a = layout.lanes[link.a.body].axis < layout.lanes[link.b.body].axis
            ends = [(link.a, -1.0 if lower_is_a else 1.0), (link.b, 1.0 if lower_is_a else -1.0)]
        size = _LONG * layout.unit * abs(link.force) / view.peak if view.peak > 0.0 else 0.0
        for point, direction in ends:
            x, face = layout.seen(point, direction)
            _, touched = layout.seen(point, -direction)
            _glow(drawing, x, touched, 46.0 * layout.unit)
            if size >= _SHORT * layout.unit:
                way = direction * np.sign(link.force)
                # Beside the point, where a load may have its own arrow.
                beside = x - 22.0 * layout.unit
                shapes.arrow(drawing, (beside, face), (beside, face + way * size), layout.unit, CLOSED)


def _glow(drawing: Drawing, x: float, y: float, radius: float) -> None:
    """Add a disc of pale colour behind all else."""
    count = len(drawing.patches)
    shapes.disc(drawing, x, y, radius, GLOW)
    drawing.patches.insert(0, drawing.patches.pop(count))


def _forces(drawing: Drawing, layout: Layout, push: Push, taken: list[float]) -> None:
    """Add arrows on the upper face. Downward arrows end there, and upward arrows begin there."""
    unit = layout.unit
    tops = []
    for point, value in zip(push.points, push.values, strict=True):
        size = _LONG * unit * abs(float(value)) / push.largest
        x, y = layout.seen(point, 1.0)
        # Beside other shapes that stand on the same place.
        x -= 34.0 * unit if any(abs(other - x) < 30.0 * unit for other in taken) else 0.0
        if not moves_across(point.body):
            way = np.sign(value) * size
            start, end = (x, y + 14.0 * unit), (x + way, y + 14.0 * unit)
        else:
            start, end = ((x, y), (x, y + size)) if value > 0.0 else ((x, y + size), (x, y))
        if size >= _SHORT * unit:
            shapes.arrow(drawing, start, end, unit, LOAD)
        tops.append((max(start[0], end[0]), max(start[1], end[1])))
    k = int(np.argmax(np.abs(push.values)))
    x, y = tops[k]
    text = spell(float(push.values[k]), _UNITS[push.kind])
    size = 19.0 * layout.text
    places = [
        Label(x + 12.0 * unit, y - 0.3 * size, text, LOAD, size, "left", bold=True),
        Label(x - 12.0 * unit, y - 0.3 * size, text, LOAD, size, "right", bold=True),
        Label(x, y + 0.8 * size, text, LOAD, size, "center", bold=True),
    ]
    drawing.place(places[0], places[1:])


def _moment(drawing: Drawing, layout: Layout, push: Push) -> None:
    """Add an arc with a head, counter-clockwise where the moment is positive; it grows with the moment."""
    x, upper = layout.seen(push.points[0], 1.0)
    _, lower = layout.seen(push.points[0], -1.0)
    value, unit = float(push.values[0]), layout.unit
    share = value / push.largest
    y, radius = 0.5 * (upper + lower), 0.5 * (upper - lower) + 16.0 * unit
    if abs(share) > 0.03:
        angle = np.linspace(0.0, 1.5 * np.pi * abs(share), 40)
        angle = 0.5 * np.pi + (angle if share > 0.0 else -angle)
        px, py = x + radius * np.cos(angle), y + radius * np.sin(angle)
        drawing.line(px, py, LOAD, 3.4 * unit)
        shapes.arrow(drawing, (px[-2], py[-2]), (px[-1], py[-1]), unit, LOAD)
    size = 19.0 * layout.text
    drawing.place(Label(x, y + radius + size, spell(value, _UNITS["moment"]), LOAD, size, "center", bold=True), [])


def _weight(drawing: Drawing, layout: Layout, push: Push) -> None:
    """Add an arrow for the direction of gravity, in the upper left corner."""
    full = full_scale(drawing.size)
    g = float(push.values[0])
    x, low, high = 36.0 * full, drawing.size[1] - 92.0 * full, drawing.size[1] - 28.0 * full
    start, end = ((x, high), (x, low)) if g > 0.0 else ((x, low), (x, high))
    if g:
        shapes.arrow(drawing, start, end, full, LOAD)
        text = f"g = {abs(g):g} m/s²"
        drawing.place(Label(x + 14.0 * full, 0.5 * (low + high), text, LOAD, 18.0 * full, "left"), [])


def add_gap(drawing: Drawing, layout: Layout, x: float, low: float, high: float, gap: float) -> None:
    """Add the dimension of a gap at x: a line from the face of the body to the stop, and its size beyond the stop."""
    unit = layout.unit
    drawing.line([x, x], [low, high], CLOSED_TEXT, 1.6 * unit)
    for y in (low, high):
        drawing.line([x - 7.0 * unit, x + 7.0 * unit], [y, y], CLOSED_TEXT, 1.6 * unit)
    size, text = 18.0 * layout.text, f"gap {spell(gap, 'm')}"
    # Beyond the surface of the stop, where the body comes last.
    beyond = high + (0.9 * size if high > low else -0.9 * size)
    drawing.place(
        Label(x + 7.0 * unit, beyond, text, CLOSED_TEXT, size, "right"),
        [Label(x - 11.0 * unit, 0.5 * (low + high), text, CLOSED_TEXT, size, "right")],
    )
