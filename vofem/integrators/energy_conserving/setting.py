"""What runs of the midpoint rule have in common, whatever their step sizes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.energy_conserving.step import Factored, State, forcing, scratch
from vofem.integrators.stepping.balance import structure
from vofem.integrators.stepping.march import MOST_FACTORED
from vofem.integrators.stepping.setting import Setting
from vofem.linalg.banded import widen
from vofem.system import Counters, System
from vofem.system import State as Start

Array = NDArray[np.float64]


class Midpoint(Setting):
    """The state of a run, and the matrices of its step sizes."""

    def __init__(self, system: System, start: Start, counters: Counters, t_end: float) -> None:
        super().__init__(system, start, counters, t_end)
        order, n, m = self.bands.order, system.size, self.laws.table.size
        q, v = start.q[order].copy(), start.v[order].copy()
        self.state = State(
            q, v, np.zeros(n), v.copy(), v.copy(), self.u, np.zeros(m), self.status, np.zeros(2), self.laws.state
        )
        self.space = scratch(n, self.laws)
        self.forcing = forcing(n, bool(system.loads))
        self.begin_at_start(self.state.acceleration)

    def factor(self, dt: float) -> Factored:
        """Return the factored matrix of a step size, with the compliance of the laws' rows."""
        return self.bands.system.cache.get("midpoint matrix", dt, lambda: self._factor(dt), MOST_FACTORED)

    def _factor(self, dt: float) -> Factored:
        mass, stiffness, c = self.matrices
        width = max(part.shape[0] for part in self.matrices) - 1
        a = widen(mass, width) + (0.25 * dt**2) * widen(stiffness, width)
        if c.size:
            a += 0.5 * dt * widen(c, width)
        self.bands.counters.factorizations += 1
        answer = structure(a, "the matrix of a step", self.rows, self.laws, dt, 0.5 * dt)
        second = 0.5 * dt**2 * self.bands.answers(answer.factored, stiffness)
        inertia = dt * self.bands.answers(answer.factored, mass)
        loads = np.concatenate([self.bands.loads, second])
        return Factored(
            dt, answer, loads, dt * self.bands.answers(answer.factored, np.ones((1, mass.shape[1]))), inertia
        )

    def load_values(self, moments: Array) -> Array:
        """Return the moments of loads as `combine` takes them, shape (3 n_loads, n_steps)."""
        return np.concatenate([moments[0], -moments[2], moments[1]])
