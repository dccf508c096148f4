"""Orbits that just touch a contact, and the continuation of a branch beyond them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.tangent import acceleration
from vofem.studies.steady.charts import EventChart, OriginChart, around, at_phase, event_chart, sizes
from vofem.studies.steady.events import Phase, extremes, height_at, phases, switches
from vofem.studies.steady.family import Family
from vofem.studies.steady.newton import direction
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at
from vofem.studies.steady.shooting import Shooting
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Steps of Newton's method to a grazing, and the residual that is small enough.
_STEPS, _TOLERANCE = 12, 1e-13

#: Rate of the gap function, over the speed of the motion, of the orbit just beyond a grazing.
BEYOND = 1e-8

#: Relative difference of two contacts' distances from touching that may touch together, and the distance over the
#: size of the motion up to which they do.
_ALIKE, _TOGETHER = 0.2, 1e-9

#: Difference of phases, as a share of the orbit, up to which contacts that touch together do so at one time.
_AT_ONCE = 1e-3

#: Share of the time to the next event of a contact in which its events are ignored near a grazing.
_MARGIN, _MOST_MARGIN = 0.4, 0.25


@dataclass(frozen=True)
class Touch:
    """The place at which a grazing is searched.

    Attributes
    ----------
    problem : Shooting
    value : float
        Value of the parameter.
    contact : int
    time : float
        Time of the touch in s.
    state : ndarray, shape (2n,)
        State at that time, in unknowns.
    outside : ndarray of int, shape (n_contacts,)
        Contact status of the orbit that does not touch.
    margin : float
    also : tuple of (contact, phase)
        Other contacts that are equally near to touching, as in symmetric scenes.
    """

    problem: Shooting
    value: float
    contact: int
    time: float
    state: Array
    outside: Status
    margin: float
    also: tuple[tuple[int, float], ...] = ()


def touch_of_phase(point: Point, phase: Phase) -> Touch:
    """Return where a short phase of an orbit begins, as the place of a grazing."""
    flow, problem = point.evaluation.flow, point.problem
    middle = 0.5 * (phase.time + phase.stop)
    others = [t for t, contact, *_ in switches(point.chart, flow) if contact == phase.contact]
    others = [t for t in others if not _same(t, phase.time, problem) and not _same(t, phase.stop, problem)]
    outside = _status_at(problem, flow, middle)
    outside[phase.contact] = CLOSED if phase.status == OPEN else OPEN
    return Touch(
        problem, point.value, phase.contact, middle, at_phase(problem, flow, middle), outside,
        margin_around(problem, others, middle), phases_like(point, phase),
    )  # fmt: skip


def phases_like(point: Point, phase: Phase) -> tuple[tuple[int, float], ...]:
    """Return contacts with a phase as short as the given one, and the middles of these phases."""
    found = {}
    for other in phases(point.problem, point.chart, point.evaluation.flow):
        alike = abs(other.rate - phase.rate) <= _ALIKE * phase.rate and other.stop - other.time < other.earlier
        if alike and other.contact != phase.contact:
            found[other.contact] = 0.5 * (other.time + other.stop) * point.problem.loads.omega
    return tuple(found.items())


def touch_of_extreme(point: Point, contact: int, time: float, status: int) -> Touch:
    """Return where a gap function of an orbit is extreme, as the place of a grazing."""
    flow, problem = point.evaluation.flow, point.problem
    others = [t for t, other, *_ in switches(point.chart, flow) if other == contact]
    outside = _status_at(problem, flow, time)
    outside[contact] = status
    near = extremes(problem, flow)
    mine = min((e for e in near if e.contact == contact), key=lambda e: abs(e.time - time), default=None)
    also = {
        e.contact: e.time * problem.loads.omega
        for e in near
        if mine is not None and e.contact != contact and abs(e.size - mine.size) <= _ALIKE * mine.size + _TOGETHER
    }
    return Touch(
        problem, point.value, contact, time, at_phase(problem, flow, time), outside,
        margin_around(problem, others, time), tuple(also.items()),
    )  # fmt: skip


def _same(a: float, b: float, problem: Shooting) -> bool:
    return abs((a - b + 0.5 * problem.duration) % problem.duration - 0.5 * problem.duration) < 1e-9 * problem.duration


def _status_at(problem: Shooting, flow, time: float) -> Status:  # type: ignore[no-untyped-def]
    segments = flow.solution.segments
    inside = flow.start.time + (time - flow.start.time) % problem.duration
    k = max(int(np.searchsorted(segments.starts, inside, side="right")) - 1, 0)
    return segments.status[k].copy()


def margin_around(problem: Shooting, others: list[float], time: float) -> float:
    """Return the share of the orbit on each side of a time in which other events of a contact may be ignored."""
    duration = problem.duration
    away = [min((time - t) % duration, (t - time) % duration) for t in others]
    return min(_MARGIN * min(away, default=duration) / duration, _MOST_MARGIN)


def grazing(family: Family, interval: Interval, touch: Touch) -> Point:
    """Return the orbit that just touches a contact; its tangent is not set.

    Raises
    ------
    ConvergenceError
        If there is no grazing near.
    """
    problem = touch.problem
    inside = touch.outside.copy()
    turn = 2.0 * np.pi * problem.periods
    phase = problem.loads.omega * touch.time
    at_once = [j for j, other in touch.also if abs((other - phase + 0.5 * turn) % turn - 0.5 * turn) < _AT_ONCE * turn]
    for j in (touch.contact, *at_once):
        inside[j] = CLOSED if touch.outside[j] == OPEN else OPEN
    chart = event_chart(problem, touch.contact, touch.outside, inside, touch.margin, grazes=True)
    chart = replace(chart, also=touch.also)
    y = np.append(chart.coordinates(problem, touch.time, touch.state), touch.value)
    y[1] = 0.0
    best, last = np.inf, None
    for _ in range(_STEPS):
        problem = family.at(y[-1])  # type: ignore[assignment]
        now = chart.evaluate(problem, y[:-1])
        scales = np.append(chart.scales(problem, now), interval.size)
        if not np.isfinite(now.error) or now.error > 10.0 * max(best, 1.0):
            break
        if now.error <= _TOLERANCE or (best <= 1e-10 and now.error >= 0.5 * best):
            last = now
            break
        best = min(best, now.error)
        by_value = derivative_by_value(family, interval, chart, y, now)
        matrix = np.concatenate([now.jacobian, by_value[:, None]], axis=1) * scales
        kept = np.arange(y.size) != 1
        step = np.zeros_like(y)
        step[kept] = -direction(matrix[:, kept], now.residual)
        size = float(np.linalg.norm(step))
        y = y + step * scales * min(1.0, 0.3 / size if size > 0.0 else 1.0)
    if last is None:
        raise ConvergenceError("no grazing was found")
    if not _is_extreme(problem, chart, y[:-1]):
        raise ConvergenceError("the gap function passes zero there")
    omega = problem.loads.omega
    together = [
        abs(height_at(problem, last.flow, contact, phase / omega)) <= _TOGETHER for contact, phase in touch.also
    ]
    if not all(together):
        kept = tuple(one for one, yes in zip(touch.also, together, strict=True) if yes)
        return grazing(family, interval, replace(touch, also=kept))
    by_value = derivative_by_value(family, interval, chart, y, last)
    return Point(chart, y, problem, last, scales, by_value, np.zeros_like(y))


def _is_extreme(problem: Shooting, chart: EventChart, y: Array) -> bool:
    """Return whether the gap function turns back to the side where the contact keeps its status."""
    time, state = chart.point(problem, y)
    z, v = problem.to_modes(state)
    load = np.zeros(z.size)
    for vector, one in zip(problem.space.loads, problem.system.loads, strict=True):
        load += vector * float(one.function(time))
    a = acceleration(problem.space, problem.system.contacts, chart.before, z, v, load)
    return bool(float(problem.space.contacts[chart.contact] @ a) * chart.sign < 0.0)


def beyond(family: Family, interval: Interval, at: Point) -> Point:
    """Return the orbit just beyond a grazing, with the direction in which the rate of the gap function grows."""
    chart = replace(at.chart, grazes=False)
    _, v = sizes(at.problem, at.evaluation.flow)
    y = at.y.copy()
    y[1] = chart.sign * BEYOND * v
    normal = np.zeros_like(y)
    normal[1] = 1.0
    y, evaluation, by_value = corrected(family, chart, y, at.scales, normal, at.by_value)
    by_value = derivative_by_value(family, interval, chart, y, evaluation)
    tangent = tangent_at(evaluation, by_value, at.scales, normal * chart.sign)
    return Point(chart, y, family.at(y[-1]), evaluation, at.scales, by_value, tangent)


def before(family: Family, interval: Interval, at: Point) -> Point:
    """Return the grazing orbit in the coordinates of t = 0, not touching, with the direction towards the contact."""
    problem, chart = at.problem, at.chart
    phase = float(at.y[0])
    origin = OriginChart(around(((chart.contact, phase), *chart.also), chart.margin, problem.periods))
    y = np.append(at_phase(problem, at.evaluation.flow, 0.0), at.value)
    evaluation = origin.evaluate(problem, y[:-1])
    scales = np.append(origin.scales(problem, evaluation), interval.size)
    by_value = derivative_by_value(family, interval, origin, y, evaluation)
    guess = np.zeros_like(y)
    guess[-1] = 1.0
    tangent = tangent_at(evaluation, by_value, scales, guess)
    heights = []
    step = 1e-6
    for sign in (-1.0, 1.0):
        moved = y + sign * step * tangent * scales
        other: Shooting = family.at(moved[-1])  # type: ignore[assignment]
        flow = origin.evaluate(other, moved[:-1], derivative=False).flow
        time = phase / other.loads.omega
        z, _ = flow.solution.modal(np.array([flow.start.time + (time - flow.start.time) % other.duration]))
        laws = other.system.contacts
        assert laws is not None
        heights.append(float(other.space.contacts[chart.contact] @ z[:, 0] - laws.gap[chart.contact]))
    if (heights[1] - heights[0]) * chart.sign < 0.0:
        tangent = -tangent
    return Point(origin, y, problem, evaluation, scales, by_value, tangent)
