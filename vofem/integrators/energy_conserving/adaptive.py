"""Runs of the midpoint rule whose steps follow a tolerance.

Every step is taken once as a whole and once as two halves; the halves are kept
where the results agree, see `stepping.doubling`. Energy is conserved as with
equal steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.energy_conserving.setting import Midpoint
from vofem.integrators.energy_conserving.step import (
    Factored,
    Forcing,
    Found,
    Scratch,
    Start,
    State,
    accept,
    accept_springpots,
    combine,
    step,
)
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.stepping.doubling import Attempt, Impact, Path, StepDoubling, impact
from vofem.integrators.stepping.record import LastStep, Record
from vofem.integrators.stepping.setting import Equations
from vofem.integrators.stepping.step_loads import of_halves
from vofem.kernels.jit import jit
from vofem.laws.evaluate import commit_all
from vofem.laws.rows import Rows, dot
from vofem.laws.springpot_steps import Springpots, carry_on, set_means
from vofem.laws.table import Laws
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.vectors import copy, fill

Array = NDArray[np.float64]


class Sizes(NamedTuple):
    """The matrices of a whole step and of its halves, and the factored one of a step eight times as long."""

    whole: Factored
    half: Factored
    long: Array


class PotSizes(NamedTuple):
    """Springpots over a whole step and over its halves, and those that the second half begins with."""

    whole: Springpots
    half: Springpots
    ahead: Springpots


class Trial(NamedTuple):
    """What a step finds that is tried.

    Attributes
    ----------
    first, second, whole : Found
        Results of the first half, of the second half and of the whole step.
    q, v, end : ndarray, shape (n,)
        Displacements and velocities between the halves, and velocities at the end.
    internal : ndarray
        Internal variables of hysteretic laws at the start.
    u : ndarray, shape (n_laws,)
        Coordinates of the laws between the halves.
    path : Path
    """

    first: Found
    second: Found
    whole: Found
    q: Array
    v: Array
    end: Array
    internal: Array
    u: Array
    path: Path


class AdaptiveSteps(StepDoubling, Midpoint):
    """A run of steps chosen by their error."""

    method = ENERGY_CONSERVING

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        super().plan(t_end, tolerance, fineness)
        self.sizes: dict[int, Factored] = {}
        n, m = self.state.q.size, self.state.u.size
        first, second, whole = (Found(np.zeros(n), np.zeros(m)) for _ in range(3))
        path = Path(np.zeros((3, m)), np.zeros((3, m)), np.zeros((2, m)))
        q, v, end = np.zeros((3, n))
        self.trial = Trial(first, second, whole, q, v, end, self.state.internal.copy(), np.zeros(m), path)
        #: Internal variables of springpots with which the second half begins.
        self.ahead = None if self.past is None else type(self.past.state)(*(part.copy() for part in self.past.state))

    @property
    def displacement(self) -> Array:
        """Displacements of the current state."""
        return self.state.q

    def _size(self, level: int) -> Factored:
        """Return the matrices of a step size."""
        if level not in self.sizes:
            self.sizes[level] = self.factor(self.length(level))
        return self.sizes[level]

    def _springpots(self, whole: float, half: float) -> PotSizes | None:
        """Return the springpots over a step of a size in s and over its halves."""
        if self.past is None:
            return None
        assert self.ahead is not None
        times = self.time + whole * np.array([0.5, 0.25, 0.75])
        halves = self.past.over(half, times)
        return PotSizes(self.past.over(whole, times), halves, halves._replace(**self.ahead._asdict()))

    def attempt(self, out: Record) -> Attempt:
        """Take the next step whole and in halves."""
        sizes = Sizes(
            self._size(self.level), self._size(self.level + 1),
            self._size(max(self.level - 3, 0)).structure.factored,
        )  # fmt: skip
        values, between = self._loads(self.time, sizes.whole.dt, sizes.half)
        springpots = self._springpots(sizes.whole.dt, sizes.half.dt)
        self.of_step = values, springpots
        found = _try(
            self.equations, sizes, self.forcing, values, self.state, self.trial, self.space, springpots,
            Impact(self.weight, self.fineness),
        )  # fmt: skip
        return Attempt(*found, between)

    def take(self, out: Record) -> None:
        """Keep both halves."""
        values, springpots = self.of_step
        half = None if springpots is None else springpots.half
        for k, found in enumerate((self.trial.first, self.trial.second)):
            _take(
                self.equations, self._size(self.level + 1), self.forcing, values, k, self.time, found, self.state,
                self.last_step, out, self.space, half,
            )  # fmt: skip

    def _loads(self, t: float, dt: float, half: Factored) -> tuple[Array, float]:
        """Return the loads over the step and its halves, and their own part of the error over the tolerance."""
        parts = self.bands.over.parts(t, t + dt)
        if not parts.shape[1]:
            return np.empty((0, 3)), 0.0
        moments, fluctuations = of_halves(parts)
        return self.load_values(moments), self.between_ends(fluctuations, half.dt * half.shift)


@jit
def _try(
    equations: Equations, sizes: Sizes, forcing: Forcing, values: Array, state: State, trial: Trial, space: Scratch,
    springpots: PotSizes | None, scales: Impact,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Take a step whole and in halves; return contact solves, two errors of displacements, and unresolved impacts.

    The second error is ``(A^-1 M)^2`` times the first, where A is the matrix of
    a step eight times as long. This filter keeps only the motion that the step
    resolves well. Where a contact acts, the first error includes the error of
    velocities times the step. The last number, in m/s, is the largest change of
    a law's velocity that the step does not resolve.
    The state is not changed.
    """
    matrices, rows, laws = equations
    whole, half = sizes.whole, sizes.half
    full, first, second = trial.whole.p, trial.first.p, trial.second.p
    q, v, end, u, weight = trial.q, trial.v, trial.end, trial.u, scales.weight
    n, m = state.q.size, state.u.size
    # Indices, but not as literals, for which kernels would be compiled once more.
    index = n - n
    start = Start(state.q, state.v, state.u)
    combine(whole, values, index, forcing)
    _set_whole(springpots, laws, state.u, index)
    copy(state.expected, full)
    copy(state.reaction, trial.whole.reaction)
    a = step(equations, whole, forcing.push, start, trial.whole, space)
    combine(half, values, index + 1, forcing)
    _set_half(springpots, laws, state.u, index + 1)
    copy(state.expected, first)
    copy(state.reaction, trial.first.reaction)
    b = step(equations, half, forcing.push, start, trial.first, space)
    if a < 0 or b < 0:
        return -1, 0.0, 0.0, 0.0
    for i in range(n):
        q[i] = state.q[i] + half.dt * first[i]
        v[i] = 2.0 * (first[i] + forcing.shift[i]) - state.v[i]
        second[i] = full[i] + (full[i] - first[i])
    for j in range(m):
        u[j] = dot(rows, j, q)
    combine(half, values, index + 2, forcing)
    copy(trial.first.reaction, trial.second.reaction)
    # The second half begins with the state at the end of the first, as if that had been accepted.
    copy(state.internal, trial.internal)
    commit_all(laws, u)
    _set_ahead(springpots, laws, u, rows, first, index)
    c = step(equations, half, forcing.push, Start(q, v, u), trial.second, space)
    copy(trial.internal, state.internal)
    if c < 0:
        return -1, 0.0, 0.0, 0.0
    rough, smooth, unresolved = 0.0, 0.0, 0.0
    acts = False
    if m > 0:
        for i in range(n):
            end[i] = second[i] + (second[i] - v[i])
        path, rates, forces = trial.path
        for j in range(m):
            path[0, j], path[1, j], path[2, j] = state.u[j], u[j], u[j] + half.dt * dot(rows, j, second)
            rates[0, j], rates[1, j], rates[2, j] = dot(rows, j, state.v), dot(rows, j, v), dot(rows, j, end)
            forces[0, j], forces[1, j] = trial.first.reaction[j], trial.second.reaction[j]
        acts, unresolved = impact(laws, state.status.size, half.dt, trial.path, scales.fineness)
    if acts:
        # Against a stiff stop, steps of any size end at the stop: displacements agree there, velocities do not.
        for i in range(n):
            rough = max(rough, weight[i] * whole.dt * abs(full[i] + (full[i] - state.v[i]) - end[i]) / 3.0)
    # Without contact velocities are not compared: those of fast modes with tiny displacements would set the step.
    for i in range(n):
        # Computed from velocities: the shortest steps change only the last digits of displacements.
        q[i] = half.dt * ((full[i] - first[i]) + (full[i] - second[i])) / 3.0
        rough = max(rough, weight[i] * abs(q[i]))
    for _ in range(2):
        fill(v, 0.0)
        subtract_product(matrices.mass, q, v)
        solve(sizes.long, v)
        for i in range(n):
            q[i] = -v[i]
    for i in range(n):
        smooth = max(smooth, weight[i] * abs(q[i]))
    return a + b + c, rough, smooth, unresolved


