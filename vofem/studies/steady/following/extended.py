"""Special orbits as solutions of equations: those of the orbit and the condition that makes it special.

A fold has a singular Jacobian matrix A, a flip a singular matrix for the multiplier -1, a Neimark-Sacker point one for
``exp(i theta)`` with a further unknown theta. A matrix with borders tells how far A is from being singular:

    [A   b] [v]   [0]
    [c*  0] [g] = [1]

with g = 0 where A is singular, and ``dg = -w* dA v`` with w from the transposed equations. At a branch point the matrix
of derivatives by unknowns and parameter has two null vectors, so there are two numbers g. One of the two equations is
balanced by a further unknown, a multiple s of b that is added to the equations of the orbit; it vanishes at branch
points. A grazing has a touch of length zero. All these equations are analytic as those of the orbit are.

W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, doi:10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.errors import ConvergenceError
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.newton import ROUNDING, Evaluation, direction, solved
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.segments.extremes import Extreme
from vofem.studies.steady.segments.signature import Signature, States

#: Steps of Newton's method to a special orbit.
_STEPS = 12

#: Steps of differences along the null vector and by the parameter, relative to their scales.
_ALONG, _BY_VALUE = 1e-5, 1e-6

#: Error that may be rounding where the last step was.
_SOLVED_BY_STEPS = 1e-6

#: Weight of the condition beside the residual of the orbit: the digits of the parameters depend on it.
_WEIGHT = 100.0

#: Factor of the step by the parameter where six values are used.
_WIDER = 1000.0


class _Borders(NamedTuple):
    """What is fixed while a condition is solved: scales of rows (m,) and columns (k,), and borders (m, 1), (k, j)."""

    rows: Array
    columns: Array
    left: NDArray[Any]
    right: NDArray[Any]


class _Test(NamedTuple):
    """A bordered matrix: the numbers g (j,), null vectors of the matrix (k, j), and its left null vector (m,)."""

    g: NDArray[Any]
    right: NDArray[Any]
    left: NDArray[Any]


@dataclass(frozen=True)
class ExtendedEvaluation(Evaluation):
    """The equations of a special orbit."""

    orbit: Any  #: That of the orbit.
    residual: Array  #: Shape (m,).
    jacobian: Array  #: Empty without derivatives, shape (m, m).
    error: float  #: The larger of the orbit's error and of the condition's weighted residual.
    #: Second derivative of the equations along the null vector, on the left null vector: zero at a cusp of folds.
    bend: float = np.nan
    critical: tuple[complex, ...] = ()  #: The multipliers that make the orbit special.
    turned: float = 1.0  #: Inverse cosine of the largest angle between a null vector and its border.
    held: int = -1  #: Number of the switch behind the one that begins the touch of length zero of a grazing.

    def __getattr__(self, name: str) -> Any:
        """Return what is known of the orbit: sizes, motion, extremes, and whether it repeats."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.orbit, name)

    @property
    def solved(self) -> float:
        """An error that may be rounding; that of the condition is not known."""
        return max(ROUNDING, float(self.orbit.rounding))

    @property
    def solved_by_steps(self) -> float:
        """An error that is rounding where steps are: touches with little speed magnify it in the condition."""
        return _SOLVED_BY_STEPS

    @cached_property
    def extremes(self) -> list[Extreme]:
        """Extremes of gap functions except the one that is held at its gap, which rounding may lift above it."""
        found: list[Extreme] = self.orbit.extremes
        if self.held < 0:
            return found
        chart, phase = self.orbit.chart, float(self.orbit.chart.phases(self.orbit.y)[self.held])
        contact = chart.switches[self.held - 1].contact
        return [e for e in found if e.contact != contact or not chart.alike(e.phase, phase)]

    @cached_property
    def outside(self) -> Any:
        """The evaluation of the orbit, without a touch of length zero: with it a damper's equations are singular."""
        if self.held < 0:
            return self.orbit
        inner: Signature = self.orbit.chart
        gone = _touch_of(inner, self.held)
        chart, y, _ = inner.edited(self.orbit.y, gone)
        return chart.evaluate(self.orbit.problem, y, near=inner.begins_of(self.orbit, gone)).stripped()

    @cached_property
    def repeats(self) -> bool:
        """Whether an ordinary run over the orbit takes the same switches and comes back."""
        at = self.orbit
        return bool(at.repeats) or (
            self.held >= 0 and self.outside.repeats_around(float(at.chart.phases(at.y)[self.held]))
        )

    @cached_property
    def multipliers(self) -> Complex | None:
        """Floquet multipliers of the orbit without those that make it special."""
        values: Complex | None = self.outside.multipliers
        if values is None:
            return None
        for one in self.critical:
            values = np.delete(values, int(np.argmin(np.abs(values - one))))
        return values

    def stripped(self) -> ExtendedEvaluation:
        """Return the evaluation without what takes memory."""
        return replace(self, orbit=self.orbit.stripped())


