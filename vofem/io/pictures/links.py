"""Contacts and springs of a picture, with their forces."""

from __future__ import annotations

import numpy as np

from vofem.bodies.base import Body
from vofem.io.pictures import shapes
from vofem.io.pictures.arrows import add_gap
from vofem.io.pictures.drawing import CLOSED, CLOSED_TEXT, GROUND, OPEN, OPEN_TEXT, SPRING, Drawing, Label
from vofem.io.pictures.layout import MASS_HALF, Layout, full_scale, moves_across, side_of_ground
from vofem.io.pictures.snapshot import Link, Snapshot
from vofem.io.pictures.units import spell

#: Length in pixels of a spring that is drawn as short as can be.
_SHORTEST = 40.0

_COLORS = {
    "open": (OPEN, OPEN_TEXT),
    "closed": (CLOSED, CLOSED_TEXT),
    "pinned": (CLOSED, CLOSED_TEXT),
    "spring": (SPRING, SPRING),
    "damper": (SPRING, SPRING),
}


#: Links that act at any distance.
_ALWAYS = ("spring", "damper")

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
        elif link.side == "above":
            assert lane.ceiling is not None
            x, y = _stop(drawing, layout, link, slots[index], lane.ceiling, 1.0, half)
        else:
            assert lane.floor is not None
            x, y = _stop(drawing, layout, link, slots[index], lane.floor, -1.0, half)
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
    shapes.element(drawing, top, end, 0.7 * half, color, width, kind)
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
    shapes.spiral(drawing, *ends[0], radius, color, width)
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
        shapes.element(drawing, (x, y + face), (x, ground), 0.7 * half, SPRING, 4.0 * layout.unit)


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
        omitted += not drawing.place(right, [left])
    contacts = [link for link, _, _, _ in wanted if link.status not in _ALWAYS]
    if omitted:
        active = [link.force for link in contacts if link.status != "open"]
        text = f"{len(active)} of {len(contacts)} contacts closed"
        full = full_scale(drawing.size)
        drawing.labels.append(
            Label(drawing.size[0] - 30.0 * full, 30.0 * full, text, CLOSED_TEXT, 21.0 * full, "right", bold=True)
        )
