"""Runs of the midpoint rule at one step size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
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
from vofem.integrators.stepping.record import Output, Trail
from vofem.integrators.stepping.setting import EqualSteps, Matrices
from vofem.laws.rows import Rows
from vofem.laws.springpot import History, Pace, Springpots, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


class FixedSteps(EqualSteps, Midpoint):
    """A run of equal steps. A state is complete, and stored, when the step after it is done."""

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        super().plan(dt, steps)
        self.factored = self.factor(dt)

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        values = self.load_values(self.bands.over.steps(first, count, self.dt))
        cursor, events, solves, failed = _advance(
            self.matrices, self.factored, self.rows, with_state(self.laws, self.state.memory), self.forcing, values,
            first, count, self.state, self.trail, out, cursor, self.space, springpots, self.step_pace, self.history,
        )  # fmt: skip
        self.complain(self.dt)
        if failed >= 0:
            raise ConvergenceError(
                f"{ENERGY_CONSERVING.name} found no solution of the step from t = {failed * self.dt:g} s at dt = "
                f"{self.dt:g} s; a nonlinear spring that softens may leave none: reduce dt"
            )
        self.done += count
        done = min(self.done, self.steps)
        self.count(done, done, solves)
        return cursor, events


@jit
def _advance(
    matrices: Matrices, factored: Factored, rows: Rows, laws: Laws, total: Forcing, values: Array, first: int,
    count: int, state: State, before: Trail, out: Output, cursor: int, space: Scratch, springpots: Springpots,
    pace: Pace, history: History,
) -> tuple[int, Array, int, int]:  # fmt: skip
    """Take `count` steps; return the cursor, events, number of contact solves, and the step that failed or -1."""
    p, dt, loaded = np.empty(state.q.size), factored.dt, values.shape[0] > 0
    events = np.empty((16 if state.status.size else 0, 3))
    # Not literals, for which `accept` would be compiled once more.
    happened, solves = count - count, count - count
    for k in range(first, first + count):
        combine(factored, values[:, k - first], total)
        p[:] = state.expected
        if history.y.shape[0] > 0:
            impose(springpots, pace, history, k - first, laws, state.u, 0.0, 1.0)
        found = step(matrices, factored, rows, laws, total.push, state.q, state.v, state.u, p, state.reaction, space)
        if found < 0:
            return cursor, events[:happened], solves, k
        solves += found
        wanted, last = cursor, state.width[0]
        cursor, events, happened = accept(
            matrices, rows, laws, total, loaded, k * dt, dt, p, state, before, out, cursor, events,
            happened, space,
        )  # fmt: skip
        if history.y.shape[0] > 0:
            accept_history(
                springpots, pace, history, rows, state.reaction, k - first, k * dt, last, p, out, wanted, cursor
            )
    return cursor, events[:happened], solves, -1
