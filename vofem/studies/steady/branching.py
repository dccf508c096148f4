"""The direction of the other branch at a branch point.

There the matrix of the equations with respect to unknowns and parameter loses one rank more than along a branch. Its
null space is a plane, and second derivatives of the equations say which two directions in it are those of branches.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, in Applications of Bifurcation
Theory, Academic Press 1977, p. 359.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import Point

#: Step of the second differences, in scaled coordinates.
_DIFFERENCE = 1e-4


def other_direction(family: Family, point: Point, along: Array) -> Array:
    """Return the direction of the branch that crosses another one at a branch point.

    `point`: a point with its derivative with respect to the parameter.
    `along` (shape (n + 1,)): approximate direction of the known branch, in scaled coordinates.
    Returns the direction in scaled coordinates, of length 1.
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
