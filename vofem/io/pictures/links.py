"""Contacts, springs and loads of a side view, with arrows for forces."""

from __future__ import annotations

import numpy as np

from vofem.bodies.base import Body
from vofem.io.pictures.drawing import CLOSED, CLOSED_TEXT, GROUND, OPEN, OPEN_TEXT, SPRING, Drawing, Label
from vofem.io.pictures.layout import MASS_HALF, Layout, full_scale, moves_across, side_of_ground
from vofem.io.pictures.snapshot import Link, Push, Snapshot
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
            # A highlight behind all else.
            drawing.disc(x, touched, 46.0 * layout.unit, GLOW)
            drawing.patches.insert(0, drawing.patches.pop())
            if size >= _SHORT * layout.unit:
                way = direction * np.sign(link.force)
                # Beside the point, where a load may have its own arrow.
                beside = x - 22.0 * layout.unit
                drawing.arrow((beside, face), (beside, face + way * size), layout.unit, CLOSED)


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
            drawing.arrow(start, end, unit, LOAD)
        tops.append((max(start[0], end[0]), max(start[1], end[1]), y))
    k = int(np.argmax(np.abs(push.values)))
    x, y, face = tops[k]
    text = spell(float(push.values[k]), _UNITS[push.kind])
    size = 19.0 * layout.text
    # Above the face of the body, where the arrow is short.
    beside = max(y - 0.3 * size, face + 0.7 * size)
    drawing.place(
        Label(x + 12.0 * unit, beside, text, LOAD, size, "left", bold=True),
        Label(x - 12.0 * unit, beside, text, LOAD, size, "right", bold=True),
        Label(x, y + 0.8 * size, text, LOAD, size, "center", bold=True),
    )


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
        drawing.arrow((px[-2], py[-2]), (px[-1], py[-1]), unit, LOAD)
    size = 19.0 * layout.text
    drawing.place(Label(x, y + radius + size, spell(value, _UNITS["moment"]), LOAD, size, "center", bold=True))


def _weight(drawing: Drawing, layout: Layout, push: Push) -> None:
    """Add an arrow for the direction of gravity, in the upper left corner."""
    full = full_scale(drawing.size)
    g = float(push.values[0])
    x, low, high = 36.0 * full, drawing.size[1] - 92.0 * full, drawing.size[1] - 28.0 * full
    start, end = ((x, high), (x, low)) if g > 0.0 else ((x, low), (x, high))
    if g:
        drawing.arrow(start, end, full, LOAD)
        text = f"g = {abs(g):g} m/s²"
        beside = Label(x + 14.0 * full, 0.5 * (low + high), text, LOAD, 18.0 * full, "left")
        below = Label(x - 14.0 * full, low - 14.0 * full, text, LOAD, 18.0 * full, "left")
        drawing.place(beside, below)


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
        Label(x - 11.0 * unit, 0.5 * (low + high), text, CLOSED_TEXT, size, "right"),
    )


#: Length in pixels of a spring that is drawn as short as can be.
_SHORTEST = 40.0

#: Links that act at any distance.
_ALWAYS = ("spring", "damper")

#: Colours of links and of their labels by the status.
_COLORS = {
    "open": (OPEN, OPEN_TEXT),
    **dict.fromkeys(("closed", "pinned"), (CLOSED, CLOSED_TEXT)),
    **dict.fromkeys(_ALWAYS, (SPRING, SPRING)),
}

#: Largest number of stops whose gaps are dimensioned, and length of the shortest dimension in pixels.
_DIMENSIONS, _NARROW = 4, 12.0


#: The place along the picture of stops by their number among the links, and of ground springs by their mass, pixels.
Slots = dict[int | Body, float]


def add_links(drawing: Drawing, view: Snapshot, layout: Layout) -> None:
    """Add all contacts and springs, and the ground springs of masses."""
    slots, spacing = _slots(view, layout)
    half = float(np.clip(0.4 * spacing, 2.0 * layout.unit, 24.0 * layout.unit))
    wanted: list[tuple[Link, float, float, float]] = []
    for index, link in enumerate(view.links):
        lane = layout.lanes[link.a.body]
        if link.rotation:
            x, y = _rotation(drawing, layout, link)
        elif link.b is None and not moves_across(link.a.body):
            x, y = _stop_along(drawing, layout, link, half)
        elif link.b is not None:
            x, y = _between(drawing, layout, link, half)
        else:
            ground, face = (lane.ceiling, 1.0) if link.side == "above" else (lane.floor, -1.0)
            assert ground is not None
            x, y = _stop(drawing, layout, link, slots[index], ground, face, half)
        wanted.append((link, x, y, half))
    _ground_springs(drawing, layout, slots, half)
    _dimensions(drawing, view, layout, slots, half)
    _labels(drawing, layout, wanted)


