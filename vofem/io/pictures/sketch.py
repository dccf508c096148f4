"""The side view of a scene at one time, composed of plain shapes."""

from __future__ import annotations

import numpy as np

from vofem._validate import number
from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.effects import Joint
from vofem.io.pictures.drawing import BLOCK, GROUND, INK, MASS, OPEN_TEXT, OUTLINE, PAPER, SPRING, Drawing, Label, Strip
from vofem.io.pictures.layout import BAR, Lane, Layout, arrange, full_scale, picture_size, side_of_ground
from vofem.io.pictures.links import add_contact_forces, add_links, add_loads
from vofem.io.pictures.places import is_line
from vofem.io.pictures.snapshot import Snapshot
from vofem.io.pictures.units import length, nice_above, nice_below, prefixed, spell


def sketch(
    view: Snapshot, size: tuple[int, int], magnification: float | None, *, forces: bool = False, title: str = ""
) -> Drawing:
    """Return the picture of a scene.

    `size`: width and height in pixels.
    `magnification`: factor by which displacements are enlarged. By default it is chosen.
    `forces`: whether closed contacts are highlighted and arrows show their forces.
    `title`: text before the time.
    """
    size = picture_size(size)
    if magnification is not None:
        magnification = number("a picture's magnification", magnification, positive=True)
    layout = arrange(view, size, magnification)
    drawing = Drawing(size)
    _title(drawing, view, layout, title)
    beams = [lane for lane in layout.lanes.values() if isinstance(lane.state.body, Beam)]
    factor = 1.0
    if view.bending:
        factor = _color_bar(drawing, view)
        _diagrams(drawing, layout, beams[::-1], factor)
    for index, lane in enumerate(layout.lanes.values()):
        _ground(drawing, layout, lane)
        if isinstance(lane.state.body, Beam):
            _beam(drawing, layout, lane, lane.state.body, factor)
        elif is_line(lane.state.body):
            _line(drawing, layout, lane)
        else:
            _mass(drawing, layout, lane, side_of_ground(index, len(layout.lanes)))
    add_links(drawing, view, layout)
    for point in view.weights:
        drawing.dot(*layout.seen(point), BLOCK, 1.3 * layout.lanes[point.body].half)
    if forces:
        add_contact_forces(drawing, view, layout)
    add_loads(drawing, view, layout)
    for joint in view.joints:
        _joint(drawing, layout, joint)
    if layout.magnification is None and not view.title:
        _scale_of_motion(drawing, layout)
    return drawing


def _title(drawing: Drawing, view: Snapshot, layout: Layout, before: str) -> None:
    full = full_scale(drawing.size)
    parts = [before] if before else []
    t = view.time
    # A time to a millisecond, or finer if it is short.
    shown = "equilibrium" if t is None else f"t = {t:.3f} s" if t >= 0.1 or t == 0.0 else f"t = {spell(t, 's')}"
    parts.append(view.title or shown)
    # The size of a mode shape is arbitrary.
    labelled = [] if view.title else sorted(view.bodies, key=lambda s: -float(np.max(np.abs(s.eta))))[:3]
    for state in labelled:
        place, value = _labelled_place(state.body, state.x, state.eta)
        name, number = state.body.name if len(view.bodies) > 1 else "", spell(value, "m")
        words = (name, place, number) if place == "tip" else (name, number, place)
        parts.append(" ".join(word for word in words if word))
    text = "    ".join(parts)
    if layout.magnification is not None and not view.title:
        text += f"    (motion shown x{layout.magnification:g})"
    fitting = min(27.0 * full, 0.96 * drawing.size[0] / (0.56 * len(text)))
    drawing.labels.append(Label(0.5 * drawing.size[0], drawing.size[1] - 34.0 * full, text, INK, fitting, "center"))


def _labelled_place(body: object, x: Array, eta: Array) -> tuple[str, float]:
    """Return a place and its displacement: a free tip, or where the beam is deflected most."""
    if isinstance(body, Beam):
        free = [k for node, k in ((len(body.nodes) - 1, -1), (0, 0)) if node not in body.supports]
        if len(free) == 1:
            return "tip", float(eta[free[0]])
    k = int(np.argmax(np.abs(eta)))
    return f"at x = {x[k]:.3g} m" if x.size > 1 else "", float(eta[k])


