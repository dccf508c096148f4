"""Folds, branch points, period doublings and Neimark-Sacker points between two neighbours on a branch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.studies.steady.charts import ORIGIN, at_phase, sizes
from vofem.studies.steady.family import Family
from vofem.studies.steady.newton import solved
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at
from vofem.studies.steady.shooting import Shooting

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Evaluations of a test function in the search for its root, and the share of the step to which it is found.
_TRIES, _FINE = 60, 1e-13


@dataclass(frozen=True)
class Crossing:
    """A special point between two neighbours.

    Attributes
    ----------
    kind : str
        As of `SpecialPoint`; "shorter" for an orbit that repeats before its end, where a branch ends.
    point : Point
    share : float
        Of the way between the neighbours.
    """

    kind: str
    point: Point
    share: float


def crossings(family: Family, step: Any, interval: Interval) -> list[Crossing]:
    """Return the special points of a step in the order of the branch."""
    first, last = step.first, step.last
    tests: list[tuple[str, Callable[[Point], float]]] = []
    a, b = _multipliers(first), _multipliers(last)
    turned = first.tangent[-1] * last.tangent[-1] < 0.0
    shorter = _repeats(first, last)
    if shorter is not None:
        at = _root(family, step, interval, shorter)
        if at is not None:
            return [Crossing("shorter", _at_flip(family, at[0], interval), at[1])]
    if a is None or b is None:
        if turned:
            tests.append(("fold", lambda point: float(point.tangent[-1])))
    else:
        if _parity(a, 1.0) != _parity(b, 1.0):
            tests.append(("fold" if turned else "branch_point", _along(1.0, a, b)))
        elif turned:
            tests.append(("fold", lambda point: float(point.tangent[-1])))
        if _parity(a, -1.0) != _parity(b, -1.0):
            tests.append(("period_doubling", _along(-1.0, a, b)))
        if _pairs_outside(a) != _pairs_outside(b):
            tests.append(("neimark_sacker", _pair))
    found = []
    for kind, test in tests:
        at = _root(family, step, interval, test)
        if at is not None:
            found.append(Crossing(kind, *at))
    return sorted(found, key=lambda crossing: crossing.share)


def _repeats(first: Point, last: Point) -> Callable[[Point], float] | None:
    """Return the test function of orbits that repeat earlier than at their end, where two neighbours lie around one.

    Such an orbit is where a branch of subharmonics turns back on itself: beyond it there are the same orbits, a period
    of the loads later.
    """
    problem = first.problem
    if not isinstance(problem, Shooting) or problem.periods == 1:
        return None
    for divisor in range(2, problem.periods + 1):
        if problem.periods % divisor or any(divisor % k == 0 for k in range(2, divisor)):
            continue
        before, after = (_later(point, divisor) for point in (first, last))
        if before @ after < 0.0:
            towards = after - before
            return lambda point, divisor=divisor, towards=towards: float(_later(point, divisor) @ towards)  # type: ignore[misc]
    return None


def _at_flip(family: Family, point: Point, interval: Interval) -> Point:
    """Return the orbit at which a branch of doubled orbits ends: the flip of the orbits over half as many periods.

    There the equations of the doubled orbits have two solutions that cross, which spoils digits; those of the others
    have one.
    """
    problem = point.problem
    if problem.periods % 2:
        return point
    half = family.over(problem.periods // 2)
    half.work = family.work
    state = 0.5 * (at_phase(problem, point.evaluation.flow, 0.0)
                   + at_phase(problem, point.evaluation.flow, 0.5 * problem.duration))  # fmt: skip

    def distance(value: float) -> float:
        nonlocal state
        found = solved(half.at(value), state)
        state = found.unknowns
        multipliers = np.asarray(found.evaluation.multipliers)
        return float(np.prod((1.0 + multipliers) / np.maximum(1.0, np.abs(multipliers))).real)

    try:
        here, there = point.value, point.value + 1e-6 * interval.size
        at_here, at_there = distance(here), distance(there)
        for _ in range(10):
            if at_there == at_here or abs(there - here) <= 1e-15 * interval.size:
                break
            here, at_here, there = there, at_there, there - at_there * (there - here) / (at_there - at_here)
            if abs(there - point.value) > 1e-2 * interval.size:
                return point
            at_there = distance(there)
    except ConvergenceError:
        return point
    y = np.append(state, there)
    doubled = family.at(there)
    evaluation = ORIGIN.evaluate(doubled, state)
    scales = np.append(ORIGIN.scales(doubled, evaluation), interval.size)
    return Point(ORIGIN, y, doubled, evaluation, scales, np.zeros(state.size), np.zeros_like(y))


def _later(point: Point, divisor: int) -> Array:
    """Return the difference of the states at a fraction of an orbit and at its begin, in scaled unknowns."""
    problem, flow = point.problem, point.evaluation.flow
    n = problem.size // 2
    z, v = sizes(problem, flow)
    moved = at_phase(problem, flow, problem.duration / divisor) - at_phase(problem, flow, 0.0)
    return np.concatenate([moved[:n] / z, moved[n:] / v])


def _multipliers(point: Point) -> Complex | None:
    values = point.evaluation.multipliers
    return None if values is None else np.asarray(values)


def _real(values: Complex) -> NDArray[np.bool_]:
    return np.abs(values.imag) <= 1e-12 * np.maximum(np.abs(values), 1e-300)


def _parity(values: Complex, at: float) -> bool:
    """Return whether an odd number of real multipliers lies beyond 1, or beyond -1."""
    beyond = _real(values) & (values.real * at > 1.0)
    return bool(np.sum(beyond) % 2)


def _pairs_outside(values: Complex) -> int:
    return int(np.sum(~_real(values) & (np.abs(values) > 1.0))) // 2


def _along(at: float, *ends: Complex) -> Callable[[Point], float]:
    """Return the test function of a multiplier at 1 or -1: a product over all, cut to those that matter."""

    def test(point: Point) -> float:
        values = _multipliers(point)
        assert values is not None
        factors = 1.0 - at * values
        factors = factors / np.maximum(1.0, np.abs(values))
        return float(np.prod(factors).real)

    return test


def _pair(point: Point) -> float:
    """Return how far the complex pair that is nearest to the unit circle lies outside of it."""
    values = _multipliers(point)
    assert values is not None
    size = np.abs(values[~_real(values)])
    if not size.size:
        raise ConvergenceError("the pair has become real")
    return float(size[np.argmin(np.abs(size - 1.0))] - 1.0)


def between(family: Family, step: Any, share: float) -> tuple[Array, Any, Array]:
    """Return an orbit between two neighbours, at a share of the way along the line between them."""
    first, last = step.first, step.last
    scales = first.scales
    start, end = first.y / scales, last.y / scales
    secant = end - start
    length = float(np.linalg.norm(secant))
    # Hermite's cubic through both points with their tangents.
    one = first.tangent / max(first.tangent @ secant / length, 0.1)
    two = last.tangent * last.scales / scales
    two = two / max(two @ secant / length, 0.1)
    t = share
    guess = (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * length * one
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * length * two
    )
    normal = secant / length
    # On the plane at this share.
    guess = guess + normal * (normal @ (start + t * secant - guess))
    by_value = (1.0 - t) * first.by_value + t * last.by_value
    return corrected(family, first.chart, guess * scales, scales, normal, by_value)


def point_between(family: Family, step: Any, interval: Interval, share: float, *, tangent: bool = True) -> Point:
    """Return a point between two neighbours."""
    first = step.first
    y, evaluation, by_value = between(family, step, share)
    direction = first.tangent
    if tangent:
        by_value = derivative_by_value(family, interval, first.chart, y, evaluation)
        secant = (step.last.y - first.y) / first.scales
        direction = tangent_at(evaluation, by_value, first.scales, secant / np.linalg.norm(secant))
    return Point(first.chart, y, family.at(y[-1]), evaluation, first.scales, by_value, direction)


def _root(family: Family, step: Any, interval: Interval, test: Callable[[Point], float]) -> tuple[Point, float] | None:
    """Return where a test function changes its sign, by the Illinois form of the secant iteration."""
    try:
        low, high = 0.0, 1.0
        at_low, at_high = test(step.first), test(step.last)
        if not (np.isfinite(at_low) and np.isfinite(at_high)) or at_low * at_high > 0.0:
            return None
        best: tuple[Point, float] | None = None
        smallest = np.inf
        side = 0
        for _ in range(_TRIES):
            share = (low * at_high - high * at_low) / (at_high - at_low)
            if not low < share < high:
                share = 0.5 * (low + high)
            point = point_between(family, step, interval, share)
            value = test(point)
            if abs(value) < smallest:
                smallest, best = abs(value), (point, share)
            if value == 0.0 or high - low <= _FINE:
                break
            if (value > 0.0) == (at_high > 0.0):
                moved = abs(high - share)
                high, at_high = share, value
                # Illinois: the end that stays counts half.
                at_low = 0.5 * at_low if side == 1 else at_low
                side = 1
            else:
                moved = abs(share - low)
                low, at_low = share, value
                at_high = 0.5 * at_high if side == -1 else at_high
                side = -1
            if moved <= _FINE or abs(value) <= 1e-14:
                break
    except ConvergenceError:
        return None
    return best
