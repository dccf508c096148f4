"""Orbits between two neighbours on a branch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at

Array = NDArray[np.float64]

#: `Evaluation.error` that the orbits reach with which special points are located.
EXACT = 1e-14


@dataclass
class Step:
    """Two neighbours on a branch in the same coordinates.

    Attributes
    ----------
    first, last : Point
    """

    first: Point
    last: Point

    @property
    def secant(self) -> Array:
        """The difference of the two points, in the scaled coordinates of the first one."""
        return np.asarray((self.last.y - self.first.y) / self.first.scales)

    @property
    def length(self) -> float:
        """Distance of the two in scaled coordinates."""
        return float(np.linalg.norm(self.secant))


def between(family: Family, interval: Interval, step: Step, share: float) -> tuple[Array, Any, Array]:
    """Return an orbit between two neighbours, at a share of the way along the line between them."""
    first, last = step.first, step.last
    scales = first.scales
    start, end = first.y / scales, last.y / scales
    secant = end - start
    length = float(np.linalg.norm(secant))
    # Hermite's cubic through both points with their tangents.
    one = first.tangent / max(float(first.tangent @ secant) / length, 0.1)
    two = last.tangent * last.scales / scales
    two = two / max(float(two @ secant) / length, 0.1)
    t = share
    guess = (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * length * one
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * length * two
    )
    normal = secant / length
    # The orbit is found on the plane at this share.
    guess = guess + normal * (normal @ (start + t * secant - guess))
    by_value = (1.0 - t) * first.by_value + t * last.by_value
    common = family, first.chart, guess * scales, scales, normal
    try:
        return corrected(*common, by_value, tolerance=EXACT)
    except ConvergenceError:
        if first.chart.nodes(first.evaluation) is None:
            raise
    # Near a branch point the equations are nearly singular and need an exact derivative.
    problem = family.of(common[2])
    start = first.chart.evaluate(problem, common[2][:-1])
    by_value = derivative_by_value(family, interval, first.chart, common[2], start)
    return corrected(*common, by_value, 16, EXACT, improve=False)


def point_between(family: Family, step: Step, interval: Interval, share: float, *, tangent: bool = True) -> Point:
    """Return a point between two neighbours."""
    first = step.first
    y, evaluation, by_value = between(family, interval, step, share)
    direction = first.tangent
    if tangent:
        by_value = derivative_by_value(family, interval, first.chart, y, evaluation)
        secant = (step.last.y - first.y) / first.scales
        direction = tangent_at(evaluation, by_value, first.scales, secant / np.linalg.norm(secant))
    return Point(first.chart, y, family.of(y), evaluation, first.scales, by_value, direction)
