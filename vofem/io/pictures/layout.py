"""The layout of a picture: bodies lie in lanes one above the other, with one scale along them and one for the motion.

In a contact between two bodies `a` closes upward on `b`, so the lane of b is above that of a. The spring between them
becomes shorter as the contact closes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.bodies.base import Body, Point
from vofem.errors import ArgumentError
from vofem.io.pictures.places import is_line, linked
from vofem.io.pictures.snapshot import BodyState, Link, Snapshot
from vofem.io.pictures.units import nice_below

#: Lengths in pixels of a picture of 1600 x 700; all are scaled together.
BEAM_HALF, MASS_HALF, BAR, SPRING_ROOM, PAD, MOTION = 26.0, 34.0, 18.0, 74.0, 10.0, 170.0
HEADER, SCALE_BAND, DIAGRAMS, SIDES = 74.0, 112.0, 150.0, (190.0, 210.0)

#: Factor by which bodies shrink at most; more bodies than fit then cannot be shown clearly.
_SMALLEST = 0.1

#: Fewest and most pixels of a picture in each direction.
_FEWEST, _MOST = 200, 8000


def picture_size(size: Any) -> tuple[int, int]:
    """Return width and height of a picture in pixels; raise `ArgumentError` where it cannot have that size."""
    try:
        width, height = (int(side) for side in size)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"a picture's size is {size!r}, expected (width, height) in pixels") from None
    if not (_FEWEST <= width <= _MOST and _FEWEST <= height <= _MOST):
        raise ArgumentError(f"a picture's size is {size!r}, expected {_FEWEST} to {_MOST} pixels each way")
    return width, height


def full_scale(size: tuple[int, int]) -> float:
    """Return the pixels of a picture per pixel of one of 1600 x 700."""
    return min(size[0] / 1600.0, size[1] / 700.0)


def moves_across(body: Body) -> bool:
    """Return whether a body is displaced upward, and not along the picture."""
    return body.shape.direction[1] != 0.0


@dataclass(frozen=True)
class Lane:
    """The place of a body."""

    state: BodyState
    axis: float  #: Height of the undeflected axis, pixels.
    half: float  #: Half the largest depth, pixels.
    shift: float  #: Distance in m by which the body is moved along the picture.
    #: `floor`, `ceiling`: height at which the ground of its springs begins, pixels.
    floor: float | None
    ceiling: float | None


@dataclass(frozen=True)
class Layout:
    """The places of all bodies."""

    size: tuple[int, int]
    lanes: dict[Body, Lane]  #: The lanes from the lowest to the highest.
    unit: float  #: Pixels of this picture per pixel of a picture of 1600 x 700.
    motion: float  #: Pixels per metre of displacement.
    magnification: float | None  #: Magnification of displacements over lengths; None if the scene has no length.
    #: `top`, `diagrams`: upper end and height of the moment diagrams, pixels.
    top: float
    diagrams: float
    _start: float
    _scale: float

    @property
    def text(self) -> float:
        """Pixels per pixel of text: text shrinks less than shapes, to stay readable."""
        return max(self.unit, 0.75 * full_scale(self.size))

    def along(self, body: Body, x: float | Array) -> Array:
        """Return the pixels of the x of a body."""
        return np.asarray(SIDES[0] * self.size[0] / 1600.0 + (x + self.lanes[body].shift - self._start) * self._scale)

    def face(self, point: Point, side: float, x: float | None = None) -> tuple[float, float]:
        """Return the heights of the upper (1) or lower (-1) face of a body, or of its axis (0), at rest and now.

        They are those at a point, or at x in pixels beside it: a shape there follows the curve that is drawn.
        """
        lane = self.lanes[point.body]
        state, along = lane.state, self.along(point.body, lane.state.x)
        x = float(self.along(point.body, point.x)) if x is None else x
        rest = lane.axis + side * lane.half * float(np.interp(x, along, state.depth))
        return rest, rest + float(np.interp(x, along, state.eta)) * point.body.shape.direction[1] * self.motion

    def seen(self, point: Point, side: float = 0.0) -> tuple[float, float]:
        """Return where a point is seen, on the axis (0), the upper (1) or the lower (-1) face of its body."""
        state = self.lanes[point.body].state
        aside = float(np.interp(point.x, state.x, state.eta)) * point.body.shape.direction[0] * self.motion
        return float(self.along(point.body, point.x)) + aside, self.face(point, side)[1]


@dataclass(frozen=True)
class _Needs:
    """Height that a body needs above or below its axis, in pixels.

    It is half the depth of the body, room for a spring and the ground, and the largest displacement times the scale.
    """

    body: Body
    half: float
    below: bool
    above: bool
    down: float
    up: float

    def extent(self, up: bool, motion: float, unit: float) -> float:
        ground = self.above if up else self.below
        room = (SPRING_ROOM + BAR if ground else PAD) * unit
        return self.half + (self.up if up else self.down) * motion + room


def side_of_ground(index: int, count: int) -> str:
    """Return where the ground spring of a mass is drawn: below the lowest mass, above the highest, beside others."""
    return "below" if index == 0 else "above" if index == count - 1 else "aside"


def arrange(view: Snapshot, size: tuple[int, int], magnification: float | None) -> Layout:
    """Return the places of all bodies, at the largest short magnification that fits."""
    order = _stack(view)
    beams = [body for body in order if is_line(body)]
    bending = view.bending
    shifts = _shifts(view)
    starts = [body.shape.x[0] + shifts[body] for body in order]
    ends = [body.shape.x[-1] + shifts[body] for body in order]
    width = size[0] * (1.0 - sum(SIDES) / 1600.0)
    start, span = min(starts), max(ends) - min(starts)
    if span == 0.0:  # masses only: a column in the middle of a picture one metre wide
        start, span = start - 0.5, 1.0
    scale = width / span
    full = full_scale(size)
    lower = (SCALE_BAND if beams and not view.title else 40.0) * full
    upper = size[1] - HEADER * full
    room = upper - lower - (DIAGRAMS * full if bending else 0.0)
    rows = _rows(view, order, shifts)
    unit, chosen = _choose(view, rows, room, full, scale, magnification)
    motion = chosen * scale
    needs = _needs(view, order, unit)
    heights, total = _heights(needs, rows, view, motion, unit)
    axes = [heights[rows[need.body]] for need in needs]
    left = max(0.0, room - total)
    # Room that is left goes to the moment diagrams first.
    extra = min(left, 0.4 * DIAGRAMS * full) if bending else 0.0
    lowest = lower + 0.5 * (left - extra)
    lanes = {}
    for need, axis in zip(needs, axes, strict=True):
        state = next(s for s in view.bodies if s.body is need.body)
        floor = axis - need.extent(False, motion, unit) + BAR * unit + lowest if need.below else None
        ceiling = axis + need.extent(True, motion, unit) - BAR * unit + lowest if need.above else None
        lanes[need.body] = Lane(state, lowest + axis, need.half, shifts[need.body], floor, ceiling)
    shown = chosen if beams else None
    return Layout(size, lanes, unit, motion, shown, upper, DIAGRAMS * full + extra, start, scale)


def _choose(
    view: Snapshot, rows: dict[Body, int], room: float, full: float, scale: float, wanted: float | None
) -> tuple[float, float]:
    """Return unit and magnification, at which all rows fit into a height of `room` pixels.

    The magnification is that which the user wants, or the largest 1, 2 or 5 times a power of ten at which bodies and
    motion fit if they shrink together. Bodies are then as large as fits beside this motion.
    """

    def height(unit: float, magnification: float) -> float:
        return _heights(_needs(view, list(rows), unit), rows, view, magnification * scale, unit)[1]

    size = scale * max(max(need.down, need.up) for need in _needs(view, list(rows), 1.0))
    if not wanted and size:
        free = MOTION * full / size
        wanted = nice_below(free * max(_SMALLEST, min(1.0, room / height(full, free))))
    chosen = wanted or 1.0
    low, high = height(0.0, chosen), height(full, chosen)
    # Heights are convex in the unit, so they are below the chord.
    return full if high <= room else full * max(_SMALLEST, (room - low) / (high - low)), chosen


def _pairs(view: Snapshot) -> list[tuple[Link, Body, Body]]:
    return [(link, link.a.body, link.b.body) for link in view.links if link.b is not None and not link.rotation]


def _stack(view: Snapshot) -> list[Body]:
    """Return the bodies from the lowest to the highest: a of each contact below its b, else the last one lowest."""
    left = [state.body for state in view.bodies]
    above: list[Body] = []
    pairs = _pairs(view)
    while left:
        # A body may come next from the top if it is below no other that is left; where contacts face both ways
        # none may, and the order of the scene decides.
        held = {id(a) for _, a, b in pairs if a is not b and b in left and a in left}
        chosen = next((body for body in left if id(body) not in held), left[0])
        left.remove(chosen)
        above.append(chosen)
    return above[::-1]


def _shifts(view: Snapshot) -> dict[Body, float]:
    """Return by how much each body is moved along, so that the first link between two bodies is upright."""
    bodies = [state.body for state in view.bodies]
    roots = [b for b in bodies if is_line(b)] + [b for b in bodies if not is_line(b)]
    first = roots[0]
    # Joints come first: bodies that are tied are drawn where they are tied.
    pairs = [(joint.a, joint.b) for joint in view.joints]
    pairs += [(link.a, link.b) for link in view.links if link.b is not None]
    # A mass that is not connected with a beam is drawn in the middle.
    middle = 0.5 * float(first.shape.x[0] + first.shape.x[-1])
    shifts: dict[Body, float] = {}
    for body, here, there, _ in linked(roots, pairs):
        alone = 0.0 if is_line(body) else middle
        shifts[body] = alone if here is None else shifts[here.body] + here.x - there.x
    return shifts


def _needs(view: Snapshot, order: list[Body], unit: float) -> list[_Needs]:
    needs = []
    for index, body in enumerate(order):
        state = next(s for s in view.bodies if s.body is body)
        stops = [link for link in view.links if link.b is None and link.a.body is body and not link.rotation]
        stops = stops if moves_across(body) else []
        sides = {link.side for link in stops}
        if getattr(body, "stiffness", 0.0):
            sides.add(side_of_ground(index, len(order)))
        # A gap far beyond the motion would leave no room for it.
        far = 3.0 * max(state.high, -state.low)
        gaps = {
            side: max((g.gap for g in stops if g.side == side and (g.gap <= far or not far)), default=0.0)
            for side in ("below", "above")
        }
        half, grounds = (BEAM_HALF if is_line(body) else MASS_HALF) * unit, ("below" in sides, "above" in sides)
        needs.append(_Needs(body, half, *grounds, max(-state.low, gaps["below"]), max(state.high, gaps["above"])))
    return needs


def _rows(view: Snapshot, order: list[Body], shifts: dict[Body, float]) -> dict[Body, int]:
    """Return the row of every body, from the lowest: beams that a joint ties end to end share one."""
    spans: dict[Body, tuple[float, float]] = {
        b: (b.shape.x[0] + shifts[b], b.shape.x[-1] + shifts[b]) for b in order if is_line(b)
    }
    tied = {frozenset((joint.a.body, joint.b.body)) for joint in view.joints}
    linked = {frozenset((a, b)) for _, a, b in _pairs(view)}
    rows: list[list[Body]] = []
    for body in order:
        for row in rows:
            pairs = [frozenset((body, other)) for other in row]
            if body not in spans or not any(pair in tied for pair in pairs) or any(pair in linked for pair in pairs):
                continue
            slack = 1e-9 * (spans[body][1] - spans[body][0])
            if all(spans[body][0] > spans[o][1] - slack or spans[body][1] < spans[o][0] + slack for o in row):
                row.append(body)
                break
        else:
            rows.append([body])
    return {body: number for number, row in enumerate(rows) for body in row}


def _merged(needs: list[_Needs]) -> _Needs:
    """Return the needs of bodies that share a row."""
    largest = (max(getattr(need, name) for need in needs) for name in ("half", "below", "above", "down", "up"))
    return _Needs(needs[0].body, *largest)


def _heights(
    needs: list[_Needs], rows: dict[Body, int], view: Snapshot, motion: float, unit: float
) -> tuple[list[float], float]:
    """Return the height of the axis of each row over the lower end of the lowest row, and the height of all."""
    merged = [_merged([need for need in needs if rows[need.body] == row]) for row in range(max(rows.values()) + 1)]
    axes = [merged[0].extent(False, motion, unit)]
    for row, (low, high) in enumerate(itertools.pairwise(merged)):
        apart = low.extent(True, motion, unit) + high.extent(False, motion, unit)
        gaps = [k.gap for k, a, b in _pairs(view) if {rows[a], rows[b]} == {row, row + 1}]
        if gaps:
            # The spring between them needs room both at its rest length and at its shortest.
            spring = max(
                0.6 * SPRING_ROOM * unit + (low.up + high.down) * motion, SPRING_ROOM * unit + max(gaps) * motion
            )
            apart = max(apart, low.half + high.half + spring)
        axes.append(axes[-1] + apart)
    return axes, axes[-1] + merged[-1].extent(True, motion, unit)
