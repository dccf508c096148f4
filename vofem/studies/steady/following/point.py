"""Points of a branch: an orbit in some coordinates, the direction of the branch, and the correction of a guess."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.newton import converged, direction
from vofem.studies.steady.orbit import PeriodicOrbit

#: Error of an evaluation at which a point counts as solved; Newton's last step makes it smaller still.
TOLERANCE = 1e-12

#: Evaluations at a point.
_STEPS = 8

#: Factor by which the residual falls in a step at least where the derivative with respect to the parameter is good.
_SLOW = 0.02

#: Change of the parameter, as a share of it, below which it is held, and by how much an equation may give way to it.
_HELD, _LOST = 4e-15, 1e-10

#: Growth of changes of the unknowns over an orbit above which directions need all digits of derivatives.
_MAGNIFIED = 1e3

#: Change of the parameter, as a share of a step and of the parameter, above which it is used to compute the derivative.
_TELLING, _EXACT = 1e-2, 1e-12


@dataclass(frozen=True)
class OriginChart:
    """The unknowns of the problem as coordinates."""

    #: Whether orbits are divided into segments, whose switches are watched and whose begins are unknowns too.
    segmented = lifted = False
    #: Factor of the step by which the equations are differentiated by the parameter.
    widened = 1.0

    def evaluate(self, problem: Any, y: Array, *, derivative: bool = True, near: Any = None) -> Any:
        """Return the equations, which need no states of a neighbour."""
        return problem.evaluate(y, derivative=derivative)

    def scales(self, problem: Any, evaluation: Any) -> Array:
        """Return sizes of the unknowns: those of the motion."""
        return np.asarray(evaluation.scales)

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
    evaluation : evaluation of the equations, see `problem`
    scales : ndarray, shape (n + 1,)
    by_value : ndarray, shape (n,)
        Derivative of the residual with respect to the parameter.
    tangent : ndarray, shape (n + 1,)
        Direction of the branch in scaled coordinates, of length 1.
    leaving : dict of Mark to float
        Rates at which extremes of gap functions leave their gaps in this direction, and at which margins of sliders
        that turn grow, as far as they were asked for.
    """

    chart: Any
    y: Array
    problem: Any
    evaluation: Any
    scales: Array
    by_value: Array
    tangent: Array
    leaving: dict[Any, float] = field(default_factory=dict, init=False)

    @property
    def value(self) -> float:
        """Value of the parameter."""
        return float(self.y[-1])

    def turned(self) -> Point:
        """Return the point with the opposite direction."""
        return replace(self, tangent=-self.tangent)

    def orbit(self) -> PeriodicOrbit:
        """Return the orbit."""
        orbit: PeriodicOrbit = self.chart.orbit(self.problem, self.y[:-1], self.evaluation)
        return orbit

    def unknowns(self) -> Array:
        """Return the unknowns of the problem."""
        return np.asarray(self.chart.unknowns(self.problem, self.y[:-1], self.evaluation))


def derivative_by_value(family: Family, chart: Any, y: Array, evaluation: Any, *, exact: bool = False) -> Array:
    """Return the derivative of the residual with respect to the parameter, by a difference, shape (n,).

    `exact`: to second order. Stiff contacts magnify errors of the direction of a branch that it gives.
    """
    moved, step = _beside(family, chart, y, evaluation)
    slope = np.asarray((moved.residual - evaluation.residual) / step)
    if not exact:
        return slope
    moved, step = _beside(family, chart, y, evaluation, 2.0)
    return 2.0 * slope - (moved.residual - evaluation.residual) / step


def _beside(family: Family, chart: Any, y: Array, evaluation: Any, times: float = 1.0) -> tuple[Any, float]:
    """Return the equations at a value of the parameter beside, or some times as far away, and the step to it."""
    value = float(y[-1])
    beside = value + times * chart.widened * (family.interval.beside(value) - value)
    moved = chart.evaluate(family.of(np.append(y[:-1], beside)), y[:-1], derivative=False, near=evaluation)
    return moved, beside - value


class _OnPlane:
    """The equations of a branch on a plane through a guess.

    The derivative with respect to the parameter is improved by every step. `corrected` tells of the attributes.
    Where steps are slow, those of the states in which segments begin, (k + 1, 2n), are computed too. Otherwise a change
    of the parameter by rounding would grow from one segment to the next.
    """

    def __init__(
        self, family: Family, chart: Any, guess: Array, scales: Array, normal: Array, by_value: Array, near: Any,
        loose: int | None,
    ) -> None:  # fmt: skip
        self.near, self.loose = near, loose
        self.family, self.chart, self.guess, self.scales, self.normal = family, chart, guess, scales, normal
        self.by_value = by_value
        self.by_states: Any = None
        self._before: Any = None
        self._moved, self._steps = np.zeros_like(guess), 0

    def evaluate(self, y: Array) -> Any:
        """Return the equations."""
        return self.chart.evaluate(self.family.of(y), y[:-1], near=self.near)

    def improve(self, now: Any) -> None:
        """Take the derivative by the parameter that explains the last step, where the parameter moved enough in it."""
        before, moved = self._before, self._moved
        if before is None or now is before or abs(moved[-1]) <= _EXACT * abs(self.guess[-1]):
            return
        if abs(moved[-1] / self.scales[-1]) >= _TELLING * np.linalg.norm(moved / self.scales):
            along = 0.5 * (before.jacobian + now.jacobian) @ moved[:-1]
            self.by_value = (now.residual - before.residual - along) / moved[-1]

    def step(self, y: Array, now: Any) -> Array:
        """Return the step of Newton's method."""
        self.improve(now)
        if self._steps > 1 and self._moved[-1] != 0.0 and now.error > _SLOW * self._before.error:
            beside, step = _beside(self.family, self.chart, y, now)
            self.by_value = (beside.residual - now.residual) / step
            self.by_states = (beside.reached - now.reached) / step if self.chart.lifted else None
        matrix = _bordered(now, self.by_value, self.scales, self.normal)
        right = np.zeros((y.size, 2))
        right[:, 0] = np.append(now.residual, self.normal @ ((y - self.guess) / self.scales))
        right[-1 if self.loose is None else self.loose, 1] = 1.0
        back, along = direction(matrix, right).T * self.scales
        # Every change of the parameter rounds all phases anew, and stiff contacts magnify that. So the last steps hold
        # it; what it lacks is made up for by the equation that gives way.
        held = self.loose is not None and abs(back[-1]) <= _HELD * abs(y[-1])
        moved = 0.0 if held else (y[-1] - back[-1]) - y[-1]
        lost = (moved + back[-1]) / along[-1] if along[-1] else np.inf
        if abs(lost) <= _LOST:
            back = back - lost * along
            back[-1] = -moved
        self._before, self._moved, self._steps = now, -back, self._steps + 1
        # Columns do not tell of the parameter. Where it moves, states follow from the segments themselves, as long as
        # no more is known.
        self.near = now
        if self.chart.lifted and (moved == 0.0 or self.by_states is not None):
            after = now.after(self._moved[:-1])
            self.near = after if moved == 0.0 else after._replace(states=after.states + moved * self.by_states)
        return self._moved


