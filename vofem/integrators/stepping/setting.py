"""What runs of all methods that step in time have in common: matrices, laws and records, and chunks of equal steps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.stepping.checks import check_times, contact_checks
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import Banded, chunk, tally
from vofem.integrators.stepping.probes import tap
from vofem.integrators.stepping.record import LastStep, Record, leave, no_step, record_of
from vofem.laws import initial_status
from vofem.laws.callbacks import callbacks_of
from vofem.laws.evaluate import loaded
from vofem.laws.group import StepPast
from vofem.laws.rows import Rows, all_rows, compressed
from vofem.laws.table import Laws, build_laws
from vofem.linalg.banded import to_band
from vofem.system import Counters, State, System

Array = NDArray[np.float64]


class Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped)."""

    mass: Array
    stiffness: Array
    damping: Array


class Equations(NamedTuple):
    """What compiled loops need of a system: M, K and C in band storage, and the laws with their rows."""

    matrices: Matrices
    rows: Rows
    laws: Laws


class Setting:
    """A system in band storage, its laws, and what a run records.

    A method derives from it and adds its state, `finished`, `reached` and `advance`; see `march.Kernel`.

    Attributes
    ----------
    place : tuple of str
        Names of the attributes that, beside `state` and `last_step`, make up the state of the run.
    dt : float, optional
        Size of all steps in s; None where they follow a tolerance.
    damping : csr_matrix, optional
        C in the order of the system.
    state : NamedTuple of ndarray
        The current state; changed in place.
    u, status : ndarray, shape (n_laws,), (n_contacts,)
        Coordinates of the laws and status of the contacts at t = 0.
    last_step : LastStep
    past : StepPast, optional
        Of laws whose force over a step depends on earlier steps, such as springpots.
    """

    place: tuple[str, ...] = ()
    dt: float | None = None
    last_step: LastStep
    state: Any
    past: StepPast | None = None

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
        self.laws = loaded(build_laws(system.laws, self.callbacks), self.u, start.internal)
        self.status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            self.status = initial_status(system.contacts, start.q, start.v)
        self.equations = Equations(self.matrices, self.rows, self.laws)

    def begin_at_start(self, acceleration: Array) -> None:
        """Set `last_step` to the start, with an acceleration in band order."""
        order = self.bands.order
        self.last_step = no_step(order.size, self.laws.state)
        leave(self.last_step, self.start.q[order], self.start.v[order], acceleration)

    # -- laws whose force depends on earlier steps ------------------------------------------------

    @property
    def history(self) -> Any:
        """Internal variables of the laws whose force over a step depends on earlier steps, part of a checkpoint."""
        return None if self.past is None else self.past.state

    @history.setter
    def history(self, saved: Any) -> None:
        assert self.past is not None
        for mine, other in zip(self.past.state, saved, strict=True):
            mine[...] = other

    def keep_past(self, shortest: float, t_end: float) -> None:
        """Set up the internal variables of these laws for steps of at least `shortest` s, up to `t_end` s."""
        system, counters = self.bands.system, self.bands.counters
        for group in system.laws:
            past = group.past_in_steps(system.first_of(group), shortest, t_end)
            if past is not None:
                # A rough run before the run itself takes fewer.
                counters.history_terms = max(counters.history_terms, past.terms)
                past.begin(self.start)
                self.past, self.place = past, (*self.place, "history")

    def over(self, dt: float, times: Array) -> Any:
        """Return what compiled loops need of these laws for steps of a size, given a time within each; or None."""
        return None if self.past is None else self.past.over(dt, times)

    def most_steps(self, count: int) -> int:
        """Return the number of steps, at most `count`, for which `over` is called once."""
        return count if self.past is None else self.past.most_steps(count)

    # -- records and checks -----------------------------------------------------------------------

    def record(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Record:
        """Return an empty record of the run at some times, and of points at every step.

        Where the end of the run in s is given, the record also holds what the checks of the run need.
        """
        system, checks = self.bands.system, None
        if t_end is not None:
            checks = check_times(t_end, self.dt, system.size), contact_checks(system.contacts)
        points = tap(probes, self.bands.order)
        return record_of(
            times, system.size, self.status.size, points, system.histories, self.laws.state.size, checks
        )  # fmt: skip

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def uncounted(self) -> float:
        """Return a bound on the energy that loads have given until `last_step`, beyond the work counted there, J."""
        return 0.0

    def complain(self, dt: float) -> None:
        """Raise the error that a law written in Python has reported."""
        if self.callbacks is not None:
            self.callbacks.complain(dt)

    def count(self, steps: int, evaluations: int, solves: int = 0) -> None:
        """Set the counters of steps and of evaluations of laws, and add contact solves."""
        tally(self.bands, self.laws, self.callbacks, steps, evaluations)
        if self.past is not None:
            self.bands.counters.history_updates = self.past.count * evaluations
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
        self.keep_past(dt, (steps + self.lag) * dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done >= self.steps + self.lag

    def reached(self) -> float:
        """Return the time of the state in `last_step`, s."""
        return max(self.done - self.lag, 0) * self.dt

    def next_chunk(self) -> tuple[int, int, Any]:
        """Return the next step, the number of steps in the next chunk, and what `over` returns for them."""
        first = self.done
        count = min(self.most_steps(chunk(self.bands.system.size)), self.steps + self.lag - first)
        return first, count, self.over(self.dt, (np.arange(first, first + count, dtype=float) + 0.5) * self.dt)
