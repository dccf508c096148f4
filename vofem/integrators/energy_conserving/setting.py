"""What runs of the midpoint rule have in common, whatever their step sizes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import Samples, initial_status
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.energy_conserving.step import Factored, Matrices, State, scratch
from vofem.integrators.stepping.balance import structure
from vofem.integrators.stepping.callbacks import Callbacks
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.laws import build_laws, loaded
from vofem.integrators.stepping.march import Banded, tally
from vofem.integrators.stepping.record import leave, trail
from vofem.integrators.stepping.rows import all_rows, compressed
from vofem.linalg.banded import to_band, widen
from vofem.system import Counters, System
from vofem.system import State as Start

Array = NDArray[np.float64]


class Setting:
    """A system in band storage, its laws, and the state of a run."""

    def __init__(self, system: System, start: Start, counters: Counters) -> None:
        damping = damping_matrix(system, counters)
        self.bands = Banded(system, counters, system.mass, system.stiffness, damping)
        order, n = self.bands.order, system.size
        self.callbacks = None if system.nonlinear is None else Callbacks(system.nonlinear.laws)
        self.laws = build_laws(system, self.callbacks)
        rows = all_rows(system)
        self.rows = compressed(rows, order)
        c = np.empty((0, n)) if damping is None else to_band(damping, order)
        self.matrices = Matrices(to_band(system.mass, order), to_band(system.stiffness, order), c)
        status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            status = initial_status(system.contacts, start.q, start.v)
        m = self.laws.kind.size
        u = np.zeros(0) if rows is None else np.asarray(rows @ start.q)
        q, v = start.q[order].copy(), start.v[order].copy()
        self.laws = loaded(self.laws, u, start.memory)
        past = self.laws.state
        self.state = State(q, v, np.zeros(n), v.copy(), v.copy(), u, np.zeros(m), status, np.zeros(1), past)
        self.space = scratch(n, m)
        self.trail = trail(n, past)
        leave(self.trail, q, v, self.state.acceleration)

    def factor(self, dt: float) -> Factored:
        """Return the factored matrix of a step size, with the compliance of the laws' rows."""
        mass, stiffness, c = self.matrices
        width = max(part.shape[0] for part in self.matrices) - 1
        a = widen(mass, width) + (0.25 * dt**2) * widen(stiffness, width)
        if c.size:
            a += 0.5 * dt * widen(c, width)
        self.bands.counters.factorizations += 1
        return Factored(dt, structure(a, "the matrix of a step", self.rows, self.laws, dt, 0.5 * dt))

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def complain(self, dt: float) -> None:
        """Raise what nonlinear springs have to complain of."""
        if self.callbacks is not None:
            self.callbacks.complain(dt)

    def count(self, steps: int, solves: int) -> None:
        """Enter into the counters: steps in all, and contact solves that were added."""
        tally(self.bands, self.laws, self.callbacks, steps, steps)
        self.bands.counters.contact_solves += solves
