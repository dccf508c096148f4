"""Runs of the midpoint rule whose steps follow a tolerance.

Every step is taken once as a whole and once as two halves; the halves are kept
where the results agree, see `stepping.doubling`. Energy is conserved as with
equal steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.energy_conserving.setting import Midpoint
from vofem.integrators.energy_conserving.step import (
    Factored,
    Forcing,
    Scratch,
    State,
    accept,
    accept_history,
    combine,
    step,
)
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.stepping.doubling import Attempt, StepDoubling, impact
from vofem.integrators.stepping.record import Output, Trail
from vofem.integrators.stepping.setting import Matrices
from vofem.integrators.stepping.step_loads import PARTS, joined, swing
from vofem.laws.evaluate import commit_all
from vofem.laws.rows import Rows, dot
from vofem.laws.springpot import History, Pace, Springpots, carry_on, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


class AdaptiveSteps(StepDoubling, Midpoint):
    """A run of steps chosen by their error."""

    method = ENERGY_CONSERVING

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        super().plan(t_end, tolerance, fineness)
        self.sizes: dict[int, tuple[Factored, Pace]] = {}
        n, m = self.state.q.size, self.state.u.size
        self.trial, self.tried = np.zeros((6, n)), np.zeros((3, m))
        self.past = self.state.memory.copy()
        self.ahead = History(self.history.y.copy(), self.history.told.copy())

    @property
    def displacement(self) -> Array:
        """Displacements of the current state."""
        return self.state.q

    def _size(self, rung: int) -> tuple[Factored, Pace]:
        """Return the matrices of a step size, and the update of springpots over such a step."""
        if rung not in self.sizes:
            dt = self.length(rung)
            self.sizes[rung] = self.factor(dt), self.pace(dt)
        return self.sizes[rung]

    def attempt(self, out: Output, cursor: int) -> Attempt:
        """Take the next step whole and in halves."""
        (whole, pace), (half, half_pace) = self._size(self.rung), self._size(self.rung + 1)
        t, dt = self.time, whole.dt
        springpots = self.springpots(t + dt * np.array([0.5, 0.25, 0.75]))
        values, between = self._loads(t, dt, half)
        self.loads_of_step = values, springpots
        found = _try(
            self.matrices, self._size(max(self.rung - 3, 0))[0].structure.factored, whole, half, self.rows,
            with_state(self.laws, self.state.memory), self.forcing, values, self.state, self.trial, self.tried,
            self.weight, self.space, self.past, springpots, pace, half_pace, self.history, self.ahead, self.fineness,
        )  # fmt: skip
        return Attempt(*found, between)

    def take(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Keep both halves."""
        half, pace = self._size(self.rung + 1)
        values, springpots = self.loads_of_step
        found: tuple[int, Array] = _take(
            self.matrices, half, self.rows, with_state(self.laws, self.state.memory), self.forcing, values, self.time,
            self.state, self.trial, self.tried, self.trail, out, cursor, self.space, springpots, pace, self.history,
        )  # fmt: skip
        return found

    def _loads(self, t: float, dt: float, half: Factored) -> tuple[Array, float]:
        """Return the loads over the step and its halves, and their own part of the error over the tolerance.

        The motion between the ends of a step is interpolated by a polynomial. A short load causes motion that this
        polynomial does not contain. That is no error of the steps and does not accumulate, but states between steps
        have it.
        """
        parts = self.bands.over.parts(t, t + dt)
        if not parts.shape[1]:
            return np.empty((0, 3)), 0.0
        cut, moved = PARTS // 2, 0.0
        halves = parts[:, :, :cut], parts[:, :, cut:]
        moments = np.empty((3, parts.shape[1], 3))
        moments[:, :, 0] = joined(parts)
        for k, part in enumerate(halves, 1):
            moments[:, :, k] = joined(part)
            far = swing(part, moments[0, :, k], moments[1, :, k])
            if np.any(far):
                moved = max(moved, float(np.max(self.weight * (far @ np.abs(half.dt * half.shift)))))
        return self.load_values(moments), moved / self.whole