def _touch_of(chart: Any, held: int) -> tuple[int, int]:
    """Return the switches that begin and end the touch with a switch that is held; -1 and -1 where none is."""
    return next((pair for pair in chart.touches if pair[0] == held - 1), (-1, -1))


class Extended:
    """Coordinates of special orbits: those of the orbit, theta or s where the kind has it, and the parameter `value`.

    The parameter along which a locus is followed comes last, as in every `Point`, and is no coordinate.

    `inner`: coordinates of the orbits.
    `family`: orbits over two parameters.
    `kind`: as in `SpecialPoint`.
    `size`: scale of `value`.
    `held`: number of the switch behind the one that begins the touch of length zero of a grazing: its end, or the
    impact around which it lies.
    """

    #: Second differences need states that follow from the anchor.
    lifted = False
    #: They tell of second derivatives, which have fewer digits.
    widened = 1e3

    def __init__(self, inner: Any, family: Family, kind: str, size: float, held: int = -1) -> None:
        self.inner, self.family, self.kind, self.size, self.held = inner, family, kind, size, held
        #: Number of coordinates beyond those of the orbit.
        self.more = 2 if kind in ("neimark_sacker", "branch_point") else 1
        self._borders: _Borders | None = None
        #: Whether multipliers need no switches, at all values; None before it was asked.
        self._without_switches: bool | None = None
        self._divisors: Array | None = None

    def __getattr__(self, name: str) -> Any:
        """Return from the orbits' own chart what does not depend on lengths of segments; states come first in both."""
        return getattr(self.inner, name)

    @cached_property
    def touches(self) -> list[tuple[int, int]]:
        """Pairs of switches of one contact of which the second undoes the first, without the touch of length zero."""
        return [pair for pair in self.inner.touches if pair[0] != self.held - 1]

    @cached_property
    def causes(self) -> list[int]:
        """For every switch the first of those with which it happens: those of the touch of length zero are one."""
        begin, end = _touch_of(self.inner, self.held)
        return [begin if begin < k <= end else cause for k, cause in enumerate(self.inner.causes)]

    def together(self, k: int) -> range:
        """Return the numbers of the switches that happen with one; see `Switches.together`."""
        begin, end = _touch_of(self.inner, self.held)
        return range(k, self.inner.together(end if k == begin else k).stop)

    # -- equations ------------------------------------------------------------------------------------

    def evaluate(self, problem: Any, y: Array, *, derivative: bool = True, near: Any = None) -> ExtendedEvaluation:
        """Return the equations at the orbit's coordinates, theta or s, and `value`, shape (m,).

        `near` is for coordinates whose states are unknowns too.
        """
        m = y.size - self.more
        now = self._orbit(problem, y[:m])
        if self.kind == "grazing":
            return self._grazing(problem, y, now, derivative)
        branch = self.kind == "branch_point"
        step = (_WIDER if branch else 1.0) * _BY_VALUE * self.size
        ends: list[Any] = []
        if derivative or branch:
            ends = [self._at(problem, y[:m], sign * step, derivative=not branch) for sign in (1.0, -1.0)]
        by_value = (ends[0].residual - ends[1].residual) / (2.0 * step) if ends else np.zeros(m)
        if branch:
            # Here the derivative is a part of the condition itself: six values give it more digits.
            for away, share in ((2.0, -0.3), (3.0, 1.0 / 30.0)):
                far = [self._at(problem, y[:m], sign * away * step, derivative=False).residual for sign in (1.0, -1.0)]
                by_value = by_value + share * (far[0] - far[1]) / (3.0 * step)
            by_value = 1.5 * by_value
        matrix = self._matrix(problem, now, y[m], by_value)
        test = self._tested(problem, now, matrix)
        assert self._borders is not None
        rows, columns, left, _ = self._borders
        residual = np.empty(y.size)
        residual[:m] = now.residual
        if branch:
            residual[: rows.size] += y[m] * left[:, 0] / rows
        parts = np.array([test.g[0].real, test.g[0].imag]) if self.kind == "neimark_sacker" else test.g
        residual[m:] = parts
        error = max(float(now.error), (1.0 if branch else _WEIGHT) * float(np.max(np.abs(parts))))
        if not derivative:
            return ExtendedEvaluation(now, residual, np.empty((0, 0)), error)
        turned = complex(np.exp(1j * y[m]))
        critical = {"period_doubling": (-1.0 + 0.0j,), "neimark_sacker": (turned, turned.conjugate())}
        jacobian = np.zeros((y.size, y.size))
        jacobian[:m, :m], jacobian[:m, -1] = now.jacobian, by_value
        if branch:
            jacobian[: rows.size, m] = left[:, 0] / rows
        slopes = self._slopes(problem, y[:m], test)
        bend = np.nan
        if branch:
            jacobian[m:, :m], jacobian[m:, -1] = slopes[:, :m], slopes[:, m]
        else:
            # With respect to the parameter the test itself is differentiated.
            moved = [self._tested(problem, one, self._matrix(problem, one, y[m], by_value)).g[0] for one in ends]
            slope = (moved[0] - moved[1]) / (2.0 * step)
            bend = self._bend(now, slopes[0], columns * test.right[:, 0]) if self.kind == "fold" else bend
            if self.kind == "neimark_sacker":
                n = problem.size
                by_angle = (test.left[:n].conj() * rows[:n]) @ (1j * turned * columns[:n] * test.right[:n, 0])
                for row, part in ((m, np.real), (m + 1, np.imag)):
                    jacobian[row, :m], jacobian[row, m], jacobian[row, -1] = (
                        part(slopes[0]),
                        part(by_angle),
                        part(slope),
                    )
            else:
                jacobian[m, :m], jacobian[m, -1] = slopes[0], slope
        turned = max(float(np.linalg.norm(one, axis=0).max()) for one in (test.right, test.left))
        return ExtendedEvaluation(now, residual, jacobian, error, bend, critical.get(self.kind, (1.0 + 0.0j,)), turned)

    def _orbit(self, problem: Any, y: Array, *, derivative: bool = True) -> Any:
        """Return the equations of the orbit, those of switches in units that stay, so that derivatives are exact."""
        now = self.inner.evaluate(problem, y, derivative=derivative)
        if not self.inner.segmented:
            return now
        if self._divisors is None:
            self._divisors = now.divisors
        ratio = np.concatenate([np.ones(problem.size), now.divisors / self._divisors])
        jacobian = ratio[:, None] * now.jacobian if now.jacobian.size else now.jacobian
        return replace(now, residual=ratio * now.residual, jacobian=jacobian)

    def solved(self, guess: Array) -> Array:
        """Return the special orbit on a branch near a guess, with `value` as its last unknown.

        The derivative at the guess serves all steps, because each of its columns costs several evaluations.
        """
        first = self.evaluate(self.family.of(guess), guess)
        return solved(
            lambda y: self.evaluate(self.family.of(y), y, derivative=False), guess, _STEPS,
            known=first, step=lambda _, now: direction(first.jacobian, -now.residual),
        ).unknowns  # fmt: skip

    @staticmethod
    def _bend(now: Any, slope: Array, along: Array) -> float:
        """Return the change of a test along the null vector, with which the switches move too."""
        n = along.size
        if n < slope.size:
            moved = direction(now.jacobian[n:, n:], now.jacobian[n:, :n] @ along)
            along = np.append(along, -moved)
        return float(slope @ along)

    def _grazing(self, problem: Any, y: Array, now: Any, derivative: bool) -> ExtendedEvaluation:
        """Return the equations of an orbit with a touch of length zero."""
        m, place = y.size - 1, problem.size + self.held
        residual = np.append(now.residual, y[place])
        error = max(float(now.error), abs(float(y[place])))
        if not derivative:
            return ExtendedEvaluation(now, residual, np.empty((0, 0)), error, held=self.held)
        step = _BY_VALUE * self.size
        ends = [self._at(problem, y[:m], sign * step, derivative=False) for sign in (1.0, -1.0)]
        jacobian = np.zeros((m + 1, m + 1))
        jacobian[:m, :m], jacobian[:m, m] = now.jacobian, (ends[0].residual - ends[1].residual) / (2.0 * step)
        jacobian[m, place] = 1.0
        return ExtendedEvaluation(now, residual, jacobian, error, held=self.held)

    def _at(self, problem: Any, inner: Array, away: float, *, derivative: bool = True) -> Any:
        """Return the equations of the orbit at another `value`."""
        value, *others = problem.parameters
        return self._orbit(self.family.at(value + away, *others), inner, derivative=derivative)

    def _reduced(self, problem: Any) -> bool:
        """Return whether the switches do not change the motion to first order, so that multipliers need none of them.

        Then the equations of the switches, which are singular at grazings, are left out of the condition. Where the
        parameter of a locus is a damper of a contact, or a gap behind which a force jumps, they may change it at all
        values but the first.
        """
        if self._without_switches is None:
            *others, last = problem.parameters
            self._without_switches = (
                bool(getattr(self.inner, "switches", ()))
                and self.kind != "branch_point"
                and self.inner.smooth(problem)
                and self.inner.smooth(self.family.at(*others, self.family.interval.beside(last)))
            )
        return self._without_switches

    def _tested_matrix(self, now: Any) -> Array:
        """Return the Jacobian matrix of which multipliers are told; sliders that stick all along keep their places."""
        held = self.kind in ("period_doubling", "neimark_sacker") and hasattr(now, "held")
        return np.asarray(now.held if held else now.jacobian)

    def _matrix(self, problem: Any, now: Any, angle: float, by_value: Array) -> NDArray[Any]:
        """Return the matrix that is singular at special orbits."""
        n = problem.size
        if self.kind == "branch_point":
            return np.concatenate([now.jacobian, by_value[:, None]], axis=1)
        matrix = self._tested_matrix(now)
        matrix = matrix[:n, :n] if self._reduced(problem) else matrix
        multiplier = {"period_doubling": -1.0, "neimark_sacker": np.exp(1j * angle)}.get(self.kind, 1.0)
        if multiplier == 1.0:
            return np.asarray(matrix)
        matrix = matrix.astype(type(multiplier), copy=True)
        matrix[np.arange(n), np.arange(n)] += 1.0 - multiplier
        return np.asarray(matrix)

    def _tested(self, problem: Any, now: Any, matrix: NDArray[Any]) -> _Test:
        """Return the test of a matrix, with borders that are taken from the first one."""
        rows_count, columns_count = matrix.shape
        if self._borders is None:
            columns = np.append(self.inner.scales(problem, now), self.size)[:columns_count]
            # Not the norms of this matrix, which is singular: near to it its left null vector would turn fast.
            rows = 1.0 / columns[:rows_count]
            left, _, right = np.linalg.svd(rows[:, None] * matrix * columns)
            few = 1 + columns_count - rows_count
            self._borders = _Borders(rows, columns, left[:, -1:], right[-few:].conj().T)
        rows, columns, left, right = self._borders
        j = right.shape[1]
        bordered = np.zeros((rows_count + j, rows_count + j), dtype=matrix.dtype)
        bordered[:rows_count, :columns_count] = rows[:, None] * matrix * columns
        bordered[:rows_count, columns_count:] = left
        bordered[rows_count:, :columns_count] = right.conj().T
        ones = np.zeros((rows_count + j, j))
        ones[rows_count:] = np.eye(j)
        one = np.zeros(rows_count + j)
        one[-1] = 1.0
        try:
            found = np.linalg.solve(bordered, ones)
            other = np.linalg.solve(bordered.conj().T, one)
        except np.linalg.LinAlgError as error:
            raise ConvergenceError("the matrix of a special orbit is singular") from error
        return _Test(found[columns_count:].ravel(), found[:columns_count], other[:rows_count])

    def _slopes(self, problem: Any, inner: Array, test: _Test) -> NDArray[Any]:
        """Return derivatives of the tests by the orbit's coordinates, and by `value` at branch points.

        Second derivatives of the equations do not depend on their order. Those of all coordinates on the null vectors
        are therefore one difference of Jacobian matrices along each null vector.
        """
        assert self._borders is not None
        rows, columns, _, _ = self._borders
        weights = test.left.conj() * rows
        found = []
        for vector in (columns[:, None] * test.right).T:
            parts = [np.ascontiguousarray(vector.real)]
            if np.iscomplexobj(vector):
                parts.append(np.ascontiguousarray(vector.imag))
            slopes = []
            for part in parts:
                # A step of a certain length in scaled coordinates.
                length = float(np.linalg.norm(part / columns))
                step = _ALONG / length if length > 0.0 else 1.0
                ends = [self._derivatives(problem, inner, sign * step * part) for sign in (1.0, -1.0)]
                slopes.append((ends[0] - ends[1])[: rows.size] / (2.0 * step))
            total = slopes[0] if len(slopes) == 1 else slopes[0] + 1j * slopes[1]
            found.append(-(weights @ total))
        return np.array(found)

    def _derivatives(self, problem: Any, inner: Array, away: Array) -> Array:
        """Return derivatives of the equations at a change of coordinates, and of `value` at branch points."""
        m = inner.size
        moved = inner.copy()
        moved[: min(away.size, m)] += away[:m]
        if self.kind != "branch_point":
            return np.asarray(self._tested_matrix(self._orbit(problem, moved)))
        step = _ALONG * self.size
        at = float(away[m])
        ends = [self._at(problem, moved, at + sign * step, derivative=False).residual for sign in (1.0, -1.0)]
        by_value = (ends[0] - ends[1]) / (2.0 * step)
        return np.concatenate([self._at(problem, moved, at).jacobian, by_value[:, None]], axis=1)

    # -- coordinates ----------------------------------------------------------------------------------

    def scales(self, problem: Any, evaluation: ExtendedEvaluation) -> Array:
        """Return sizes of the coordinates."""
        return np.concatenate([self.inner.scales(problem, evaluation.orbit), np.ones(self.more - 1), [self.size]])

    def lengths(self, y: Array) -> Array:
        """Return the lengths of all segments in rad."""
        return np.asarray(self.inner.lengths(y[: -self.more]))

    def phases(self, y: Array) -> Array:
        """Return the phases of the switches in rad."""
        return np.asarray(self.inner.phases(y[: -self.more]))

    def unknowns(self, problem: Any, y: Array, evaluation: ExtendedEvaluation) -> Array:
        """Return the unknowns of the orbit's problem."""
        return np.asarray(self.inner.unknowns(problem, y[: -self.more], evaluation.orbit))

    def orbit(self, problem: Any, y: Array, evaluation: ExtendedEvaluation) -> PeriodicOrbit:
        """Return the orbit."""
        at = evaluation.outside
        chart, y = (self.inner, y[: -self.more]) if self.held < 0 else (at.chart, at.y)
        orbit: PeriodicOrbit = chart.orbit(problem, y, at)
        return orbit

    # -- other signatures -----------------------------------------------------------------------------

    def edited(
        self, y: Array, gone: Sequence[int] = (), added: Sequence[tuple[int, float, Any]] = ()
    ) -> tuple[Extended, Array, list[int]]:
        """Return the chart without some switches and with others; see `Signature.edited`."""
        inner, changed, numbers = self.inner.edited(y[: -self.more], gone, added)
        held = self.held + sum(place <= self.held for place, _, _ in added) - sum(k < self.held for k in gone)
        if self.held in gone:
            # The touch has been moved.
            held = max(n for n, (*_, s) in zip(numbers, added, strict=True) if s == self.inner.switches[self.held])
        return self._like(inner, held), np.append(changed, y[-self.more :]), numbers

    def recentred(self, known: Any, y: Array, tangent: Array) -> tuple[Extended, Array, States, Array] | None:
        """Return the chart with its anchor away from all switches, or None; see `Signature.recentred`."""
        m = y.size - self.more
        found = self.inner.recentred(known.orbit, y[:m], np.append(tangent[:m], tangent[-1]))
        if found is None:
            return None
        inner, changed, begins, turned = found
        passed = (inner.anchor - self.inner.anchor) % self.inner.turn
        first = int(np.searchsorted(self.phases(y) - self.inner.anchor, passed))
        held = (self.held - first) % len(inner.switches) if self.held >= 0 else -1
        return self._like(inner, held), np.append(changed, y[m:]), begins, np.append(turned[:-1], tangent[m:])

    def with_new_borders(self) -> Extended:
        """Return the chart with borders that are taken from its next evaluation."""
        return self._like(self.inner, self.held)

    def _like(self, inner: Any, held: int) -> Extended:
        return Extended(inner, self.family, self.kind, self.size, held)