def _color_bar(drawing: Drawing, view: Snapshot) -> float:
    """Add the scale of bending moments; return the factor of its unit."""
    full = full_scale(drawing.size)
    largest = max(max(state.moment_high, -state.moment_low) for state in view.bodies)
    limit = nice_above(largest)
    factor, unit = prefixed(limit, "N·m")
    drawing.limit = limit / factor
    x = np.linspace(0.29, 0.71, 129) * drawing.size[0]
    values = np.linspace(-drawing.limit, drawing.limit, x.size)
    low, high = np.full(x.size, 20.0 * full), np.full(x.size, 40.0 * full)
    drawing.strips.append(Strip(x, low, high, values))
    for k in (0, 32, 64, 96, 128):
        drawing.labels.append(Label(float(x[k]), 54.0 * full, f"{values[k]:g}", INK, 19.0 * full, "center"))
    title = f"bending moment M [{unit}]"
    drawing.labels.append(Label(0.5 * drawing.size[0], 79.0 * full, title, INK, 21.0 * full, "center"))
    return factor


def _diagrams(drawing: Drawing, layout: Layout, beams: list[Lane], factor: float) -> None:
    """Add the moment diagrams, on the side of the beam that is in tension, all in one scale."""
    full = full_scale(drawing.size)
    room = (layout.diagrams - 12.0 * full) / len(beams)
    inner = room * (1.0 if len(beams) == 1 else 0.86)
    ranges = [lane.state.moment_high - lane.state.moment_low for lane in beams]
    scale = 0.94 * inner / max(*ranges, 1e-300)
    for row, lane in enumerate(beams):
        state = lane.state
        x = layout.along(state.body, state.x)
        used = (state.moment_high - state.moment_low) * scale
        # A moment that is positive stretches the lower side.
        base = layout.top - row * room - 0.5 * (inner - used) + state.moment_low * scale
        curve = base - state.moment * scale
        drawing.strips.append(Strip(x, np.full(x.size, base), curve, state.moment / factor))
        drawing.line(x[[0, -1]], base, OUTLINE, 1.2)
        drawing.line(x, curve, INK, 1.6)
        name, height = ("M", 19.0) if len(beams) == 1 else (f"M {state.body.name}", 17.0)
        _name(drawing, name, float(x[0]) - 20.0 * full, base, height * full)


def _name(drawing: Drawing, name: str, x: float, y: float, size: float) -> None:
    most = max(4, int((x - 4.0) / (0.58 * size)))
    text = name if len(name) <= most else name[: most - 1] + "…"
    drawing.labels.append(Label(x, y, text, OPEN_TEXT, size, "right"))


def _ground(drawing: Drawing, layout: Layout, lane: Lane) -> None:
    bar, body = BAR * layout.unit, lane.state.body
    first, last = body.shape.x[0], body.shape.x[-1]
    margin = (38.0 if is_line(body) else 120.0) * layout.unit
    ends = float(layout.along(body, first)) - margin, float(layout.along(body, last)) + margin
    if lane.floor is not None:
        drawing.rectangle(ends, (lane.floor - bar, lane.floor), GROUND)
    if lane.ceiling is not None:
        drawing.rectangle(ends, (lane.ceiling, lane.ceiling + bar), GROUND)


def _beam(drawing: Drawing, layout: Layout, lane: Lane, beam: Beam, factor: float) -> None:
    state, unit = lane.state, layout.unit
    x, half = layout.along(beam, state.x), lane.half * state.depth
    y = lane.axis + state.eta * layout.motion
    for side in (-1.0, 1.0):
        drawing.line(x, lane.axis + side * half, OUTLINE, 1.6, behind=True)
        drawing.line(x, y + side * half, INK, 2.2)
    for end in (0, -1):
        drawing.line(x[[end, end]], [y[end] - half[end], y[end] + half[end]], INK, 2.2)
    drawing.strips.append(Strip(x, y - half, y + half, state.moment / factor))
    nodes = layout.along(beam, beam.nodes)
    if (nodes[-1] - nodes[0]) / beam.element_lengths.size >= 9.0 * unit:
        for place in nodes.tolist():
            drawing.dot(place, float(np.interp(place, x, y)), INK, 7.0 * unit)
    last = len(beam.nodes) - 1
    span = (lane.axis + state.low * layout.motion, lane.axis + state.high * layout.motion)
    for node, kind in beam.supports.items():
        place, depth = float(nodes[node]), float(np.interp(nodes[node], x, half))
        facing = 1 if node == 0 else -1 if node == last else 0
        if kind == "clamped":
            drawing.clamp(place, lane.axis, depth, unit, facing)
        elif kind == "pinned":
            drawing.pin(place, lane.axis, depth, unit)
        else:
            drawing.guide(place, float(np.interp(place, x, y)), depth, span, unit, -facing)
    if len(layout.lanes) > 1:
        _name(drawing, beam.name, float(x[0]) - 52.0 * unit, lane.axis, 20.0 * layout.text)