def _slots(view: Snapshot, layout: Layout) -> tuple[Slots, float]:
    """Return the position of each stop along the picture, and the smallest spacing.

    Stops at one place stand side by side.
    """
    groups: dict[tuple[int, str], list[tuple[int | Body, float]]] = {}
    for i, (body, lane) in enumerate(layout.lanes.items()):
        side = side_of_ground(i, len(layout.lanes))
        if getattr(body, "stiffness", 0.0) and side != "aside":
            groups.setdefault((id(lane), side), []).append((body, float(layout.along(body, 0.0))))
    for index, link in enumerate(view.links):
        if link.b is None and not link.rotation and moves_across(link.a.body):
            at = float(layout.along(link.a.body, link.a.x))
            groups.setdefault((id(layout.lanes[link.a.body]), link.side), []).append((index, at))
    pitch = 60.0 * layout.unit
    slots: Slots = {}
    spacing = np.inf
    ends = {
        id(lane): tuple(float(layout.along(body, x)) for x in (lane.state.x[0], lane.state.x[-1]))
        for body, lane in layout.lanes.items()
    }
    for key, members in groups.items():
        members.sort(key=lambda m: m[1])
        places = [x for _, x in members]
        for x in sorted(set(np.round(places, 0))):
            same = [(index, at) for index, at in members if np.round(at, 0) == x]
            extent = 0.5 * (len(same) - 1) * pitch
            left, right = ends[key[0]]
            # At the end of a beam they stand beside each other under it, not beyond it.
            middle = float(np.clip(x, left + extent, right - extent)) if right - left > 2.0 * extent else x
            for k, (member, _) in enumerate(same):
                slots[member] = middle - extent + k * pitch
        used = np.sort([slots[index] for index, _ in members])
        spacing = min(spacing, float(np.min(np.diff(used), initial=np.inf)))
    return slots, spacing


def _connect(
    drawing: Drawing, layout: Layout, link: Link, foot: tuple[float, float], end: tuple[float, float],
    way: tuple[float, float], half: float, width: float,
) -> None:  # fmt: skip
    """Draw a link from its foot to its end; a stop has a pad at its foot, across the way to its end."""
    thick = 0.0 if link.status in _ALWAYS else 7.0 * layout.unit
    top = (foot[0] + thick * way[0], foot[1] + thick * way[1])
    color, kind = _COLORS[link.status][0], "damper" if link.status == "damper" else "spring"
    drawing.element(top, end, 0.7 * half, color, width, kind)
    if thick:
        x, y = half * abs(way[1]), half * abs(way[0])
        drawing.rectangle((foot[0] - x, top[0] + x), (foot[1] - y, top[1] + y), color)


def _width(layout: Layout, half: float) -> float:
    return max(1.5, min(4.6 * layout.unit, 0.25 * half))


def _stop(
    drawing: Drawing, layout: Layout, link: Link, x: float, ground: float, face: float, half: float
) -> tuple[float, float]:
    """Draw a stop or a spring to ground; return where its label goes."""
    rest, now = layout.face(link.a, face, x)
    pad = rest + face * link.gap * layout.motion if link.status == "open" else now
    # A gap far beyond the motion does not fit: its pad stays in the picture, near the ground.
    limit = ground - face * _SHORTEST * layout.unit
    pad = min(pad, limit) if face > 0 else max(pad, limit)
    _connect(drawing, layout, link, (x, pad), (x, ground), (0.0, face), half, _width(layout, half))
    drawing.taken.append((x - 0.7 * half, min(pad, ground), x + 0.7 * half, max(pad, ground)))
    return x, 0.5 * (pad + ground)


def _dimensions(drawing: Drawing, view: Snapshot, layout: Layout, slots: Slots, half: float) -> None:
    """Add the sizes of the gaps of open stops, where there are few of them and they are wide enough to be seen."""
    stops = [
        (slots[index], link)
        for index, link in enumerate(view.links)
        if index in slots and link.status == "open" and not _is_far(layout, link)
        and link.gap * layout.motion >= _NARROW * layout.unit
    ]  # fmt: skip
    if len(stops) > _DIMENSIONS:
        return
    for x, link in stops:
        face = 1.0 if link.side == "above" else -1.0
        rest = layout.face(link.a, face, x)[0]
        add_gap(drawing, layout, x - half - 12.0 * layout.unit, rest, rest + face * link.gap * layout.motion, link.gap)


def _rotation(drawing: Drawing, layout: Layout, link: Link) -> tuple[float, float]:
    """Draw a link on rotations as a spiral at point a, with a line to point b; return the place of its label."""
    points = [point for point in (link.a, link.b) if point is not None]
    ends = [(float(layout.along(point.body, point.x)), layout.face(point, 0.0)[1]) for point in points]
    color, width = _COLORS[link.status][0], 3.0 * layout.unit
    if len(ends) == 2:
        drawing.line([x for x, _ in ends], [y for _, y in ends], color, width)
    radius = 20.0 * layout.unit
    drawing.spiral(*ends[0], radius, color, width)
    drawing.taken.append((ends[0][0] - radius, ends[0][1] - radius, ends[0][0] + radius, ends[0][1] + radius))
    return ends[0]


