"""The end of a branch of orbits over several periods: an orbit that repeats earlier."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import Interval, Point, corrected
from vofem.studies.steady.shooting import Shooting


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


def at_flip(family: Family, point: Point, interval: Interval) -> Point:
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
    scales = np.append(point.scales[: guess.size], interval.size)
    fixed = np.append(np.zeros(guess.size), 1.0)

    def distance(value: float) -> float:
        nonlocal guess
        y, evaluation, _ = corrected(half, single, np.append(guess, value), scales, fixed, np.zeros(guess.size), 12)
        guess = y[:-1]
        multipliers = np.asarray(evaluation.multipliers)
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
    doubled, y = single.doubled(guess)
    problem = family.at(there)
    evaluation = doubled.evaluate(problem, y)
    scales = np.append(doubled.scales(problem, evaluation), interval.size)
    y = np.append(y, there)
    return Point(doubled, y, problem, evaluation, scales, np.zeros(y.size - 1), np.zeros_like(y))


def _later(point: Point, divisor: int) -> Array:
    """Return the difference of the states at a fraction of an orbit and at its begin, in scaled unknowns."""
    problem, chart = point.problem, point.chart
    phase = chart.anchor + chart.turn / divisor
    moved = chart.at_phase(problem, point.evaluation, phase) - point.y[: problem.size]
    return np.asarray(moved / point.scales[: problem.size])