def _line(drawing: Drawing, layout: Layout, lane: Lane) -> None:
    """Add a line that is no beam: its outline at rest, and its edges and places as they have moved."""
    state, unit = lane.state, layout.unit
    across, along = (state.body.shape.direction[k] * state.eta * layout.motion for k in (1, 0))
    rest, x, y = layout.along(state.body, state.x), layout.along(state.body, state.x) + along, lane.axis + across
    half = 0.6 * lane.half
    for side in (-half, half):
        drawing.line(rest, np.full(x.size, lane.axis + side), OUTLINE, 1.6, behind=True)
        drawing.line(x, y + side, INK, 2.2)
    # Cross sections show the motion along the line.
    for k in range(x.size) if np.ptp(x) / x.size >= 4.0 * unit else (0, -1):
        drawing.line(x[[k, k]], [y[k] - half, y[k] + half], INK, 2.2 if k in (0, x.size - 1, -1) else 1.0)
    held = {float(place) for place in state.body.degrees_of_freedom.x[state.body.matrices().supported]}
    for place in held - {float("nan")}:
        facing = 1 if place == state.x[0] else -1 if place == state.x[-1] else 0
        drawing.clamp(float(layout.along(state.body, place)), lane.axis, half, unit, facing)
    if len(layout.lanes) > 1:
        _name(drawing, state.body.name, float(rest[0]) - 52.0 * unit, lane.axis, 20.0 * layout.text)


def _joint(drawing: Drawing, layout: Layout, joint: Joint) -> None:
    """Add a joint: a ring in the axis for a hinge, a disc for a rigid one, and a bar between two rows."""
    ends = [layout.seen(point) for point in joint.points()]
    if layout.lanes[joint.a.body].axis != layout.lanes[joint.b.body].axis:
        drawing.line([x for x, _ in ends], [y for _, y in ends], BLOCK, 5.0 * layout.unit)
    for x, y in ends:
        drawing.dot(x, y, INK, 20.0 * layout.unit)
        if joint.kind == "hinge":
            drawing.dot(x, y, PAPER, 12.0 * layout.unit)


def _mass(drawing: Drawing, layout: Layout, lane: Lane, side: str) -> None:
    unit, half = layout.unit, lane.half
    x = float(layout.along(lane.state.body, 0.0))
    y = lane.axis + float(lane.state.eta[0]) * layout.motion
    corners_x = x + 1.3 * half * np.array([-1, 1, 1, -1, -1])
    drawing.line(corners_x, lane.axis + half * np.array([-1, -1, 1, 1, -1]), OUTLINE, 1.6, behind=True)
    drawing.rectangle((x - 1.3 * half, x + 1.3 * half), (y - half, y + half), MASS)
    drawing.line(corners_x, y + half * np.array([-1, -1, 1, 1, -1]), INK, 2.2)
    name = getattr(lane.state.body, "name", "")
    drawing.labels.append(Label(x - 1.3 * half - 14.0 * unit, y, name, INK, 21.0 * layout.text, "right", bold=True))
    if not getattr(lane.state.body, "stiffness", 0.0) or side != "aside":
        return
    # Between two others there is no ground to stand on: an arm leads to a ledge beside them.
    arm, ledge = x + 1.3 * half + 150.0 * unit, lane.axis + lane.state.low * layout.motion - 62.0 * unit
    drawing.line([x + 1.3 * half, arm], y, BLOCK, 4.0 * unit, behind=True)
    drawing.element((arm, y), (arm, ledge), 14.0 * unit, SPRING, 3.4 * unit)
    drawing.rectangle((arm - 40.0 * unit, arm + 40.0 * unit), (ledge - 0.5 * BAR * unit, ledge), GROUND)


def _scale_of_motion(drawing: Drawing, layout: Layout) -> None:
    """Add a scale of displacement, because a scene of masses has no length for comparison."""
    size = nice_below(120.0 * layout.unit / layout.motion)
    x, low = 60.0 * layout.unit, 60.0 * layout.unit
    high = low + size * layout.motion
    drawing.line([x, x], [low, high], INK, 2.2)
    for y in (low, high):
        drawing.line([x - 8.0 * layout.unit, x + 8.0 * layout.unit], [y, y], INK, 2.2)
    factor, unit = length(size)
    text = f"{size / factor:g} {unit}"
    drawing.labels.append(Label(x + 18.0 * layout.unit, 0.5 * (low + high), text, INK, 21.0 * layout.text))
