"""What runs of the midpoint rule have in common, whatever their step sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.energy_conserving.step import Factored, Matrices, State, forcing, scratch
from vofem.integrators.stepping.balance import structure
from vofem.integrators.stepping.checks import check_times, watch
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import MOST_FACTORED, Banded, tally
from vofem.integrators.stepping.probes import tap
from vofem.integrators.stepping.record import Output, leave, output, trail
from vofem.laws import SpringpotLaws, initial_status
from vofem.laws.callbacks import callbacks_of
from vofem.laws.evaluate import loaded
from vofem.laws.rows import all_rows, compressed
from vofem.laws.springpot import NO_HISTORY, NO_PACE, NO_SPRINGPOTS, Pace, Springpots
from vofem.laws.table import build_laws
from vofem.linalg.banded import to_band, widen
from vofem.system import Counters, System
from vofem.system import State as Start

if TYPE_CHECKING:
    from vofem.integrators.stepping.history import Springpotted

Array = NDArray[np.float64]


class Setting:
    """A system in band storage, its laws, and the state of a run."""

    place: tuple[str, ...] = ()
    #: Size of all steps in s; None where they follow a tolerance.
    dt: float | None = None

    def __init__(self, system: System, start: Start, counters: Counters, t_end: float = np.inf) -> None:
        damping = damping_matrix(system, counters)
        self.bands = Banded(system, counters, system.mass, system.stiffness, damping)
        self.bands.over.until = t_end
        order, n = self.bands.order, system.size
        self.callbacks = callbacks_of(system.laws)
        self.laws = build_laws(system.laws, self.callbacks)
        rows = all_rows(system.laws)
        self.rows = compressed(rows, order)
        c = np.empty((0, n)) if damping is None else to_band(damping, order)
        self.matrices = Matrices(to_band(system.mass, order), to_band(system.stiffness, order), c)
        status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            status = initial_status(system.contacts, start.q, start.v)
        m = self.laws.table.size
        u = np.zeros(0) if rows is None else np.asarray(rows @ start.q)
        q, v = start.q[order].copy(), start.v[order].copy()
        self.laws = loaded(self.laws, u, start.memory)
        past = self.laws.state
        self.state = State(q, v, np.zeros(n), v.copy(), v.copy(), u, np.zeros(m), status, np.zeros(2), past)
        self.space = scratch(n, m)
        self.forcing = forcing(n)
        self.start, self.history = start, NO_HISTORY
        self.springpotted: Springpotted | None = None
        self.trail = trail(n, past)
        leave(self.trail, q, v, self.state.acceleration)

    def keep_history(self, shortest: float, t_end: float) -> None:
        """Let springpots, where there are any, keep their past in steps not below one in s, up to a time in s."""
        if self.bands.system.group(SpringpotLaws) is None:
            return
        from vofem.integrators.stepping.history import Springpotted

        self.springpotted = Springpotted(self.bands.system, shortest, t_end, self.bands.counters)
        self.history = self.springpotted.begin(self.start)
        self.place = (*self.place, "history")

    def springpots(self, times: Array) -> Springpots:
        """Return the springpots at the orders of some times in s."""
        return NO_SPRINGPOTS if self.springpotted is None else self.springpotted.at(times)

    def most_steps(self, count: int) -> int:
        """Return for how many steps, at most the given number, weights of springpots are computed at once."""
        return count if self.springpotted is None else self.springpotted.most_steps(count)

    def pace(self, dt: float) -> Pace:
        """Return what a step of a size in s does to the past of springpots."""
        return NO_PACE if self.springpotted is None else self.springpotted.pace(dt)

    def output(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Output:
        """Return an empty record of the run at some times, and of points at every step.

        With the end of the run in s, also of what it looks at to judge itself.
        """
        system, looks = self.bands.system, None
        if t_end is not None:
            looks = check_times(t_end, self.dt, system.size), watch(system.contacts)
        points = tap(probes, self.bands.order)
        return output(times, system.size, points, system.histories, self.laws.state.size, looks)

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

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def load_values(self, moments: Array) -> Array:
        """Return the moments of loads as `combine` takes them, shape (3 n_loads, n_steps)."""
        return np.concatenate([moments[0], -moments[2], moments[1]])

    def complain(self, dt: float) -> None:
        """Raise what nonlinear springs have to complain of."""
        if self.callbacks is not None:
            self.callbacks.complain(dt)

    def count(self, steps: int, solves: int) -> None:
        """Enter into the counters: steps in all, and contact solves that were added."""
        tally(self.bands, self.laws, self.callbacks, steps, steps)
        self.bands.counters.contact_solves += solves