@jit
def _try(
    matrices: Matrices, filtering: Array, whole: Factored, half: Factored, rows: Rows, laws: Laws, total: Forcing,
    values: Array, state: State, trial: Array, tried: Array, weight: Array, space: Scratch, past: Array,
    springpots: Springpots, pace: Pace, half_pace: Pace, history: History, ahead: History, fineness: float,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Take a step whole and in halves; return contact solves, two errors of displacements, and unresolved impacts.

    The second error is ``(A^-1 M)^2`` times the first, where A is the matrix of
    a step eight times as long. This filter keeps only the motion that the step
    resolves well. Where a contact acts, the first error includes the error of
    velocities times the step. The last number, in m/s, is the largest change of
    a law's velocity that the step does not resolve.
    The state is not changed. Mean velocities of the halves are returned in
    `trial[0]` and `trial[1]`, reactions in `tried[0]` and `tried[1]`.
    """
    first, second, full, q, v, end = trial[0], trial[1], trial[2], trial[3], trial[4], trial[5]
    n, m, remembers = state.q.size, state.u.size, history.y.shape[0] > 0
    combine(whole, values[:, 0], total)
    if remembers:
        impose(springpots, pace, history, 0, laws, state.u, 0.0, 1.0)
    full[:] = state.expected
    tried[2][:] = state.reaction
    a = step(matrices, whole, rows, laws, total.push, state.q, state.v, state.u, full, tried[2], space)
    combine(half, values[:, 1], total)
    if remembers:
        impose(springpots, half_pace, history, 1, laws, state.u, 0.0, 1.0)
    first[:] = state.expected
    tried[0][:] = state.reaction
    b = step(matrices, half, rows, laws, total.push, state.q, state.v, state.u, first, tried[0], space)
    if a < 0 or b < 0:
        return -1, 0.0, 0.0, 0.0
    for i in range(n):
        q[i] = state.q[i] + half.dt * first[i]
        v[i] = 2.0 * (first[i] + total.shift[i]) - state.v[i]
        second[i] = full[i] + (full[i] - first[i])
    u = np.empty(m)
    for j in range(m):
        u[j] = dot(rows, j, q)
    combine(half, values[:, 2], total)
    tried[1][:] = tried[0]
    if past.size > 0:
        # The second half begins with the state at the end of the first, as if that had been accepted.
        past[:] = state.memory
        commit_all(laws, u)
    if remembers:
        ahead.y[:] = history.y
        for i in range(ahead.y.shape[0]):
            carry_on(springpots, half_pace, ahead, i, 1, dot(rows, springpots.row + i, first), 0.0)
        impose(springpots, half_pace, ahead, 2, laws, u, 0.0, 1.0)
    c = step(matrices, half, rows, laws, total.push, q, v, u, second, tried[1], space)
    if past.size > 0:
        state.memory[:] = past
    if c < 0:
        return -1, 0.0, 0.0, 0.0
    rough, smooth, kick = 0.0, 0.0, 0.0
    acts = False
    if m > 0:
        for i in range(n):
            end[i] = second[i] + (second[i] - v[i])
        path, rates = np.empty((3, m)), np.empty((3, m))
        for j in range(m):
            path[0, j], path[1, j], path[2, j] = state.u[j], u[j], u[j] + half.dt * dot(rows, j, second)
            rates[0, j], rates[1, j], rates[2, j] = dot(rows, j, state.v), dot(rows, j, v), dot(rows, j, end)
        acts, kick = impact(laws, state.status.size, half.dt, path, rates, tried, fineness)
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
        v[:] = 0.0
        subtract_product(matrices.mass, q, v)
        solve(filtering, v)
        for i in range(n):
            q[i] = -v[i]
    for i in range(n):
        smooth = max(smooth, weight[i] * abs(q[i]))
    return a + b + c, rough, smooth, kick


@jit
def _take(
    matrices: Matrices, half: Factored, rows: Rows, laws: Laws, total: Forcing, values: Array, t: float, state: State,
    trial: Array, tried: Array, before: Trail, out: Output, cursor: int, space: Scratch, springpots: Springpots,
    pace: Pace, history: History,
) -> tuple[int, Array]:  # fmt: skip
    """Accept both halves; return the cursor and the events."""
    dt, loaded = half.dt, values.shape[0] > 0
    events = np.empty((4 if state.status.size else 0, 3))
    # Not a literal, for which `accept` would be compiled once more.
    happened = cursor - cursor
    for k in range(2):
        combine(half, values[:, k + 1], total)
        state.reaction[:] = tried[k]
        wanted, last = cursor, state.width[0]
        cursor, events, happened = accept(
            matrices, rows, laws, total, loaded, t + k * dt, dt, trial[k], state, before, out, cursor,
            events, happened, space,
        )  # fmt: skip
        if history.y.shape[0] > 0:
            accept_history(
                springpots, pace, history, rows, tried[k], k + 1, t + k * dt, last, trial[k], out, wanted, cursor
            )
    return cursor, events[:happened]
