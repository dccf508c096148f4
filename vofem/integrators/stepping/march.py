"""The loop around a compiled kernel: events, energy checks, interruption, and what is left behind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.errors import InstabilityError
from vofem.integrators.base import Energies, Samples
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.energies import contact_energy, kinetic_energy, strain_energy
from vofem.integrators.stepping.record import Output, Trail
from vofem.linalg.banded import band_order
from vofem.system import Counters, Events, State, System

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Told the time reached, in s, from time to time.
Progress = Callable[[float], None]

#: Entries of states that are advanced between two looks at the outcome: some tenths of a second of work.
_CHUNK_WORK = 1_000_000


def chunk(size: int) -> int:
    """Return the number of steps of `size` unknowns to take between two looks at the outcome."""
    return int(np.clip(_CHUNK_WORK // max(size, 1), 1, 8192))


class Banded:
    """A system's unknowns in an order that keeps its band narrow, and its loads."""

    def __init__(self, system: System, counters: Counters, *matrices: object) -> None:
        self.system, self.counters = system, counters
        self.order = band_order(*(matrix for matrix in matrices if matrix is not None))
        self.back = np.empty(system.size, dtype=np.int64)
        self.back[self.order] = np.arange(system.size)
        self.loads = np.array([load.vector[self.order] for load in system.loads]).reshape(-1, system.size)

    def load_values(self, t: Array) -> Array:
        """Return the loads' functions at times t, shape (n_loads, n_times)."""
        self.counters.load_evaluations += t.size * len(self.system.loads)
        return np.array([load.function(t) for load in self.system.loads]).reshape(-1, t.size)


class Kernel(Protocol):
    """A method with its matrices and its state, unknowns in band order."""

    bands: Banded
    trail: Trail

    @property
    def finished(self) -> bool:
        """Whether the run is done."""

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps; return the output cursor and the events (time, contact, status), one a row."""

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy of the method's own balance at the stored times, J."""


def march(
    kernel: Kernel,
    method: str,
    start: State,
    initial: IntArray,
    t_end: float,
    dt: float,
    out: Output,
    notes: list[str],
    *,
    first_energy: float,
    blow_up: float,
    progress: Progress | None,
) -> SteppedSolution:
    """Run a kernel to its end, or until it is interrupted, and return what it leaves behind.

    Parameters
    ----------
    kernel : Kernel
    method : str
        For messages.
    start : State
    initial : ndarray of int, shape (n_contacts,)
        Status of the contacts at t = 0.
    t_end, dt : float
        In s.
    out : Output
    notes : list of str
    first_energy : float
        At t = 0, in the method's own form, J.
    blow_up : float
        Energy out of nowhere, over the energies at work, that ends a run.
    progress : callable, optional

    Raises
    ------
    InstabilityError
        If energy grows beyond what the loads can have done, or a state is no longer finite.
    """
    system, counters = kernel.bands.system, kernel.bands.counters
    energy = stored_energy(system, start.q, start.v)
    log: list[Array] = []
    cursor = 0
    try:
        while not kernel.finished:
            cursor, new = kernel.advance(out, cursor)
            if new.size:
                log.append(new)
            _check(kernel, method, energy, dt, blow_up)
            if progress is not None:
                progress(kernel.reached())
    except KeyboardInterrupt:
        reached = kernel.reached()
        if cursor == 0:
            raise
        notes.append(f"interrupted at t = {reached:g} s of {t_end:g} s: what was computed until then is here")
        t_end = float(out.times[cursor - 1])
        out = Output(*(part[..., :cursor].copy() for part in out))
    events = Events(initial=initial)
    if log:
        time, which, entered = np.concatenate(log).T
        events = Events(time.copy(), which.astype(np.int64), entered.astype(np.int64), initial)
    counters.events = events.time.size
    back = kernel.bands.back
    samples = Samples(out.q[back], out.v[back], out.a[back])
    parts = Energies(
        kernel.kinetic(samples), strain_energy(system, samples.q), contact_energy(system.contacts, samples.q),
        out.dissipated, out.work,
    )  # fmt: skip
    return SteppedSolution(system, t_end, out.times, samples, parts, first_energy, dt, events, counters, notes)


def note_chatter(system: System, notes: list[str]) -> None:
    """Tell what a step does to a contact that should rest at its gap."""
    if system.contacts is not None and bool(np.any(system.contacts.jump & (system.contacts.gap > 0))):
        notes.append(
            "chatter: under acts_on='displacement' a contact that should rest at its gap chatters with the amplitude "
            "of a step; method='event_driven' pins it"
        )


def stored_energy(system: System, q: Array, v: Array) -> float:
    """Return kinetic, strain and contact energy of one state, unknowns in the system's order, J."""
    column, rate = q[:, None], v[:, None]
    parts = kinetic_energy(system, rate), strain_energy(system, column), contact_energy(system.contacts, column)
    return float(sum(part[0] for part in parts))


def _check(kernel: Kernel, method: str, first: float, dt: float, blow_up: float) -> None:
    trail, back = kernel.trail, kernel.bands.back
    now = stored_energy(kernel.bands.system, trail.q[back], trail.v[back])
    work, dissipated = float(trail.work[1]), float(trail.dissipated[1])
    scale = abs(first) + abs(work) + abs(dissipated)
    if not now - first - work + dissipated <= blow_up * scale + 1e-300:
        raise InstabilityError(
            f"{method} blew up before t = {kernel.reached():g} s: energy {now:.3g} J, from {first:.3g} J at the start "
            f"and {work:.3g} J of work; reduce dt = {dt:g} s, or choose method='event_driven', or "
            "method='energy_conserving' where that does not apply"
        )
