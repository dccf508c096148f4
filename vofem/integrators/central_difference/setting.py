"""Runs of central differences: the start, the matrices of a step, and chunks of steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import Samples
from vofem.integrators.central_difference.step import Size, State, advance, scratch
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import MOST_FACTORED
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.setting import EqualSteps
from vofem.laws.evaluate import force_at
from vofem.linalg.banded import factor, solve, widen
from vofem.system import CLOSED
from vofem.system import State as Start

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class CentralDifference(EqualSteps):
    """A run of equal steps. The velocity of a state is known, and the state stored, when the step after it is done."""

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps, and begin."""
        super().plan(dt, steps)
        system, start, order = self.bands.system, self.start, self.bands.order
        if self.past is not None:
            self.past.begin_with_mean(start, dt)
        factored, implicit = system.cache.get("central-difference matrix", dt, self._factor, MOST_FACTORED)
        loads = np.concatenate([self.bands.loads, self.bands.answers(factored, self.matrices.stiffness)])
        self.size = Size(dt, factored, loads)
        self.space = scratch(system.size, implicit, 0 if self.past is None else self.past.count)
        self.start_acceleration = self._start_acceleration(start, self.status)
        # Second-order start: half a step back with the acceleration of the initial conditions.
        half = start.v[order] - 0.5 * dt * self.start_acceleration[order]
        self.state = State(start.q[order].copy(), half, self.status, self.laws.state)
        self.begin_at_start(np.zeros(system.size))

    def _factor(self) -> tuple[Array, tuple[Array, Array] | None]:
        """Return the factored ``M + dt C/2``, and `shape` and `compliance` of `Implicit`, or None."""
        a, _, c = self.matrices
        if c.size:
            width = max(a.shape[0], c.shape[0]) - 1
            a = widen(a, width) + 0.5 * self.dt * widen(c, width)
        self.bands.counters.factorizations += 1
        factored = factor(a, "the mass matrix")
        return factored, self._implicit(factored)

    def kinetic(self, samples: Samples) -> Array:
        """Return ``v_{n-1/2}' M v_{n+1/2} / 2`` at the stored times, J."""
        system = self.bands.system
        return kinetic_energy(system, samples.v) - (0.5 * self.dt) ** 2 * kinetic_energy(system, samples.a)

    def uncounted(self) -> float:
        """Return the energy that the loads at the last step give to a body at rest in half a step, J.

        The velocity at a step contains half a step of the present loads. Their work is counted with the velocities half
        a step before and after, so at a load that has just begun it is still zero.
        """
        impulse = self.space.load.copy()
        solve(self.size.factored, impulse)
        return 0.125 * self.dt**2 * float(self.space.load @ impulse)

    def advance(self, out: Record) -> None:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        taken = advance(
            self.size, self.equations, self.nodal_loads(first, count, self.dt), first, self.state, self.last_step, out,
            self.space, springpots,
        )  # fmt: skip
        self.complain(self.dt)
        self.done += taken
        # Forces are evaluated at both ends of the run.
        self.count(min(self.done, self.steps), self.done)

    def _start_acceleration(self, start: Start, status: IntArray) -> Array:
        """Return the acceleration that the equation of motion gives at t = 0, shape (n,)."""
        system, laws = self.bands.system, self.bands.system.contacts
        force = (self.nodal_loads(0, 1, self.dt)[:, 0] @ self.size.loads)[self.bands.back] - system.stiffness @ start.q
        if self.damping is not None:
            force -= self.damping @ start.v
        first = 0
        for group in system.laws:
            u, rate = np.asarray(group.rows @ start.q), np.asarray(group.rows @ start.v)
            if group is laws:
                ideal = np.isinf(laws.resolution)
                share = np.where(ideal, np.where(status == CLOSED, 1.0, 0.0), laws.shares(u - laws.gap))
                pull = share * (laws.elastic(u) + laws.damping * rate)
            elif self.past is not None and first == self.past.row:
                pull = self.past.means()
            else:
                pull = np.array([force_at(self.laws, first + i, float(x)) for i, x in enumerate(u)])
            force -= group.rows.T @ pull
            first += len(group)
        banded = force[self.bands.order]
        solve(factor(self.matrices.mass, "the mass matrix"), banded)
        return banded[self.bands.back]

    def _implicit(self, factored: Array) -> tuple[Array, Array] | None:
        """Return ``A^-1 B'`` and ``B A^-1 B'`` of laws whose forces follow from rates; None where there are none.

        B has the rows of all laws; columns of other laws are zero.
        """
        system, rows = self.bands.system, self.every_row
        which = np.flatnonzero(self.laws.table["damping"] > 0.0).tolist()
        if self.past is not None:
            which += range(self.past.row, self.past.row + self.past.count)
        if rows is None or not which:
            return None
        dense = rows.toarray()[:, self.bands.order]
        shape = np.zeros((system.size, dense.shape[0]))
        for j in which:
            column = dense[j].copy()
            solve(factored, column)
            shape[:, j] = column
        return shape, dense @ shape
