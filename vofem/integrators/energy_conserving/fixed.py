"""Runs of the midpoint rule at one step size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
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
from vofem.integrators.stepping.record import LastStep, Record
from vofem.integrators.stepping.setting import EqualSteps, Equations
from vofem.kernels.jit import jit
from vofem.laws.springpot_steps import Springpots, set_means
from vofem.laws.table import Laws
from vofem.linalg.vectors import copy

Array = NDArray[np.float64]


class FixedSteps(EqualSteps, Midpoint):
    """A run of equal steps. A state is complete, and stored, when the step after it is done."""

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        super().plan(dt, steps)
        self.factored = self.factor(dt)

    def advance(self, out: Record) -> None:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        values = self.load_values(self.bands.over.steps(first, count, self.dt))
        taken, solves, failed = _advance(
            self.equations, self.factored, self.forcing, values, first, self.state, self.last_step, out, self.space,
            springpots,
        )  # fmt: skip
        self.complain(self.dt)
        if failed:
            raise ConvergenceError(
                f"{ENERGY_CONSERVING.name} found no solution of the step from t = {(first + taken) * self.dt:g} s at "
                f"dt = {self.dt:g} s; a nonlinear spring that softens may leave none: reduce dt"
            )
        self.done += taken
        done = min(self.done, self.steps)
        self.count(done, done, solves)


@jit
def _advance(
    equations: Equations, factored: Factored, forcing: Forcing, values: Array, first: int, state: State,
    before: LastStep, out: Record, space: Scratch, springpots: Springpots | None,
) -> tuple[int, int, bool]:  # fmt: skip
    """Take the steps that `values` has columns for, as long as there is room for their events.

    Returns
    -------
    taken, solves : int
        Number of steps, and of those in which a law acted.
    failed : bool
        Whether the step after them has no solution.
    """
    dt, count, contacts = factored.dt, values.shape[1], state.status.size
    start, found, solves = Start(state.q, state.v, state.u), Found(space.rate, state.reaction), 0
    for k in range(count):
        if out.happened[0] + contacts > out.events.shape[0]:
            return k, solves, False
        combine(factored, values, k, forcing)
        copy(state.expected, found.p)
        _set_springpots(springpots, k, equations.laws, state.u)
        solved = step(equations, factored, forcing.push, start, found, space)
        if solved < 0:
            return k, solves, True
        solves += solved
        t, last = (first + k) * dt, state.width[0]
        accept(equations, factored, forcing, t, found.p, state, before, out, space)
        accept_springpots(springpots, k, t, last, found, equations.rows, out)
    return count, solves, False


@jit
def _set_springpots(springpots: Springpots | None, s: int, laws: Laws, u: Array) -> None:
    if springpots is not None:
        set_means(springpots, s, laws, u)