def _stop_along(drawing: Drawing, layout: Layout, link: Link, half: float) -> tuple[float, float]:
    """Draw a stop or a spring to ground of a body that moves along its axis; return where its label goes."""
    lane, unit, (now, y) = layout.lanes[link.a.body], layout.unit, layout.seen(link.a)
    face = 1.0 if link.side == "above" else -1.0
    if link.status in _ALWAYS:  # its ground stands beyond the nearer end
        face = 1.0 if link.a.x > 0.5 * (lane.state.x[0] + lane.state.x[-1]) else -1.0
    free = float(layout.along(link.a.body, link.a.x)) + face * link.gap * layout.motion
    pad = free if link.status == "open" else now
    ground = max(free, pad, key=lambda x: face * x) + face * (_SHORTEST + 40.0) * unit
    drawing.rectangle((ground, ground + face * 18.0 * unit), (y - 50.0 * unit, y + 50.0 * unit), GROUND)
    _connect(drawing, layout, link, (pad, y), (ground, y), (face, 0.0), half, 3.0 * unit)
    # Beside the border of the picture a label has room over the body only.
    return pad - face * 80.0 * unit, y + 70.0 * unit


def _is_far(layout: Layout, link: Link) -> bool:
    """Return whether the gap of a stop is too large to be drawn to scale."""
    lane = layout.lanes[link.a.body]
    ground = lane.ceiling if link.side == "above" else lane.floor
    return ground is not None and link.gap * layout.motion > abs(ground - lane.axis) - _SHORTEST * layout.unit


def _between(drawing: Drawing, layout: Layout, link: Link, half: float) -> tuple[float, float]:
    """Draw a link between two bodies: it hangs under the upper one, with a pad that meets the lower one."""
    assert link.b is not None
    a_below = layout.lanes[link.a.body].axis < layout.lanes[link.b.body].axis
    lower, upper = (link.a, link.b) if a_below else (link.b, link.a)
    low, high = (float(layout.along(point.body, point.x)) for point in (lower, upper))
    (rest, at), (hung, top) = layout.face(lower, 1.0), layout.face(upper, -1.0)
    if link.status == "open" and a_below:
        # The spring keeps its length: the pad moves with the upper body.
        at = max(rest + link.gap * layout.motion + top - hung, at)
    _connect(drawing, layout, link, (low, at), (high, top), (0.0, 1.0), half, _width(layout, half))
    drawing.taken.append((low - 0.7 * half, min(at, top), low + 0.7 * half, max(at, top)))
    return 0.5 * (low + high), 0.5 * (at + top)


def _ground_springs(drawing: Drawing, layout: Layout, slots: Slots, half: float) -> None:
    for i, (body, lane) in enumerate(layout.lanes.items()):
        if body not in slots:
            continue
        x, y = slots[body], lane.axis + float(lane.state.eta[0]) * layout.motion
        hangs = side_of_ground(i, len(layout.lanes)) == "above"
        ground = lane.ceiling if hangs else lane.floor
        assert ground is not None
        face = MASS_HALF * layout.unit if hangs else -MASS_HALF * layout.unit
        drawing.element((x, y + face), (x, ground), 0.7 * half, SPRING, 4.0 * layout.unit)


def _labels(drawing: Drawing, layout: Layout, wanted: list[tuple[Link, float, float, float]]) -> None:
    """Write labels beside the links, the largest force first; links without room for a label are only counted."""
    unit, omitted = layout.unit, 0
    for link, x, y, half in sorted(wanted, key=lambda w: -abs(w[0].force)):
        if link.status in _ALWAYS:
            continue
        color = _COLORS[link.status][1]
        text = "open" if link.status == "open" else spell(link.force, "N·m" if link.rotation else "N")
        if link.status == "open" and link.b is None and _is_far(layout, link):
            text = f"open, gap {spell(link.gap, 'm')}"
        if link.status == "pinned":
            text = f"pinned, {text}"
        right = Label(x + 0.7 * half + 16.0 * unit, y, text, color, 21.0 * layout.text, "left", bold=True)
        left = Label(x - 0.7 * half - 16.0 * unit, y, text, color, 21.0 * layout.text, "right", bold=True)
        omitted += not drawing.place(right, left)
    contacts = [link for link, _, _, _ in wanted if link.status not in _ALWAYS]
    if omitted:
        active = [link.force for link in contacts if link.status != "open"]
        text = f"{len(active)} of {len(contacts)} contacts closed"
        full = full_scale(drawing.size)
        drawing.labels.append(
            Label(drawing.size[0] - 30.0 * full, 30.0 * full, text, CLOSED_TEXT, 21.0 * full, "right", bold=True)
        )