@jit
def _set_whole(springpots: PotSizes | None, laws: Laws, u: Array, s: int) -> None:
    """Enter the forces of springpots over the whole step."""
    if springpots is not None:
        set_means(springpots.whole, s, laws, u)


@jit
def _set_half(springpots: PotSizes | None, laws: Laws, u: Array, s: int) -> None:
    """Enter the forces of springpots over the first half."""
    if springpots is not None:
        set_means(springpots.half, s, laws, u)


@jit
def _set_ahead(springpots: PotSizes | None, laws: Laws, u: Array, rows: Rows, first: Array, index: int) -> None:
    """Enter the forces of springpots over the second half, after a first one of a rate of the displacement."""
    if springpots is not None:
        ahead = springpots.ahead
        for i in range(ahead.y.shape[0]):
            for k in range(ahead.y.shape[1]):
                ahead.y[i, k] = springpots.half.y[i, k]
            carry_on(ahead, i, index + 1, dot(rows, ahead.row + i, first), 0.0)
        set_means(ahead, index + 2, laws, u)


@jit
def _take(
    equations: Equations, half: Factored, forcing: Forcing, values: Array, k: int, t: float, found: Found,
    state: State, before: LastStep, out: Record, space: Scratch, springpots: Springpots | None,
) -> None:  # fmt: skip
    """Accept half k of a step from t."""
    combine(half, values, k + 1, forcing)
    copy(found.reaction, state.reaction)
    last, begin = state.width[0], t + k * half.dt
    accept(equations, half, forcing, begin, found.p, state, before, out, space)
    accept_springpots(springpots, k + 1, begin, last, found, equations.rows, out)
