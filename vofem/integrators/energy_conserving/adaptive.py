"""Runs of the midpoint rule whose steps follow a tolerance.

Every step is taken whole and in two halves; the halves are kept where both
agree. So the error estimate sees whatever the step sees, a switch included,
and the energy is conserved as at one step size. Step sizes are halves of
halves of the largest one, and times whole multiples of the smallest: each
size is factored once, and nothing is accumulated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.energy_conserving.setting import Setting
from vofem.integrators.energy_conserving.step import (
    Factored,
    Matrices,
    Scratch,
    State,
    accept,
    accept_history,
    combine,
    step,
)
from vofem.integrators.stepping.record import Output, Trail
from vofem.laws.evaluate import commit_all
from vofem.laws.rows import Rows, dot
from vofem.laws.springpot import History, Pace, Springpots, carry_on, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.jit import jit

Array = NDArray[np.float64]

#: Halvings of the largest step.
_RUNGS = 40

#: Steps in a run at the largest step size.
_FEWEST = 32

#: Keeps errors of a scene without motion from being divided by zero.
_TINY = 1e-300

#: Steps between two looks at the outcome.
_CHUNK = 256


class AdaptiveSteps(Setting):
    """A run of steps chosen by their error."""

    place: tuple[str, ...] = ("now", "rung", "steps", "coarsest", "forced", "beyond", "size")

    def plan(self, t_end: float, tolerance: float) -> None:
        """Set the end in s and the tolerance."""
        self.t_end, self.tolerance = t_end, tolerance
        self.largest = t_end / _FEWEST
        self.tick = self.largest / 2**_RUNGS
        self.now, self.end = 0, _FEWEST * 2**_RUNGS
        self.rung, self.steps, self.coarsest, self.forced = 6, 0, 0.0, 0
        self.beyond = False
        self.ladder: dict[int, Factored] = {}
        n, m = self.state.q.size, self.state.u.size
        self.trial, self.tried = np.zeros((5, n)), np.zeros((3, m))
        self.past = self.state.memory.copy()
        self.keep_history(self.tick, t_end + 2.0 * self.largest)
        self.paces: dict[int, Pace] = {}
        self.ahead = History(self.history.y.copy(), self.history.told.copy())

    def measure(self, displacement: Array) -> None:
        """Set the size that errors are related to from a rough run, shape (n, n_times)."""
        # A scene that starts from rest has no size of its own before it has moved.
        self.weight = self.bands.system.scale[self.bands.order]
        self.size = float(np.max(np.abs(self.weight[:, None] * displacement), initial=0.0))

    def _ratio(self, rough: float, smooth: float, dt: float) -> float:
        """Return the error of a step over its share of the tolerance.

        Errors of motion that the step resolves well point the same way in
        every step: their sum is held. Those of faster motion come and go, and
        halving the step would not lessen them for long: their root mean square is held.
        """
        share, whole = dt / self.t_end, self.tolerance * self.size + _TINY
        return max(smooth / (share * whole), rough / (np.sqrt(share) * whole))

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.beyond

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""
        return min(self.now * self.tick, self.t_end)

    def _rung(self, rung: int) -> Factored:
        if rung not in self.ladder:
            self.ladder[rung] = self.factor(self.largest / 2**rung)
        return self.ladder[rung]

    def _pace(self, rung: int) -> Pace:
        if rung not in self.paces:
            self.paces[rung] = self.pace(self.largest / 2**rung)
        return self.paces[rung]

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps; the last one goes beyond the end, to complete the state there."""
        found = []
        for _ in range(_CHUNK):
            if self.beyond:
                break
            cursor, events = self._one(out, cursor)
            found.append(events)
        return cursor, np.concatenate(found)

    def _one(self, out: Output, cursor: int) -> tuple[int, Array]:
        while True:
            whole, half = self._rung(self.rung), self._rung(self.rung + 1)
            t, dt = self.now * self.tick, whole.dt
            middles = t + dt * np.array([0.5, 0.25, 0.75])
            values, springpots = self.bands.load_values(middles), self.springpots(middles)
            paces = self._pace(self.rung), self._pace(self.rung + 1)
            state = self.state
            laws = with_state(self.laws, state.memory)
            solves, rough, smooth = _try(
                self.matrices, self._rung(max(self.rung - 3, 0)).structure.factored, whole, half, self.rows, laws,
                self.bands.loads, values, state, self.trial, self.tried, self.weight, self.space, self.past,
                springpots, *paces, self.history, self.ahead,
            )  # fmt: skip
            self.complain(dt)
            last = self.rung + 1 >= _RUNGS
            if solves < 0 and last:
                raise ConvergenceError(
                    f"energy_conserving found no solution of the step from t = {t:g} s, however small; "
                    "a nonlinear spring that softens may leave none"
                )
            ratio = self._ratio(rough, smooth, dt) if solves >= 0 else np.inf
            if not ratio <= 1.0 and not last:
                self.bands.counters.rejected += 1
                self.rung += 1
                continue
            self.forced += ratio > 1.0
            cursor, events = _take(
                self.matrices, half.dt, self.rows, laws, self.bands.loads, values, t, state, self.trial,
                self.tried, self.trail, out, cursor, self.space, springpots, paces[1], self.history,
            )  # fmt: skip
            self.beyond = self.now >= self.end
            self.now += 2 ** (_RUNGS - self.rung)
            self.coarsest = max(self.coarsest, half.dt)
            self.steps += 0 if self.beyond else 2
            self.count(self.steps, solves)
            # The error over the step's length grows fourfold with a doubled step, and times stay multiples of steps.
            if ratio < 0.2 and self.rung > 0 and self.now % 2 ** (_RUNGS - self.rung + 1) == 0:
                self.rung -= 1
            return cursor, events


