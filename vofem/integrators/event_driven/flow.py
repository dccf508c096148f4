"""The flow of a system over a time, with its exact derivative. Shooting finds periodic orbits with it.

`flow` follows a modal state from one time to another in closed form between
events, as a run does, and computes how perturbations grow. Runs of one system
share its modes and the eigensystems of its contact statuses through
`System.cache`; `share_modes` lets other systems with the same matrices use
them too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import EventStormError
from vofem.integrators.event_driven.follow import Follower
from vofem.integrators.event_driven.modal_space import ModalSpace, modal_space
from vofem.integrators.event_driven.pinned import PIN_FRACTION
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.tangent import acceleration, drifted
from vofem.system import OPEN, Counters, State, System

Status = NDArray[np.int64]

#: Largest number of events in one flow.
MOST_EVENTS = 10_000

#: With fewer segments the size of a motion is also computed at these shares of the time.
_FEW, _INSIDE = 4, np.array([0.13, 0.37, 0.61, 0.86])

#: Velocity of a motion that hardly moves about a deflection, over that of a vibration as large as the deflection.
_STILL = 1e-4


@dataclass(frozen=True)
class Start:
    """The time and the state at which a flow begins."""

    time: float  #: Time of the loads in s.
    #: `displacement`, `velocity`: modal state at `time`, shape (n,).
    displacement: Array
    velocity: Array
    #: Contact status just after `time`. By default it follows from the state. Shape (n_contacts,).
    status: Status | None = None


@dataclass(frozen=True)
class FlowEvent:
    """A contact event within a flow."""

    time: float  #: Time in s.
    contact: int
    #: `before`, `after`: status of the contact; both are open at an impact on a rigid stop.
    before: int
    after: int
    rate: float  #: Rate of its gap function just before, m/s.


@dataclass(frozen=True)
class Flow:
    """A flow over a time."""

    start: Start
    stop: float  #: Time in s.
    #: `displacement`, `velocity`: modal state at `stop`, shape (n,).
    displacement: Array
    velocity: Array
    #: Perturbations at `stop`, displacements above velocities. If the perturbations at the start are all unit vectors,
    #: this is the derivative of the final state. Shape (2n, k).
    monodromy: Array | None
    events: tuple[FlowEvent, ...]
    solution: EventSolution  #: The segments, for sampling.

    @property
    def space(self) -> ModalSpace:
        """Modes of the contact-free system."""
        return self.solution.space

    @property
    def status(self) -> Status:
        """Contact status at the end."""
        return self.solution.record.last_status

    @property
    def rate(self) -> Array:
        """Rates of displacement and velocity at the stop, shape (2n,)."""
        space, load = self.solution.space, self.solution.load(self.stop)
        laws = self.solution.system.contacts
        a = acceleration(space, laws, self.status, self.displacement, self.velocity, load)
        return np.concatenate([self.velocity, a])

    @cached_property
    def sizes(self) -> tuple[float, float]:
        """Sizes of modal displacements and velocities along the flow: the largest norms at ends of segments.

        With few segments times within them are used too, because a motion may be zero at the ends of all of them.
        """
        segments = self.solution.segments
        z, v = [self.displacement, *segments.displacement], [self.velocity, *segments.velocity]
        if segments.starts.size < _FEW or self.solution.given.sliders is not None:
            inside = self.start.time + (self.stop - self.start.time) * _INSIDE
            more_z, more_v = self.solution.modal(inside)
            z, v = [*z, *more_z.T], [*v, *more_v.T]
        largest_z, largest_v = (max(float(np.linalg.norm(part)) for part in parts) for parts in (z, v))
        return sizes_of(self.space, largest_z, largest_v, self.stop - self.start.time)


def sizes_of(space: ModalSpace, z: float, v: float, duration: float) -> tuple[float, float]:
    """Return sizes to which changes of a motion in some time are compared, from its largest displacement and velocity.

    Where it hardly moves about a deflection, velocities are the rounding of what holds the deflection.
    """
    slowest = float(np.min(space.stiffness, initial=np.inf, where=space.stiffness > 0.0))
    rates = [2.0 * np.pi / duration if duration > 0.0 else 0.0, np.sqrt(slowest) if np.isfinite(slowest) else 0.0]
    return z, max(v, _STILL * float(max(rates)) * z)


def modal_state(system: System, space: ModalSpace, state: State) -> tuple[Array, Array]:
    """Return modal displacement and velocity, each (n,), of a state."""
    momentum = system.mass @ np.stack([state.q, state.v], axis=1)
    z, v = (space.shapes.T @ momentum).T
    return np.ascontiguousarray(z), np.ascontiguousarray(v)


def modes_of(system: System, counters: Counters) -> ModalSpace:
    """Return the modes of a system without contacts, solved once."""
    return system.cache.get("modal space", None, lambda: modal_space(system, counters))


def solution_of(system: System, t_end: float, times: Array, counters: Counters) -> EventSolution:
    """Return the solution to be filled, with the modal space of the system, which is solved once."""
    if system.sliders is None:
        return EventSolution(system, modes_of(system, counters), t_end, times, counters)
    from vofem.integrators.event_driven.sliders import with_sliders
    from vofem.integrators.event_driven.sliding import SlidingSolution

    return SlidingSolution(system, modes_of(with_sliders(system), counters), t_end, times, counters)


def follower_of(
    solution: EventSolution, time: float, status: Status, displacement: Array, velocity: Array, pin_fraction: float,
    most_events: int,
) -> Follower:  # fmt: skip
    """Return what follows a motion: one that knows rigid stops and sliders where there are any."""
    arguments = solution, time, status, displacement, velocity, pin_fraction, most_events
    if solution.bounces is None and solution.given.sliders is None:
        return Follower(*arguments)
    from vofem.integrators.event_driven.walk import Walker

    return Walker(*arguments)


def flow(
    system: System,
    start: Start,
    stop: float,
    *,
    derivative: Array | None = None,
    counters: Counters | None = None,
    most_events: int = MOST_EVENTS,
) -> Flow:
    """Return the flow of a system from a state.

    `system`: a system that `event_driven` can treat.
    `stop`: absolute time in s.
    `derivative` (shape (2n, k)): perturbations at the start whose growth is computed; the identity for the monodromy
    matrix.
    `counters`: work is counted here.
    Raises `EventStormError` after `most_events` events.
    """
    counters = Counters() if counters is None else counters
    solution = solution_of(system, stop, np.array([stop]), counters)
    space = solution.space
    t, displacement, velocity = start.time, start.displacement, start.velocity
    if start.status is None:
        shapes = space.shapes
        status = solution.begin(
            State(shapes @ displacement, shapes @ velocity), displacement, velocity, PIN_FRACTION, t
        )  # fmt: skip
    else:
        status = start.status
        solution.begin_with(status)
    solution.since = t
    follower = follower_of(solution, t, status, displacement, velocity, PIN_FRACTION, most_events)
    while follower.time < stop:
        follower.advance()
        if solution.record.events > most_events:
            raise EventStormError(
                f"more than {most_events} contact events in a flow of {stop - start.time:g} s: contacts chatter"
            )
    displacement, velocity = follower.displacement, follower.velocity
    end = follower.status, displacement, velocity
    monodromy = None if derivative is None else _changed(solution, derivative, end[1:])
    return Flow(start, stop, displacement, velocity, monodromy, tuple(_events(solution, end)), solution)


def _changed(solution: EventSolution, changes: Array, end: tuple[Array, Array]) -> Array:
    """Return changes of the state, shape (2n, k), after all segments and events of a flow, given its last state."""
    z, v = np.split(changes, 2)
    for index, duration in enumerate(solution.record.durations):
        z, v = drifted(solution.spectrum(index), z, v, duration)
        events = solution.passage(index, end)
        if events is not None:
            z, v = events.passed(z, v)
    return np.concatenate([z, v])


def _events(solution: EventSolution, end: tuple[Status, Array, Array]) -> list[FlowEvent]:
    """Return the events of a flow, given contact status and modal state at its end."""
    record, space = solution.record, solution.space
    events: list[FlowEvent] = []
    for index, (begin, duration) in enumerate(zip(record.starts, record.durations, strict=True)):
        inner = index + 1 < record.segments
        time = float(record.starts[index + 1] if inner else begin + duration)
        after, velocity = (record.status(index + 1), record.state(index + 1)[1]) if inner else end[::2]
        before, struck = record.status(index), solution.bounced(index)
        if struck is not None:
            events.append(FlowEvent(time, struck, OPEN, OPEN, float(space.contacts[struck] @ record.state(index)[1])))
        for j in np.flatnonzero(before != after).tolist():
            if j != struck:
                rate = float(space.contacts[j] @ velocity)
                events.append(FlowEvent(time, j, int(before[j]), int(after[j]), rate))
    return events


# -- systems that differ in their loads alone ---------------------------------------------------------


def share_modes(system: System, earlier: System) -> bool:
    """Let a system use the modes of an earlier one with the same matrices, and all other data that are equal.

    Where the rows of contacts or loads differ, the modes are expressed in those of the system. Returns whether modes
    are shared.
    """
    if system is earlier:
        return True
    alike = system.share_what_is_equal(earlier)
    if system.cache is earlier.cache:
        return True
    if not alike and not system.has_matrices_of(earlier):
        return False
    known = modes_of(earlier, Counters())
    system.cache.get("modal space", None, lambda: known if alike else _with_rows(system, known))
    return True


def _with_rows(system: System, known: ModalSpace) -> ModalSpace:
    """Return known modes with the rows of a system's contacts and loads."""
    n, shapes = known.size, known.shapes
    contacts = np.empty((0, n)) if system.contacts is None else np.asarray(system.contacts.rows @ shapes)
    loads = np.stack([load.vector for load in system.loads]) @ shapes if system.loads else np.empty((0, n))
    return replace(known, contacts=contacts, loads=loads)


__all__ = [
    "Flow",
    "FlowEvent",
    "Start",
    "flow",
    "follower_of",
    "modal_state",
    "modes_of",
    "share_modes",
]
