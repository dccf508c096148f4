"""Derivatives along an event-driven run: through segments in closed form, and through its events.

Events are passed by the map that the run itself has for small changes, see `event_driven.tangent`. To it comes what a
parameter changes at a fixed state: gap functions, their rates, and what an impact does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.tangent import FIXED, REACTION, Passage, acceleration, shares
from vofem.sensitivities.flow import Basis, Block, Closed, Segment, basis_of
from vofem.sensitivities.forcing import Forcing, derivative_waves, forcing_of, waves_of
from vofem.sensitivities.impacts import Impact
from vofem.sensitivities.modal import ModalChange, ModalSystem, StatusEquation
from vofem.system import CLOSED, OPEN, PINNED, Events

Status = NDArray[np.int64]


@dataclass
class Work:
    """Counts of the work of derivatives."""

    assemblies: int = 0  #: Scenes that were assembled again.
    eigensolves: int = 0  #: Eigenbases of statuses.
    segments: int = 0  #: Segments in closed form.
    exponentials: int = 0  #: Segments by exponentials of block matrices, which take longer.


class StatusFlow:
    """What all segments of one contact status share."""

    def __init__(
        self, modal: ModalSystem, status: Status, changes: list[ModalChange], work: Work, bare: bool = False
    ) -> None:
        self.equation = StatusEquation(modal, status)
        found = [self.equation.changes(change) for change in changes]
        self.matrices = [matrix for matrix, _, _ in found]
        self.inverses = [inverse for _, inverse, _ in found]
        self.pushes = [push for _, _, push in found]
        self.basis: Basis | None = basis_of(self.equation.matrix, [] if bare else self.matrices)
        work.eigensolves += 1

    def projected(self, force: Forcing) -> Forcing:
        """Return a force as it accelerates the modes."""
        project = self.equation.project
        return force if project is None else force.times(project)

    def force_change(self, k: int, waves: list[Any], vectors: list[Array], whole: Forcing) -> Forcing | None:
        """Return the derivative of `force` by a parameter, None where there is none.

        `k`: number of the parameter.
        `waves`, `vectors`: functions of time and vectors whose sum is the derivative of the loads.
        `whole`: the force before projection.
        """
        if not waves and not np.any(self.pushes[k]) and self.inverses[k] is None:
            return None
        own = self.projected(forcing_of(waves, vectors, self.pushes[k]))
        inverse = self.inverses[k]
        return own if inverse is None else own.plus(whole.times(inverse.T))


@dataclass
class Crossing:
    """What the derivatives of the time of an event are made of, for notes."""

    time: float
    contact: int
    rate: float  #: Rate of the gap function, m/s.
    jump: float  #: Size of the jump of velocities per second by which the event comes later.


class Meeting(NamedTuple):
    """The events between two segments, or what holds pinned contacts at the start."""

    passage: Passage  #: What it does to changes.
    state: Array  #: Scaled state before, shape (2n,).
    ends: Array  #: Derivatives of the scaled state before, at a fixed time, shape (2n, p).


class Explicit(NamedTuple):
    """What parameters change at events at a fixed state; see `Passage` for the first two, (h, p) and (k, p)."""

    off: Array
    meets: Array
    velocity: Array  #: Derivatives of the velocity after an impact, shape (n, p).
    impulse: Array  #: Derivatives of its impulses, shape (h, p).


@dataclass
class Forward:
    """Derivatives along a run by forward propagation."""

    solution: Any
    modal: ModalSystem
    changes: list[ModalChange]  #: One for each parameter.
    work: Work = field(default_factory=Work)
    bare: bool = False  #: Whether the derivatives themselves are left out: only the motion and its events are wanted.
    crossings: list[Crossing] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.segments = self.solution.segments
        self.events: Events = self.solution.events
        laws = self.modal.laws
        self.rigid = np.zeros(0, dtype=bool) if laws is None else laws.rigid
        self._flows: dict[bytes, StatusFlow] = {}
        self.event_times = np.full((self.events.time.size, len(self.changes)), np.nan)
        self._starts: list[Array] = []
        self._forces: dict[int, tuple[Forcing, Forcing]] = {}
        self._pieces: dict[int, Closed | Block] = {}
        self.meetings: dict[int, Meeting] = {}
        #: Derivatives of the impulses of rigid stops, shape (p,), by the numbers of event and stop.
        self.impulses: dict[tuple[int, int], Array] = {}
        self.final = self._propagate()

    # -- pieces of the run ------------------------------------------------------------------------

    def flow(self, status: Status) -> StatusFlow:
        """Return what all segments of a status share."""
        key = status.tobytes()
        if key not in self._flows:
            self._flows[key] = StatusFlow(self.modal, status, self.changes, self.work, self.bare)
        return self._flows[key]

    def state(self, index: int) -> Array:
        """Return scaled displacements and velocities at the begin of a segment, shape (2n,)."""
        z, v, laws = self.segments.displacement[index], self.segments.velocity[index], self.modal.laws
        held = np.flatnonzero(self.segments.status[index] == PINNED)
        if held.size and laws is not None:
            # The run stores the motion with which a contact comes to its gap; there it rests.
            rows = self.modal.contacts[held]
            share = shares(rows)
            z, v = z - share @ (rows @ z - laws.gap[held]), v - share @ (rows @ v)
        return np.concatenate([self.modal.scale * z, v])

    def waves(self, index: int) -> list[Forcing]:
        """Return the functions of time of the loads in a segment."""
        t = float(self.segments.starts[index])
        return [waves_of(load.function.piece(t)) for load in self.modal.system.loads]  # type: ignore[attr-defined]

    def forces(self, index: int) -> tuple[Forcing, Forcing]:
        """Return the force in a segment before and after projection."""
        if index not in self._forces:
            flow = self.flow(self.segments.status[index])
            whole = forcing_of(self.waves(index), list(self.modal.loads), flow.equation.push)
            self._forces[index] = whole, flow.projected(whole)
        return self._forces[index]

    def load_changes(self, index: int, k: int) -> tuple[list[Forcing], list[Array]]:
        """Return functions of time and vectors (n,) whose sum is the derivative of the loads by a parameter."""
        change, loads, t = self.changes[k], self.modal.system.loads, float(self.segments.starts[index])
        parts = [] if change.loads is None else self.waves(index)
        along = [] if change.loads is None else list(change.loads)
        for load, path in change.change.functions.items():
            parts.append(derivative_waves(loads[load].function, path, t))
            along.append(self.modal.loads[load])
        return parts, along

    def force_changes(self, index: int) -> list[Forcing | None]:
        """Return the derivatives of the force in a segment after projection."""
        flow, whole = self.flow(self.segments.status[index]), self.forces(index)[0]
        return [flow.force_change(k, *self.load_changes(index, k), whole) for k in range(len(self.changes))]

    def closed(self, index: int) -> Closed | Block:
        """Return a segment, ready to be sampled."""
        if index not in self._pieces:
            self._pieces[index] = self._piece(index)
        return self._pieces[index]

    def _piece(self, index: int) -> Closed | Block:
        flow = self.flow(self.segments.status[index])
        force, forces = self.forces(index)[1], [] if self.bare else self.force_changes(index)
        last = index + 1 == self.segments.starts.size
        start = self.state(index)
        duration = float(self.segments.durations[index])
        # A segment of no duration holds the state before an impact.
        end = start if last or duration == 0.0 else self.state(index + 1)
        segment = Segment(start, self._starts[index], force, forces, duration, end)
        if flow.basis is not None:
            found = Closed(flow.basis, segment)
            if last or self._pins(index):
                # The state at the end is not stored, or pinning changed it: the run itself is asked.
                z, v = self._sampled(float(self.segments.starts[index]) + duration, last)
                segment = segment._replace(end=np.concatenate([self.modal.scale * z, v]))
                found = Closed(flow.basis, segment)
            if found.good:
                self.work.segments += 1
                return found
        self.work.exponentials += 1
        return Block(flow.equation.matrix, flow.matrices, segment)

    def _pins(self, index: int) -> bool:
        status = self.segments.status
        return bool(np.any((status[index + 1] == PINNED) & (status[index] != PINNED)))

    def _sampled(self, t: float, last: bool) -> tuple[Array, Array]:
        if not last:
            # Displacements are continuous; the velocity before pinning is that of the free motion.
            t = float(np.nextafter(t, -np.inf))
        z, v = self.solution.modal(np.array([min(t, self.solution.t_end)]))
        return z[:, 0], v[:, 0]

    # -- through segments and events --------------------------------------------------------------

    def _propagate(self) -> Array:
        """Fill in the derivatives at the begin of all segments and at events; return those at the end, (2n, p)."""
        n, scale, segments = self.modal.size, self.modal.scale[:, None], self.segments
        changes = [] if self.bare else self.changes
        z = np.array([change.displacement for change in changes]).reshape(-1, n).T
        v = np.array([change.velocity for change in changes]).reshape(-1, n).T
        self.begin = self._resting()
        if not self.bare and self.begin is not None:
            z, v = self._pass(-1, self.begin, z, v)
        # What rests at a rigid stop at the start has come there by an event of that time.
        record = self.solution.record
        self.event_times[record.events_after(-1)] = 0.0
        for index in range(segments.starts.size):
            self._starts.append(np.concatenate([scale * z, v]))
            piece = self.closed(index)
            ends = self._starts[-1] if self.bare else piece.ends()
            z, v = ends[:n] / scale, ends[n:]
            if not record.events_after(index):
                continue
            state = piece.states(np.array([segments.durations[index]]))[:, 0]
            if (passage := self.solution.passage(index, self._split(state))) is not None:
                self.meetings[index] = Meeting(passage, state, ends)
                if not self.bare:
                    z, v = self._pass(index, self.meetings[index], z, v)
        return np.concatenate([scale * z, v])

    def _resting(self) -> Meeting | None:
        """Return what holds contacts that are pinned at the start at their gaps."""
        status, n = self.segments.status[0], self.modal.size
        held = np.flatnonzero(status == PINNED)
        if not held.size:
            return None
        rows, none = self.modal.contacts[held], np.zeros((0, n))
        passage = Passage(
            range(0), status, status, [], none, np.zeros(0), none.T, held.tolist(), rows, shares(rows), 1.0, status
        )
        return Meeting(passage, self.state(0), np.zeros((2 * n, 0)))

    def _split(self, state: Array) -> tuple[Array, Array]:
        n = self.modal.size
        return state[:n] / self.modal.scale, state[n:]

    def _pass(self, index: int, meeting: Meeting, z: Array, v: Array) -> tuple[Array, Array]:
        """Return the derivatives after the events at the end of a segment, z and v being those before, (n, p)."""
        passage, explicit = meeting.passage, self.explicit(meeting)
        before = np.concatenate([self.modal.scale[:, None] * z, v])
        for number in passage.numbers:
            j = int(self.events.contact[number])
            row, rate, fixed = self.timing(index, meeting, j, explicit)
            with np.errstate(divide="ignore", invalid="ignore"):
                self.event_times[number] = -(row @ before + fixed) / rate
            if j in passage.contacts:
                k = passage.contacts.index(j)
                jump = float(np.linalg.norm(passage.kick[:, k]) * np.linalg.norm(passage.rows[k]))
                self.crossings.append(Crossing(float(self.events.time[number]), j, rate, jump))
        struck = {int(self.events.contact[number]): number for number in reversed(passage.numbers)
                  if self.rigid[self.events.contact[number]] and self.events.status[number] != OPEN}  # fmt: skip
        if struck:
            displacement, velocity = self._split(meeting.state)
            load = self.solution.load(float(self.events.time[passage.numbers[0]]))
            push = acceleration(self.solution.space, self.modal.laws, passage.before, displacement, velocity, load)
            first, impact = min(struck.values()), Impact(passage, velocity)
            for k, j in enumerate(impact.contacts):
                number = struck.get(j, first)
                there = v + np.outer(push, self.event_times[number])
                self.impulses[number, j] = impact.impulses(there)[k] + explicit.impulse[k]
        z, v = passage.passed(z, v, off=explicit.off, meets=explicit.meets)
        return z, v + explicit.velocity

    def timing(self, index: int, meeting: Meeting, j: int, explicit: Explicit) -> tuple[Array, float, Array]:
        """Return what determines when a contact changes at the end of a segment.

        This is a function that reaches zero: its derivatives by the scaled state (2n,), by time, and by the parameters
        at a fixed state (p,).
        """
        passage, n = meeting.passage, self.modal.size
        k = int(passage.by[j])
        if k == REACTION:
            return self.release(index, j, int(passage.after[j]), meeting.state)
        if k == FIXED:
            return np.zeros(2 * n), 1.0, np.zeros(len(self.changes))
        return np.append(passage.rows[k] / self.modal.scale, np.zeros(n)), float(passage.rates[k]), explicit.meets[k]

    def explicit(self, meeting: Meeting) -> Explicit:
        """Return what parameters change at events at a fixed state."""
        n, p, passage = self.modal.size, len(self.changes), meeting.passage
        displacement, velocity = self._split(meeting.state)
        off, meets = (
            np.array([self.gap_changes(j, displacement) for j in contacts]).reshape(-1, p)
            for contacts in (passage.restrained, passage.contacts)
        )
        turned, impulse = np.zeros((n, p)), np.zeros_like(off)
        if passage.restrained:
            impact = Impact(passage, velocity)
            for k, change in enumerate(self.changes):
                turned[:, k], impulse[:, k] = impact.by(change)
        return Explicit(off, meets, turned, impulse)

    def gap_changes(self, j: int, displacement: Array) -> Array:
        """Return the derivatives of a gap function at fixed modal displacements, shape (p,)."""
        found = np.array([-change.change.gap[j] for change in self.changes])
        for k, change in enumerate(self.changes):
            if change.contacts is not None:
                found[k] += change.contacts[j] @ displacement
        return found

    def release(self, index: int, j: int, after: int, state: Array) -> tuple[Array, float, Array]:
        """Return what releases a pinned contact at the end of a segment, its reaction less the force that it then has.

        Returns `row` (shape (2n,)): its derivative by the scaled state.
        Returns `rate`: its rate by time.
        Returns `explicit` (shape (p,)): its derivatives by the parameters at a fixed state.
        """
        laws, tau = self.modal.laws, float(self.segments.durations[index])
        assert laws is not None
        rows, constants = self.reaction_rows(index, j)
        explicit = np.empty(len(self.changes))
        for k, change in enumerate(self.changes):
            row_p, constant_p = self.reaction_changes(index, j, k)
            explicit[k] = row_p @ state + constant_p.at(tau)
            if after == CLOSED:
                gap_p, k_p = change.change.gap[j], change.change.contact_stiffness[j]
                explicit[k] -= laws.stiffness[j] * gap_p + k_p * laws.gap[j]
        slope = self.flow(self.segments.status[index]).equation.matrix @ state
        slope[self.modal.size :] += self.forces(index)[1].at(tau)
        return rows[0], float(rows[0] @ slope + constants.rate().at(tau)), explicit

    # -- forces of contacts -----------------------------------------------------------------------

    def reaction_rows(self, index: int, j: int) -> tuple[Array, Forcing]:
        """Return the row (1, 2n) over the state, and the function of time, whose sum is a pinned contact's reaction."""
        flow = self.flow(self.segments.status[index])
        place = int(np.flatnonzero(flow.equation.pinned == j)[0])
        rows, share = flow.equation.reaction()
        return rows[[place]], self.forces(index)[0].times(share[place])

    def reaction_changes(self, index: int, j: int, k: int) -> tuple[Array, Forcing]:
        """Return the derivatives of `reaction_rows` by a parameter: (2n,), and a function of time."""
        flow, change = self.flow(self.segments.status[index]), self.changes[k]
        equation = flow.equation
        place = int(np.flatnonzero(equation.pinned == j)[0])
        lower = self.lower(equation, change)
        rows_p, share_p = equation.reaction_changes(change, lower)
        _, share = equation.reaction()
        own = forcing_of(*self.load_changes(index, k), flow.pushes[k]).times(share[place])
        return rows_p[place], own.plus(self.forces(index)[0].times(share_p[place]))

    def lower(self, equation: StatusEquation, change: ModalChange) -> Array:
        """Return the derivative of forces over the state, before projection, shape (n, 2n)."""
        free = StatusEquation(self.modal, np.where(equation.status == PINNED, OPEN, equation.status))
        matrix, inverse, _ = free.changes(change)
        n = self.modal.size
        if matrix is None:
            return np.zeros((n, 2 * n))
        return matrix[n:] if inverse is None else matrix[n:] - inverse @ free.force

    # -- samples ----------------------------------------------------------------------------------

    @cached_property
    def starts(self) -> Array:
        """Times at which the segments begin, s."""
        return np.asarray(self.segments.starts)

    def visit(self, times: Array) -> list[tuple[int, NDArray[np.int64], Array]]:
        """Return (segment, indices into times, times after its start) for all segments that hold some of the times."""
        index = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, None)
        return [
            (int(k), np.flatnonzero(index == k), times[index == k] - self.starts[k]) for k in np.unique(index).tolist()
        ]

    def motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Return modal displacements, velocities and accelerations of the run, each (n, n_times)."""
        n, scale = self.modal.size, self.modal.scale[:, None]
        out = np.empty((3, n, times.size))
        for index, mine, tau in self.visit(times):
            equation = self.flow(self.segments.status[index]).equation
            states = self.closed(index).states(tau)
            force = self.forces(index)[1]
            out[0][:, mine], out[1][:, mine] = states[:n] / scale, states[n:]
            out[2][:, mine] = equation.matrix[n:] @ states + force.at(tau).T
        return out[0], out[1], out[2]

    def accelerations(self, times: Array) -> Array:
        """Return the derivatives of the modal accelerations, shape (n, n_times, p)."""
        n = self.modal.size
        out = np.empty((n, times.size, len(self.changes)))
        for index, mine, tau in self.visit(times):
            flow, piece = self.flow(self.segments.status[index]), self.closed(index)
            states = piece.states(tau)
            forces = self.force_changes(index)
            found = np.einsum("nm,mtp->ntp", flow.equation.matrix[n:], piece.sample(np.eye(2 * n), tau))
            for k, (change, own) in enumerate(zip(flow.matrices, forces, strict=True)):
                if change is not None:
                    found[:, :, k] += change[n:] @ states
                if own is not None:
                    found[:, :, k] += own.at(tau).T
            out[:, mine] = found
        return out

    def sample(self, rows: Array, times: Array) -> Array:
        """Return the derivatives of ``rows @ (z, v)`` at times of the run, shape (k, n_times, p)."""
        scaled = rows / np.concatenate([self.modal.scale, np.ones(self.modal.size)])
        out = np.empty((rows.shape[0], times.size, len(self.changes)))
        for index, mine, tau in self.visit(times):
            out[:, mine] = self.closed(index).sample(scaled, tau)
        return out
