"""Points of a branch: an orbit in some coordinates, the direction of the branch, and the correction of a guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.studies.steady.family import Family
from vofem.studies.steady.newton import ROUNDING, direction
from vofem.studies.steady.orbit import PeriodicOrbit

#: `Evaluation.error` at which a point counts as solved; Newton's last step makes it smaller still.
TOLERANCE = 1e-12

#: Steps of Newton's method at a point, and by how much the residual may grow in the first of them.
_STEPS, _GROWTH = 8, 10.0

#: Step of the parameter by which derivatives are taken, in terms of the interval and of the value.
_DIFFERENCE, _LEAST = 1e-8, 1e-9

#: Factor by which the residual falls in a step at least where the derivative with respect to the parameter is good.
_SLOW = 0.02

#: Number of switches above which derivatives are taken along known states at the switches, so that changes do not grow.
_MANY = 16

#: Change of the parameter, as a share of a step, above which it is used to compute the derivative.
_TELLING = 1e-2


@dataclass(frozen=True)
class OriginChart:
    """The unknowns of the problem as coordinates."""

    #: Whether orbits are divided into segments, whose switches are watched.
    segmented = False

    def evaluate(self, problem: Any, y: Array, *, derivative: bool = True, nodes: None = None) -> Any:
        """Return the equations."""
        return problem.evaluate(y, derivative=derivative)

    def nodes(self, evaluation: Any, moved: Array | None = None) -> None:
        """Return nothing: an orbit is not divided into segments."""
        return

    def scales(self, problem: Any, evaluation: Any) -> Array:
        """Return sizes of the unknowns: those of the motion."""
        return np.asarray(problem.scales * max(evaluation.size, np.finfo(float).tiny))

    def unknowns(self, problem: Any, y: Array, evaluation: Any) -> Array:
        """Return the unknowns."""
        return y

    def orbit(self, problem: Any, y: Array, evaluation: Any) -> PeriodicOrbit:
        """Return the orbit."""
        orbit: PeriodicOrbit = problem.orbit(y, evaluation)
        return orbit


ORIGIN = OriginChart()


@dataclass
class Point:
    """An orbit of a branch.

    Coordinates Y are those of the chart and, last, the parameter.

    Attributes
    ----------
    chart : OriginChart or Signature
    y : ndarray, shape (n + 1,)
    problem : OrbitProblem
    evaluation : Evaluation
    scales : ndarray, shape (n + 1,)
    by_value : ndarray, shape (n,)
        Derivative of the residual with respect to the parameter.
    tangent : ndarray, shape (n + 1,)
        Direction of the branch in scaled coordinates, of length 1.
    """

    chart: Any
    y: Array
    problem: Any
    evaluation: Any
    scales: Array
    by_value: Array
    tangent: Array

    @property
    def value(self) -> float:
        """Value of the parameter."""
        return float(self.y[-1])

    def orbit(self) -> PeriodicOrbit:
        """Return the orbit."""
        orbit: PeriodicOrbit = self.chart.orbit(self.problem, self.y[:-1], self.evaluation)
        return orbit

    def unknowns(self) -> Array:
        """Return the unknowns of the problem."""
        return np.asarray(self.chart.unknowns(self.problem, self.y[:-1], self.evaluation))


@dataclass(frozen=True)
class Interval:
    """The interval of the parameter."""

    start: float
    stop: float

    @property
    def size(self) -> float:
        """Length of the interval."""
        return abs(self.stop - self.start)

    def beyond(self, value: float) -> float | None:
        """Return the end that a value lies beyond, or None."""
        low, high = min(self.start, self.stop), max(self.start, self.stop)
        return low if value < low else high if value > high else None


def derivative_by_value(family: Family, interval: Interval, chart: Any, y: Array, evaluation: Any) -> Array:
    """Return the derivative of the residual with respect to the parameter, by a difference, shape (n,).

    It gives directions of branches. Where a branch turns does not depend on its digits. The scene is built for a value
    inside the interval, unless the value itself lies outside.
    """
    value = float(y[-1])
    step = max(_DIFFERENCE * interval.size, _LEAST * abs(value))
    beside = y.copy()
    beside[-1] += -step if value > 0.5 * (interval.start + interval.stop) else step
    nodes = chart.nodes(evaluation) if len(getattr(chart, "switches", ())) > _MANY else None
    moved = chart.evaluate(family.of(beside), y[:-1], derivative=False, nodes=nodes)
    return np.asarray((moved.residual - evaluation.residual) / (beside[-1] - value))


def corrected(
    family: Family,
    chart: Any,
    guess: Array,
    scales: Array,
    normal: Array,
    by_value: Array,
    steps: int = _STEPS,
    tolerance: float = TOLERANCE,
    nodes: Array | None = None,
    improve: bool = True,
    interval: Interval | None = None,
) -> tuple[Array, Any, Array]:
    """Return an orbit near a guess, on the plane through it with a normal.

    `guess` has shape (n + 1,).
    `scales` has shape (n + 1,).
    `normal` (shape (n + 1,)): normal of the plane in scaled coordinates.
    `by_value` (shape (n,)): approximate derivative of the residual with respect to the parameter. It is improved in the
    iteration.
    `steps`: largest number of steps of Newton's method.
    `tolerance`: value of `Evaluation.error` that is small enough. If it is below rounding, the best point is returned.
    `nodes`: approximate states at the switches.
    `improve`: whether the derivative with respect to the parameter is improved in the iteration.
    `interval`: if it is given, the derivative with respect to the parameter is computed anew where the iteration is
    slow.
    Returns `y` (shape (n + 1,)).
    Returns `by_value` (shape (n,)).
    Raises `ConvergenceError`.
    """
    y, by_value = guess.copy(), by_value.copy()
    before: Any = None
    moved = np.zeros_like(y)
    for k in range(steps):
        now = chart.evaluate(family.of(y), y[:-1], nodes=nodes)
        if not np.isfinite(now.error):
            raise ConvergenceError("the motion diverges")
        if before is not None:
            by_value = _improved(by_value, before, now, moved, scales) if improve else by_value
            if now.error > (_GROWTH if k == 1 or not improve else 1.0) * before.error:
                if now.error <= ROUNDING or before.error <= ROUNDING:
                    return _lean(*((y, now) if now.error <= before.error else (y - moved, before)), by_value)
                raise ConvergenceError("Newton's method does not converge")
        if now.error <= tolerance:
            return _lean(y, now, by_value)
        if interval is not None and k > 1 and moved[-1] != 0.0 and now.error > _SLOW * before.error:
            by_value = derivative_by_value(family, interval, chart, y, now)
        matrix = np.empty((y.size, y.size))
        matrix[:-1, :-1] = now.jacobian * scales[:-1]
        matrix[:-1, -1] = by_value * scales[-1]
        matrix[-1] = normal
        right = np.append(now.residual, normal @ ((y - guess) / scales))
        moved = -direction(matrix, right) * scales
        y, before = y + moved, now
        nodes = None if nodes is None else chart.nodes(now, moved[:-1])
    if before is not None and before.error <= ROUNDING:
        return _lean(y - moved, before, by_value)
    raise ConvergenceError("Newton's method does not converge")


def _lean(y: Array, evaluation: Any, by_value: Array) -> tuple[Array, Any, Array]:
    """Return a solution without what only its correction needs."""
    return y, evaluation.stripped() if hasattr(evaluation, "stripped") else evaluation, by_value


def _improved(by_value: Array, before: Any, now: Any, moved: Array, scales: Array) -> Array:
    """Return the derivative by the parameter that explains the last step, where the parameter moved enough in it."""
    size = np.linalg.norm(moved / scales)
    if abs(moved[-1] / scales[-1]) < _TELLING * size or moved[-1] == 0.0:
        return by_value
    along = 0.5 * (before.jacobian + now.jacobian) @ moved[:-1]
    return np.asarray((now.residual - before.residual - along) / moved[-1])


def tangent_at(evaluation: Any, by_value: Array, scales: Array, towards: Array) -> Array:
    """Return the direction of the branch in scaled coordinates, of length 1, on the side of another direction."""
    n = by_value.size
    matrix = np.empty((n + 1, n + 1))
    matrix[:n, :n] = evaluation.jacobian * scales[:n]
    matrix[:n, n] = by_value * scales[n]
    norms = np.linalg.norm(matrix[:n], axis=1)
    matrix[:n] /= np.where(norms > 0.0, norms, 1.0)[:, None]
    matrix[n] = towards
    right = np.zeros(n + 1)
    right[n] = 1.0
    found = direction(matrix, right)
    return np.asarray(found / np.linalg.norm(found))
