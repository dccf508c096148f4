"""What runs of all methods that step in time have in common: matrices, laws and records, and chunks of equal steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.stepping.checks import check_times, watch
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import Banded, chunk, tally
from vofem.integrators.stepping.probes import tap
from vofem.integrators.stepping.record import Output, Trail, leave, output, trail
from vofem.laws import SpringpotLaws, initial_status
from vofem.laws.callbacks import callbacks_of
from vofem.laws.evaluate import loaded
from vofem.laws.rows import all_rows, compressed
from vofem.laws.springpot import NO_HISTORY, NO_PACE, NO_SPRINGPOTS, Pace, Springpots
from vofem.laws.table import build_laws
from vofem.linalg.banded import to_band
from vofem.system import Counters, State, System

if TYPE_CHECKING:
    from vofem.integrators.stepping.history import Springpotted

Array = NDArray[np.float64]


class Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped)."""

    mass: Array
    stiffness: Array
    damping: Array


class Setting:
    """A system in band storage, its laws, and what a run records.

    A method derives from it and adds its state, `finished`, `reached` and `advance`; see `march.Kernel`.

    Attributes
    ----------
    place : tuple of str
        Names of the attributes that, beside `state` and `trail`, make up the state of the run.
    dt : float, optional
        Size of all steps in s; None where they follow a tolerance.
    damping : csr_matrix, optional
        C in the order of the system.
    state : NamedTuple of ndarray
        The current state; changed in place.
    u, status : ndarray, shape (n_laws,), (n_contacts,)
        Coordinates of the laws and status of the contacts at t = 0.
    """

    place: tuple[str, ...] = ()
    dt: float | None = None
    trail: Trail
    state: Any

    def __init__(self, system: System, start: State, counters: Counters, t_end: float) -> None:
        self.start, self.damping = start, damping_matrix(system, counters)
        self.bands = Banded(system, counters, system.mass, system.stiffness, self.damping)
        self.bands.over.until = t_end
        order = self.bands.order
        c = np.empty((0, system.size)) if self.damping is None else to_band(self.damping, order)
        self.matrices = Matrices(to_band(system.mass, order), to_band(system.stiffness, order), c)
        self.callbacks = callbacks_of(system.laws)
        self.every_row = all_rows(system.laws)
        self.rows = compressed(self.every_row, order)
        self.u = np.zeros(0) if self.every_row is None else np.asarray(self.every_row @ start.q)
        self.laws = loaded(build_laws(system.laws, self.callbacks), self.u, start.memory)
        self.status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            self.status = initial_status(system.contacts, start.q, start.v)
        self.history = NO_HISTORY
        self.springpotted: Springpotted | None = None

    def begin_trail(self, acceleration: Array) -> None:
        """Set `trail` to the start, with an acceleration in band order."""
        order = self.bands.order
        self.trail = trail(order.size, self.laws.state)
        leave(self.trail, self.start.q[order], self.start.v[order], acceleration)

    # -- springpots -------------------------------------------------------------------------------

    def keep_history(self, shortest: float, t_end: float) -> None:
        """Set up the internal variables of springpots for steps of at least `shortest` s, up to `t_end` s."""
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
        """Return the number of steps, at most `count`, for which weights of springpots are computed together."""
        return count if self.springpotted is None else self.springpotted.most_steps(count)

    def pace(self, dt: float) -> Pace:
        """Return the update of the internal variables of springpots over a step of a size in s."""
        return NO_PACE if self.springpotted is None else self.springpotted.pace(dt)

    # -- records and checks -----------------------------------------------------------------------

    def output(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Output:
        """Return an empty record of the run at some times, and of points at every step.

        Where the end of the run in s is given, the record also holds what the checks of the run need.
        """
        system, looks = self.bands.system, None
        if t_end is not None:
            looks = check_times(t_end, self.dt, system.size), watch(system.contacts)
        points = tap(probes, self.bands.order)
        return output(times, system.size, points, system.histories, self.laws.state.size, looks)

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def complain(self, dt: float) -> None:
        """Raise the error that a law written in Python has reported."""
        if self.callbacks is not None:
            self.callbacks.complain(dt)

    def count(self, steps: int, evaluations: int, solves: int = 0) -> None:
        """Set the counters of steps and of evaluations of laws, and add contact solves."""
        tally(self.bands, self.laws, self.callbacks, steps, evaluations)
        self.bands.counters.contact_solves += solves

    def nodal_loads(self, first: int, count: int, dt: float) -> Array:
        """Return the loads at ends of steps as weighted means, then second moments, shape (2 n_loads, count)."""
        mean, second = self.bands.over.nodal(first, count, dt)
        return np.concatenate([mean, -0.5 * dt**2 * second])


class EqualSteps(Setting):
    """A run of equal steps, taken in chunks.

    Attributes
    ----------
    lag : int
        0 where a state is complete, and stored, at the end of its step; 1 where the step after it completes it.
    """

    place: tuple[str, ...] = ("done",)
    lag = 1
    dt: float
    steps: int

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        self.dt, self.steps, self.done = dt, steps, 0
        self.keep_history(dt, (steps + self.lag) * dt)
        self.step_pace = self.pace(dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done >= self.steps + self.lag

    def reached(self) -> float:
        """Return the time of the state in `trail`, s."""
        return max(self.done - self.lag, 0) * self.dt

    def next_chunk(self) -> tuple[int, int, Springpots]:
        """Return the next step, the number of steps in the next chunk, and the springpots in them."""
        first = self.done
        count = min(self.most_steps(chunk(self.bands.system.size)), self.steps + self.lag - first)
        return first, count, self.springpots((np.arange(first, first + count, dtype=float) + 0.5) * self.dt)
