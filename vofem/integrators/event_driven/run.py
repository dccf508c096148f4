"""The event-driven method: closed form between contact events, certified search for the next one.

Exact up to rounding for systems that are linear between events, with loads of
closed form and ideal switches; no step size, no order, no numerical
dissipation. Its cost is set by the number of events and by the slow motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.effects.time_functions import Piece, TimeFunction
from vofem.errors import EventStormError, MethodError
from vofem.integrators.base import (
    ContactSamples,
    Energies,
    Samples,
    initial_status,
    spring_force,
    status_at,
)
from vofem.integrators.event_driven.motion import Forcing, Motion, start_motion
from vofem.integrators.event_driven.search import EventFunctions, next_event
from vofem.integrators.event_driven.spectrum import ModalSpace, Spectra, modal_space
from vofem.system import CLOSED, OPEN, ContactLaws, Counters, Events, State, System

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Above this many degrees of freedom the dense eigensystems would need gigabytes.
MOST_UNKNOWNS = 6000

MOST_EVENTS = 1_000_000


def refusal(system: System) -> str | None:
    """Return why this method cannot treat the system and what can, or None."""
    for load in system.loads:
        if not load.function.closed_form:
            return (
                f"{load.name} has no closed form, which event_driven needs. Ways out: write it with Sine, Ramp, "
                "Pulse, Tabulated and their sums; tabulate it, vf.Tabulated(t, f(t)); or "
                "choose method='central_difference'"
            )
    if system.nonlinear is not None:
        return (
            f"NonlinearSpring {system.nonlinear.laws[0].name!r} is not piecewise linear, which event_driven needs. "
            "Choose method='central_difference'"
        )
    if system.contacts is not None and not system.contacts.ideal:
        k = int(np.argmax(np.isfinite(system.contacts.resolution)))
        return (
            f"Contact {system.contacts.names[k]!r} has a resolved switch, whose force is not piecewise linear; "
            "event_driven needs switch='ideal'. Choose method='central_difference'"
        )
    if system.size > MOST_UNKNOWNS:
        return (
            f"the system has {system.size} degrees of freedom, event_driven takes at most {MOST_UNKNOWNS} with "
            "all modes. Use fewer elements, or choose method='central_difference'"
        )
    return None


def run(system: System, start: State, t_end: float, times: Array, max_events: int = MOST_EVENTS) -> EventSolution:
    """Simulate from the start state at t = 0 to t_end.

    Parameters
    ----------
    system : System
    start : State
    t_end : float
        In s.
    times : ndarray
        Where results will be asked for; the run itself does not depend on it.
    max_events : int
        After so many contact events the run gives up.

    Raises
    ------
    MethodError
        If a load has no closed form, a switch is not ideal, or the system is too large.
    EventStormError
        If events follow each other without end.
    """
    reason = refusal(system)
    if reason is not None:
        raise MethodError(reason)
    counters = Counters()
    space = modal_space(system, counters)
    momentum = system.mass @ np.stack([start.q, start.v], axis=1)
    displacement, velocity = (space.shapes.T @ momentum).T
    solution = EventSolution(system, space, t_end, times, counters)
    status = solution.begin(start)
    breaks = [b for load in system.loads for b in load.function.breakpoints(t_end)]
    stops = [*np.unique(breaks), t_end]
    t, stop = 0.0, 0
    while t < t_end:
        while stops[stop] <= t:
            stop += 1
        motion = solution.add_segment(t, status, displacement, velocity)
        tau, duration = stops[stop] - t, stops[stop] - t
        hits = None
        if system.contacts is not None:
            functions = _event_functions(space, system.contacts, status)
            tau, hits, evaluations = next_event(functions, motion, duration)
            counters.gap_evaluations += evaluations * len(system.contacts)
        z, v = motion.modes(np.array([tau]))
        displacement, velocity = z[:, 0], v[:, 0]
        t = stops[stop] if tau >= duration else t + tau
        if hits is not None and np.any(hits):
            status = status.copy()
            status[hits] = np.where(status[hits] == CLOSED, OPEN, CLOSED)
            solution.add_events(t, np.flatnonzero(hits), status[hits])
            if counters.events > max_events:
                raise EventStormError(_storm(system, solution, t, max_events))
    return solution


def _event_functions(space: ModalSpace, laws: ContactLaws, status: Status) -> EventFunctions:
    """Return the functions to watch: s of open contacts, -s of closed ones."""
    sign = np.where(status == CLOSED, -1.0, 1.0)
    return EventFunctions(sign[:, None] * space.contacts, sign * laws.gap)


def _storm(system: System, solution: EventSolution, t: float, limit: int) -> str:
    assert system.contacts is not None
    busy = int(np.bincount(solution.events.contact).argmax())
    return (
        f"more than {limit} contact events by t = {t:.6g} s, most of them of contact "
        f"{system.contacts.names[busy]!r}: it chatters. Under acts_on='displacement' a state can rest at the gap "
        "where neither status holds; use acts_on='penetration', or raise max_events"
    )


class EventSolution:
    """The run as a sequence of linear segments, each known in closed form."""

    def __init__(self, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters) -> None:
        self.t_end = t_end
        self.times = times
        self.counters = counters
        self.notes: list[str] = []
        self.system = system
        self.space = space
        laws = system.contacts
        self._spectra = Spectra(
            space,
            np.empty(0) if laws is None else laws.stiffness,
            np.empty(0) if laws is None else laws.damping,
            counters,
        )
        self._starts: list[float] = []
        self._states: list[tuple[Status, Array, Array]] = []
        self._event_log: list[tuple[float, int, int]] = []
        self._initial = np.empty(0, dtype=np.int64)
        # Counters tell of the run; what sampling costs later is not counted.
        self._last: tuple[int, Motion] | None = None

    # -- recording --------------------------------------------------------------------------------

    def begin(self, start: State) -> Status:
        """Return and keep the contact status at t = 0."""
        laws = self.system.contacts
        if laws is not None:
            self._initial = initial_status(
                laws, laws.rows @ start.q, laws.rows @ start.v, abs(laws.rows) @ np.abs(start.q)
            )
            self.counters.gap_evaluations += len(laws)
        return self._initial

    def add_segment(self, t: float, status: Status, displacement: Array, velocity: Array) -> Motion:
        """Begin a segment at time t in a modal state."""
        self._starts.append(t)
        self._states.append((status, displacement, velocity))
        self.counters.steps += 1
        return self.motion(len(self._starts) - 1)

    def add_events(self, t: float, contacts: NDArray[np.int64], entered: Status) -> None:
        """Record contact events at time t."""
        self._event_log.extend((t, int(j), int(s)) for j, s in zip(contacts, entered, strict=True))
        self.counters.events += contacts.size

    @property
    def events(self) -> Events:
        """The contact events in order of time."""
        if not self._event_log:
            return Events(initial=self._initial)
        time, contact, status = zip(*self._event_log, strict=True)
        return Events(np.array(time), np.array(contact), np.array(status), self._initial)

    # -- segments ---------------------------------------------------------------------------------

    @property
    def segment_starts(self) -> Array:
        """Times at which the segments begin, shape (n_segments,)."""
        return np.array(self._starts)

    def segment_status(self, index: int) -> Status:
        """Return the contact status of a segment."""
        return self._states[index][0]

    def load_pieces(self, t: float) -> list[Piece]:
        """Return the closed form of every load near time t."""
        functions = [load.function for load in self.system.loads]
        return [function.piece(t) for function in functions if isinstance(function, TimeFunction)]

    def motion(self, index: int) -> Motion:
        """Return the closed form of a segment; the last one asked for is kept."""
        if self._last is None or self._last[0] != index:
            status, displacement, velocity = self._states[index]
            forcing = self._forcing(self._starts[index], status)
            spectrum = self._spectra[status]
            self._last = index, start_motion(spectrum, displacement, velocity, forcing, self.t_end)
        return self._last[1]

    def _forcing(self, t: float, status: Status) -> Forcing:
        """Return the modal force of loads and of the offsets of closed contacts."""
        space = self.space
        constant, slope = np.zeros(space.size), np.zeros(space.size)
        harmonics: dict[float, NDArray[np.complex128]] = {}
        for vector, piece in zip(space.loads, self.load_pieces(t), strict=True):
            constant += piece.constant * vector
            slope += piece.slope * vector
            for w, amplitude in piece.harmonics:
                harmonics[w] = harmonics.get(w, np.zeros(space.size, dtype=complex)) + amplitude * vector
        laws = self.system.contacts
        if laws is not None:
            closed = status == CLOSED
            constant += (laws.stiffness * laws.offset * closed) @ space.contacts
        omega = np.array(list(harmonics))
        waves = np.stack(list(harmonics.values()), axis=1) if harmonics else np.zeros((space.size, 0), dtype=complex)
        return Forcing(omega, waves, constant, slope)

    def visit(self, times: Array) -> list[tuple[int, NDArray[np.int64], Array]]:
        """Return (segment, indices into times, local times) for all segments that hold some of the times."""
        order = np.argsort(times, kind="stable")
        segment = np.searchsorted(self.segment_starts, times[order], side="right") - 1
        visited = []
        for index in np.unique(segment):
            mine = order[segment == index]
            visited.append((int(index), mine, times[mine] - self._starts[index]))
        return visited

    # -- sampling ---------------------------------------------------------------------------------

    def modal(self, times: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities at any times, each of shape (n, n_times)."""
        z, v = np.empty((self.space.size, times.size)), np.empty((self.space.size, times.size))
        for index, mine, tau in self.visit(times):
            z[:, mine], v[:, mine] = self.motion(index).modes(tau)
        return z, v

    def sample(self, times: Array) -> Samples:
        """Return the motion at any times; the acceleration is that of the equation of motion."""
        z, v = self.modal(times)
        return Samples(
            self.space.shapes @ z, self.space.shapes @ v, self.space.shapes @ self._acceleration(times, z, v)
        )

    def _acceleration(self, times: Array, z: Array, v: Array) -> Array:
        space = self.space
        a = -space.stiffness[:, None] * z - space.damping[:, None] * v
        if space.coupling is not None:
            a -= space.coupling @ v
        for vector, load in zip(space.loads, self.system.loads, strict=True):
            a += np.outer(vector, load.function(times))
        if self.system.contacts is not None:
            a -= space.contacts.T @ self._contact_force(times, z, v)
        return a

    def _contact_force(self, times: Array, z: Array, v: Array) -> Array:
        assert self.system.contacts is not None
        rows = self.space.contacts
        return spring_force(self.system.contacts, rows @ z, rows @ v, status_at(self.events, times))

    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force of the contacts at any times."""
        laws = self.system.contacts
        assert laws is not None
        z, v = self.modal(times)
        status = status_at(self.events, times)
        stiffness = np.where(status == CLOSED, laws.stiffness[:, None], 0.0)
        return ContactSamples(status, stiffness, self._contact_force(times, z, v))

    def energies(self, times: Array) -> Energies:
        """Return energies, dissipation and work at any times, in closed form."""
        from vofem.integrators.event_driven.energy import energies

        return energies(self, times)
