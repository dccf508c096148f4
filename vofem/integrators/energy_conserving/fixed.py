"""Runs of the midpoint rule at one step size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.energy_conserving.setting import Setting
from vofem.integrators.energy_conserving.step import (
    Factored,
    Forcing,
    Matrices,
    Scratch,
    State,
    accept,
    accept_history,
    combine,
    step,
)
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.stepping.march import chunk
from vofem.integrators.stepping.record import Output, Trail
from vofem.laws.rows import Rows
from vofem.laws.springpot import History, Pace, Springpots, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


class FixedSteps(Setting):
    """A run of equal steps. A state is complete, and stored, when the step after it is done."""

    place: tuple[str, ...] = ("done",)
    dt: float
    steps: int

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        self.dt, self.steps, self.done = dt, steps, 0
        self.factored = self.factor(dt)
        self.keep_history(dt, (steps + 1) * dt)
        self.step_pace = self.pace(dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done > self.steps

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""
        return max(self.done - 1, 0) * self.dt

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        first = self.done
        count = min(self.most_steps(chunk(self.state.q.size)), self.steps + 1 - first)
        middles = (np.arange(first, first + count, dtype=float) + 0.5) * self.dt
        values = self.load_values(self.bands.over.steps(first, count, self.dt))
        cursor, events, solves, failed = _advance(
            self.matrices, self.factored, self.rows, with_state(self.laws, self.state.memory), self.forcing, values,
            first, count, self.state, self.trail, out, cursor, self.space, self.springpots(middles), self.step_pace,
            self.history,
        )  # fmt: skip
        self.complain(self.dt)
        if failed >= 0:
            raise ConvergenceError(
                f"{ENERGY_CONSERVING.name} found no solution of the step from t = {failed * self.dt:g} s at dt = "
                f"{self.dt:g} s; a nonlinear spring that softens may leave none: reduce dt"
            )
        self.done += count
        self.count(min(self.done, self.steps), solves)
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
