"""The end of a branch of orbits over several periods: an orbit that repeats earlier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.studies.steady.following.extended import Extended
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.point import Point, level, point_at
from vofem.studies.steady.segments.shooting import Shooting

#: How far a flip may lie from where the doubled orbits end, as a share of the interval.
_NEARBY = 1e-2


def repeats(first: Point, last: Point) -> Callable[[Point], float] | None:
    """Return the test function of orbits that repeat earlier than at their end, where two neighbours lie around one.

    At such an orbit a branch of subharmonics returns along itself: the orbits beyond it are the same ones, a period of
    the loads later.
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


def at_flip(family: Family, point: Point) -> Point:
    """Return the orbit at which a branch of doubled orbits ends: the flip of the orbits over half as many periods.

    There the equations of the doubled orbits have two solutions that cross, which spoils digits; those of the others
    have one.
    """
    problem, chart = point.problem, point.chart
    halved = chart.halved(point.y[:-1])
    if halved is None:
        return point
    half = family.over(problem.periods // 2)
    half.work = family.work
    single, guess = halved
    try:
        found = Extended(single, half, "period_doubling", family.interval.size).solved(np.append(guess, point.value))
    except ConvergenceError:
        return point
    guess, there = found[:-1], float(found[-1])
    if abs(there - point.value) > _NEARBY * family.interval.size:
        return point
    doubled, y = single.doubled(guess)
    return point_at(family, doubled, np.append(y, there), level(y.size + 1))


def _later(point: Point, divisor: int) -> Array:
    """Return the difference of the states at a fraction of an orbit and at its begin, in scaled unknowns."""
    problem, chart = point.problem, point.chart
    phase = chart.anchor + chart.turn / divisor
    moved = chart.at_phase(problem, point.evaluation, phase) - point.y[: problem.size]
    return np.asarray(moved / point.scales[: problem.size])