def corrected(
    family: Family,
    chart: Any,
    guess: Array,
    scales: Array,
    normal: Array | None,
    by_value: Array,
    steps: int = _STEPS,
    tolerance: float = TOLERANCE,
    near: Any = None,
    known: Any = None,
    loose: int | None = -1,
) -> tuple[Array, Any]:
    """Return an orbit near a guess, on the plane through it with a normal: `y` (n + 1,), and its evaluation.

    `guess`, `scales` have shape (n + 1,).
    `normal` (shape (n + 1,)): normal of the plane in scaled coordinates; by default that of a value of the parameter.
    `by_value` (shape (n,)): approximate derivative of the residual with respect to the parameter. It is improved in the
    iteration, and computed anew where this is slow.
    `steps`: largest number of evaluations.
    `tolerance`: error of an evaluation that is small enough. If it is below rounding, the best point is returned.
    `near`: an evaluation near the guess, or `States`, for coordinates with segments; or `known`, that at the guess.
    `loose`: number of the equation that gives way to the rounding of the parameter; by default that of the plane.
    With None the parameter is not held.
    Raises `ConvergenceError`.
    """
    normal = level(guess.size) if normal is None else normal
    plane = _OnPlane(family, chart, guess, scales, normal, by_value, near, loose)
    found = converged(plane.evaluate, guess, steps - 1, plane.step, scales, tolerance, known)
    return found.unknowns, found.evaluation.stripped()


def point_at(
    family: Family, chart: Any, y: Array, towards: Array, evaluation: Any = None, near: Any = None, scales: Any = None
) -> Point:
    """Return a point with its direction, on the side of another one in scaled coordinates; `near` as in `corrected`.

    `scales`: by default those of the orbit.
    """
    problem = family.of(y)
    evaluation = chart.evaluate(problem, y[:-1], near=near) if evaluation is None else evaluation
    scales = scales_of(family, chart, problem, evaluation) if scales is None else scales
    magnified = chart.segmented and np.any(np.abs(evaluation.jacobian * scales[:-1]) > _MAGNIFIED * scales[:-1, None])
    exact = magnified or chart.widened > 1.0
    by_value = derivative_by_value(family, chart, y, evaluation, exact=bool(exact))
    return Point(chart, y, problem, evaluation, scales, by_value, tangent_at(evaluation, by_value, scales, towards))


def scales_of(family: Family, chart: Any, problem: Any, evaluation: Any) -> Array:
    """Return sizes of the coordinates of a chart, and of the parameter, shape (n + 1,)."""
    return np.append(chart.scales(problem, evaluation), family.interval.size)


def level(size: int, along: float = 1.0) -> Array:
    """Return the direction in which the parameter alone changes, shape (size,)."""
    return np.append(np.zeros(size - 1), along)


def tangent_at(evaluation: Any, by_value: Array, scales: Array, towards: Array) -> Array:
    """Return the direction of the branch in scaled coordinates, of length 1, on the side of another direction."""
    n = by_value.size
    matrix = _bordered(evaluation, by_value, scales, towards)
    norms = np.linalg.norm(matrix[:n], axis=1)
    matrix[:n] /= np.where(norms > 0.0, norms, 1.0)[:, None]
    right = np.zeros(n + 1)
    right[n] = 1.0
    found = direction(matrix, right)
    return np.asarray(found / np.linalg.norm(found))


def sided(point: Point, direction: Array) -> float:
    """Return the sign of the determinant of the equations of a branch, with a direction as their last row."""
    return float(np.linalg.slogdet(_bordered(point.evaluation, point.by_value, point.scales, direction))[0])


def _bordered(evaluation: Any, by_value: Array, scales: Array, row: Array) -> Array:
    """Return the derivatives of the equations by all scaled coordinates with a row below them, (n + 1, n + 1)."""
    matrix = np.empty((scales.size, scales.size))
    matrix[:-1, :-1] = evaluation.jacobian * scales[:-1]
    matrix[:-1, -1] = by_value * scales[-1]
    matrix[-1] = row
    return matrix
