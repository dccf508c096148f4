"""The two branches that meet at a branch point.

There the matrix of the equations with respect to unknowns and parameter loses one rank more than along a branch. Its
null space is a plane, and second derivatives of the equations say which two directions in it are those of branches.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, in Applications of Bifurcation
Theory, Academic Press 1977, p. 359.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.studies.steady.between import Step
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at

Array = NDArray[np.float64]

#: Step of the second differences, in scaled coordinates.
_DIFFERENCE = 1e-4

#: Distances from the point, on both sides, at which the other branch is searched.
_ASIDE = (2e-2, 4e-3, 1e-3)


def other_direction(family: Family, point: Point, along: Array) -> Array:
    """Return the direction of the branch that crosses another one at a branch point.

    Parameters
    ----------
    family : Family
    point : Point
        A point with its derivative with respect to the parameter.
    along : ndarray, shape (n + 1,)
        Approximate direction of the known branch, in scaled coordinates.

    Returns
    -------
    ndarray, shape (n + 1,)
        The direction in scaled coordinates, of length 1.
    """
    n = point.y.size - 1
    matrix = np.concatenate([point.evaluation.jacobian, point.by_value[:, None]], axis=1)
    left, _, right = np.linalg.svd(matrix * point.scales / point.scales[:n, None])
    plane, normal = right[-2:], left[:, -1] / point.scales[:n]

    def bent(direction: Array) -> float:
        """Return the second derivative of the equations along a direction of the plane, on the left null vector."""
        ends = [point.y + sign * _DIFFERENCE * (direction @ plane) * point.scales for sign in (1.0, -1.0)]
        residuals = [point.chart.evaluate(family.of(y), y[:-1], derivative=False).residual for y in (*ends, point.y)]
        return float(normal @ (residuals[0] + residuals[1] - 2.0 * residuals[2]))

    first, second = bent(np.array([1.0, 0.0])), bent(np.array([0.0, 1.0]))
    mixed = 0.5 * (bent(np.array([1.0, 1.0])) - first - second)
    mine = plane @ along
    mine = mine / np.linalg.norm(mine)
    across = np.array([-mine[1], mine[0]])
    # Where the quadratic form vanishes: a x^2 + 2 b x y + c y^2 = 0 has two directions if it is indefinite.
    root = mixed**2 - first * second
    if root > 0.0:
        pull = mixed + np.copysign(np.sqrt(root), mixed)
        found = [np.array([-pull, first]), np.array([second, -pull])]
        found = [one / np.linalg.norm(one) for one in found]
        across = min(found, key=lambda one: abs(float(one @ mine)))
    return np.asarray(across @ plane)


def neighbours(family: Family, interval: Interval, point: Point, direction: Array) -> Step:
    """Return two orbits on both sides of a branch point, on the branch in a direction.

    Raises
    ------
    ConvergenceError
        If no such orbits are found.
    """
    failure: ConvergenceError | None = None
    for aside in _ASIDE:
        ends = []
        try:
            for sign in (-1.0, 1.0):
                guess = point.y + sign * aside * direction * point.scales
                y, evaluation, _ = corrected(family, point.chart, guess, point.scales, direction, point.by_value)
                by_value = derivative_by_value(family, interval, point.chart, y, evaluation)
                tangent = tangent_at(evaluation, by_value, point.scales, direction)
                ends.append(Point(point.chart, y, family.of(y), evaluation, point.scales, by_value, tangent))
        except ConvergenceError as error:
            failure = error
            continue
        return Step(*ends)
    assert failure is not None
    raise failure