@jit
def _try(
    matrices: Matrices, filtering: Array, whole: Factored, half: Factored, rows: Rows, laws: Laws, loads: Array,
    values: Array, state: State, trial: Array, tried: Array, weight: Array, space: Scratch, past: Array,
    springpots: Springpots, pace: Pace, half_pace: Pace, history: History, ahead: History,
) -> tuple[int, float, float]:  # fmt: skip
    """Take a step whole and in halves; return contact solves, and errors of displacements.

    The second error is smoothed: ``(A^-1 M)^2`` of the first, A the matrix of
    a step eight times as long, which leaves what the step resolves well.
    The state stays as it is: mean velocities of the halves are left in
    `trial[0]` and `trial[1]`, reactions in `tried[0]` and `tried[1]`.
    """
    first, second, full, q, v = trial[0], trial[1], trial[2], trial[3], trial[4]
    n, m, remembers = state.q.size, state.u.size, history.y.shape[0] > 0
    load = np.zeros(n)
    combine(loads, values[:, 0], load)
    if remembers:
        impose(springpots, pace, history, 0, laws, state.u, 0.0, 1.0)
    full[:] = state.expected
    tried[2][:] = state.reaction
    a = step(matrices, whole, rows, laws, load, state.q, state.v, state.u, full, tried[2], space)
    combine(loads, values[:, 1], load)
    if remembers:
        impose(springpots, half_pace, history, 1, laws, state.u, 0.0, 1.0)
    first[:] = state.expected
    tried[0][:] = state.reaction
    b = step(matrices, half, rows, laws, load, state.q, state.v, state.u, first, tried[0], space)
    if a < 0 or b < 0:
        return -1, 0.0, 0.0
    for i in range(n):
        q[i] = state.q[i] + half.dt * first[i]
        v[i] = 2.0 * first[i] - state.v[i]
        second[i] = full[i] + (full[i] - first[i])
    u = np.empty(m)
    for j in range(m):
        u[j] = dot(rows, j, q)
    combine(loads, values[:, 2], load)
    tried[1][:] = tried[0]
    if past.size > 0:
        # The second half begins with what the first one leaves, should it be taken.
        past[:] = state.memory
        commit_all(laws, u)
    if remembers:
        ahead.y[:] = history.y
        for i in range(ahead.y.shape[0]):
            carry_on(springpots, half_pace, ahead, i, 1, dot(rows, springpots.row + i, first), 0.0)
        impose(springpots, half_pace, ahead, 2, laws, u, 0.0, 1.0)
    c = step(matrices, half, rows, laws, load, q, v, u, second, tried[1], space)
    if past.size > 0:
        state.memory[:] = past
    if c < 0:
        return -1, 0.0, 0.0
    # Velocities are not asked: those of fast modes, which hardly move anything, would dictate the step.
    rough, smooth = 0.0, 0.0
    for i in range(n):
        q[i] = (state.q[i] + whole.dt * full[i] - (q[i] + half.dt * second[i])) / 3.0
        rough = max(rough, weight[i] * abs(q[i]))
    for _ in range(2):
        v[:] = 0.0
        subtract_product(matrices.mass, q, v)
        solve(filtering, v)
        for i in range(n):
            q[i] = -v[i]
    for i in range(n):
        smooth = max(smooth, weight[i] * abs(q[i]))
    return a + b + c, rough, smooth


@jit
def _take(
    matrices: Matrices, dt: float, rows: Rows, laws: Laws, loads: Array, values: Array, t: float, state: State,
    trial: Array, tried: Array, before: Trail, out: Output, cursor: int, space: Scratch, springpots: Springpots,
    pace: Pace, history: History,
) -> tuple[int, Array]:  # fmt: skip
    """Accept both halves; return the cursor and the events."""
    load = np.zeros(state.q.size)
    events = np.empty((4 if state.status.size else 0, 3))
    # Not a literal, for which `accept` would be compiled once more.
    happened = cursor - cursor
    for k in range(2):
        combine(loads, values[:, k + 1], load)
        state.reaction[:] = tried[k]
        wanted, last = cursor, state.width[0]
        cursor, events, happened = accept(
            matrices, rows, laws, load, loads.shape[0] > 0, t + k * dt, dt, trial[k], state, before, out, cursor,
            events, happened, space,
        )  # fmt: skip
        if history.y.shape[0] > 0:
            accept_history(
                springpots, pace, history, rows, tried[k], k + 1, t + k * dt, last, trial[k], out, wanted, cursor
            )
    return cursor, events[:happened]
