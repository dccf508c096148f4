"""Derivatives of what a contact does: its events, its force, and its impacts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.histories import ContactHistory
from vofem.sensitivities.flow import Block, Closed, divided_far, ramped
from vofem.sensitivities.forcing import Forcing
from vofem.sensitivities.forward import Forward
from vofem.system import CLOSED, OPEN, PINNED

#: Newton steps for the time of a peak.
_ROUNDS = 8

#: Relative distance of times that are one.
_SAME = 4e-16


@dataclass(frozen=True)
class ImpactSensitivities:
    """Derivatives of the impacts of a contact, in the order of `Impacts`.

    Attributes
    ----------
    closing, opening : ndarray, shape (n, p)
        Of the times of begin and end, s over the unit of the parameter. 0 at the begin and the end of the run.
    peak_force, peak_time, impulse : ndarray, shape (n, p)
        Of the largest force in N, of the time at which it is reached in s, and of the impulse in N s.
    """

    closing: Array
    opening: Array
    peak_force: Array
    peak_time: Array
    impulse: Array

    def __len__(self) -> int:
        return int(self.closing.shape[0])


class Law:
    """The force of a contact in one segment, ``row u + constant + waves(tau)``, and its derivatives."""

    def __init__(self, forward: Forward, index: int, j: int) -> None:
        modal = forward.modal
        laws, n, p = modal.laws, modal.size, len(forward.changes)
        assert laws is not None
        self.status = int(forward.segments.status[index][j])
        self.row, self.rows = np.zeros(2 * n), np.zeros((p, 2 * n))
        self.constant, self.constants = 0.0, np.zeros(p)
        self.waves: Forcing | None = None
        self.wave_changes: list[Forcing] = []
        if self.status == PINNED:
            rows, self.waves = forward.reaction_rows(index, j)
            self.row = rows[0]
            for k in range(p):
                self.rows[k], waves = forward.reaction_changes(index, j, k)
                self.wave_changes.append(waves)
        elif self.status == CLOSED:
            k0, c0, c = laws.stiffness[j], laws.damping[j], modal.contacts[j]
            offset = laws.offset[j]
            self.row = np.concatenate([k0 * c / modal.scale, c0 * c])
            self.constant = -k0 * offset
            for k, change_k in enumerate(forward.changes):
                change = change_k.change
                k_p, c_p = change.contact_stiffness[j], change.contact_damping[j]
                gap_p = 0.0 if laws.jump[j] else change.gap[j]
                c_moved = np.zeros(n) if change_k.contacts is None else change_k.contacts[j]
                self.rows[k] = np.concatenate([(k_p * c + k0 * c_moved) / modal.scale, c_p * c + c0 * c_moved])
                self.constants[k] = -k_p * offset - k0 * gap_p

    def value(self, state: Array, tau: float) -> float:
        """Return the force in N."""
        waves = 0.0 if self.waves is None else self.waves.at(tau)
        return float(self.row @ state + self.constant + waves)

    def explicit(self, states: Array, tau: Array | float) -> Array:
        """Return the derivatives of the force at fixed states, (2n,) or (2n, k), at times, (p,) or (k, p)."""
        found = (self.rows @ states).T + self.constants
        for k, change in enumerate(self.wave_changes):
            found[..., k] += change.at(tau)
        return np.asarray(found)


class ContactSensitivities:
    """Derivatives of a contact along a run; the last axis is the parameter.

    Attributes
    ----------
    name : str
    """

    def __init__(self, forward: Forward, history: ContactHistory, index: int, times: Array) -> None:
        self._forward, self._history, self._index, self._times = forward, history, index, times
        self.name = history.name

    def __repr__(self) -> str:
        return f"ContactSensitivities({self.name!r}, {self.closings.shape[0]} closings)"

    @property
    def _event_times(self) -> Array:
        """Derivatives of the times of all events and, last, of the start, which does not move, s."""
        return np.vstack([self._forward.event_times, np.zeros(len(self._forward.changes))])

    @property
    def closings(self) -> Array:
        """Of the times at which the contact closes, shape (n, p); 0 for one that starts closed."""
        return self._event_times[self._forward.events.stays(self._index, CLOSED)[0]]

    @property
    def openings(self) -> Array:
        """Of the times at which the contact opens, shape (n, p)."""
        return self._event_times[self._forward.events.stays(self._index, CLOSED)[1]]

    @cached_property
    @one_thread
    def force(self) -> Array:
        """Of the contact force at the times of the run in N, shape (n_times, p)."""
        forward = self._forward
        out = np.zeros((self._times.size, len(forward.changes)))
        for index, mine, tau in forward.visit(self._times):
            law = Law(forward, index, self._index)
            if law.status == OPEN:
                continue
            piece = forward.closed(index)
            out[mine] = piece.sample(law.row[None], tau)[0] + law.explicit(piece.states(tau), tau)
        return out

    @cached_property
    @one_thread
    def impacts(self) -> ImpactSensitivities:
        """Of the impacts one by one."""
        forward, found, laws = self._forward, self._history.impacts, self._forward.modal.laws
        assert laws is not None
        events = forward.events
        p, n = len(forward.changes), len(found)
        parts = np.zeros((5, n, p))
        begins, ends = events.stays(self._index, CLOSED, PINNED)
        parts[0], parts[1, : ends.size] = self._event_times[begins], self._event_times[ends]
        for i in range(n):
            span = float(found.closing[i]), float(found.opening[i])
            parts[4, i] = self._impulse(*span)
            if not laws.rigid[self._index]:
                parts[2:4, i] = self._peak(float(found.peak_time[i]), *span)
                continue
            # The force of an impact has no bound.
            parts[2:4, i] = np.nan
            for k in range(int(begins[i]), int(ends[i]) if i < ends.size else events.time.size):
                parts[4, i] += forward.impulses.get((k, self._index), 0.0)
        return ImpactSensitivities(*parts)

    def _impulse(self, begin: float, end: float) -> Array:
        """Return the derivatives of the integral of the force over an impact, shape (p,)."""
        forward = self._forward
        total = np.zeros(len(forward.changes))
        for index in within(forward, self._index, begin, end):
            law, piece = Law(forward, index, self._index), forward.closed(index)
            duration = float(forward.segments.durations[index])
            integrals = piece.integrals()
            if integrals is None:
                whole, flow = piece.segment, forward.flow(forward.segments.status[index])
                integrals = Block(flow.equation.matrix, flow.matrices, whole).integrals()
            state, changes = integrals
            total += law.row @ changes + law.rows @ state + law.constants * duration
            for k, change in enumerate(law.wave_changes):
                total[k] += integral_of(change, duration)
            for event, force in edges_of(forward, index, self._index, law):
                total += force * forward.event_times[event]
        return total

    def _peak(self, time: float, begin: float, end: float) -> tuple[Array, Array]:
        """Return the derivatives of the force of largest magnitude in an impact, and of its time, each (p,)."""
        forward = self._forward
        found = peak_of(forward, self._index, time, begin, end)
        law, tau, state = found.law, found.tau, found.state
        flow = forward.flow(forward.segments.status[found.index])
        force, forces = forward.forces(found.index)[1], forward.force_changes(found.index)
        piece, n = forward.closed(found.index), forward.modal.size
        if not found.interior:
            moved = piece.sample(law.row[None], np.array([tau]))[0, 0] + law.explicit(state, tau)
            none = np.zeros(len(forward.changes))
            shift = none if found.event is None else forward.event_times[found.event]
            return moved + found.slope * shift, shift
        _, rate, _ = _motion(piece, flow.equation.matrix, force, n, tau)
        moved = piece.sample(np.eye(2 * n), np.array([tau]))[:, 0]
        rates = flow.equation.matrix @ moved
        for k, (change, own) in enumerate(zip(flow.matrices, forces, strict=True)):
            if change is not None:
                rates[:, k] += change @ state
            if own is not None:
                rates[n:, k] += own.at(tau)
        slopes = law.row @ rates + law.rows @ rate
        for k, waves in enumerate(law.wave_changes):
            slopes[k] += waves.rate().at(tau)
        return law.row @ moved + law.explicit(state, tau), -slopes / found.bend


@dataclass(frozen=True)
class Peak:
    """Where the force of a contact is largest in an impact."""

    index: int  #: The segment.
    tau: float  #: Time after its start, s.
    law: Law
    state: Array  #: Shape (2n,).
    #: `slope`, `bend`: first and second derivative of the force by time there.
    slope: float
    bend: float
    interior: bool  #: Whether the force is stationary there; else it is largest at an event.
    event: int | None  #: This event.


def peak_of(forward: Forward, j: int, time: float, begin: float, end: float) -> Peak:
    """Return the exact place of the largest force of contact j in an impact, near an approximate time in s."""
    starts, ends = forward.starts, forward.starts + forward.segments.durations
    chosen = within(forward, j, begin, end)

    def size(k: int) -> float:
        tau = np.clip(time - starts[k : k + 1], 0.0, forward.segments.durations[k])
        return abs(Law(forward, k, j).value(forward.closed(k).states(tau)[:, 0], float(tau[0])))

    # At an impact on a rigid stop the force of a damper jumps, and one side is the larger one.
    meet = [k for k in chosen if starts[k] <= time <= ends[k] * (1.0 + _SAME)]
    index = max(meet, key=size, default=chosen[0])
    duration = float(forward.segments.durations[index])
    law, piece = Law(forward, index, j), forward.closed(index)
    force = forward.forces(index)[1]
    matrix, n = forward.flow(forward.segments.status[index]).equation.matrix, forward.modal.size

    def slopes(at: float) -> tuple[Array, float, float]:
        state, rate, second = _motion(piece, matrix, force, n, at)
        one, two = float(law.row @ rate), float(law.row @ second)
        if law.waves is not None:
            growing = law.waves.rate()
            one, two = one + growing.at(at), two + growing.rate().at(at)
        return state, one, two

    tau = guess = min(max(time - float(starts[index]), 0.0), duration)
    for _ in range(_ROUNDS):
        state, slope, bend = slopes(tau)
        step = -slope / bend if bend != 0.0 else np.inf
        if not 0.0 <= tau + step <= duration or abs(tau + step - guess) > 0.02 * duration:
            break
        tau += step
        if abs(step) <= 1e-15 * duration:
            state, slope, bend = slopes(tau)
            return Peak(index, tau, law, state, 0.0, bend, True, None)
    else:
        return Peak(index, tau, law, state, 0.0, bend, True, None)
    # The largest force is at an end of the impact, or at the event of another contact.
    at = 0.0 if guess <= 0.5 * duration else duration
    state, slope, bend = slopes(at)
    return Peak(index, at, law, state, slope, bend, False, event_at(forward, index if at else index - 1, j))


def within(forward: Forward, j: int, begin: float, end: float) -> list[int]:
    """Return the segments of an impact of contact j."""
    first = int(np.searchsorted(forward.starts, begin, side="right")) - 1
    last = int(np.searchsorted(forward.starts, end, side="left")) - 1
    return [k for k in range(first, last + 1) if forward.segments.status[k][j] != OPEN]


def edges_of(forward: Forward, index: int, j: int, law: Law) -> list[tuple[int, float]]:
    """Return the events at both ends of a segment, and what a delay of them adds to the impulse of contact j, N."""
    found, piece = [], forward.closed(index)
    for edge, at, sign in ((index - 1, 0.0, -1.0), (index, float(forward.segments.durations[index]), 1.0)):
        if (event := event_at(forward, edge, j)) is not None:
            found.append((event, sign * law.value(piece.states(np.array([at]))[:, 0], at)))
    return found


def event_at(forward: Forward, index: int, contact: int) -> int | None:
    """Return the number of an event, of a contact if there is one, at the end of a segment; -1 for the run's start."""
    record = forward.solution.record
    # A segment of no duration holds the state before the impact at its end.
    while not (numbers := record.events_after(index)) and not np.all(record.durations[index + 1 : index + 2]):
        index += 1
    own = [number for number in numbers if forward.events.contact[number] == contact]
    return next(iter([*own, *numbers]), None)


def _motion(piece: Closed | Block, matrix: Array, force: Forcing, n: int, tau: float) -> tuple[Array, Array, Array]:
    """Return the state, its rate and its second derivative at a time after the start of a segment, each (2n,)."""
    state = piece.states(np.array([tau]))[:, 0]
    rate = matrix @ state
    rate[n:] += force.at(tau)
    second = matrix @ rate
    second[n:] += force.rate().at(tau)
    return state, rate, second


def integral_of(force: Forcing, duration: float) -> Any:
    """Return the integral of a number or a vector (n,) over time."""
    zero = np.zeros(force.omega.size, dtype=np.complex128)
    sigma = np.asarray(1j * force.omega, dtype=np.complex128)
    levels, growths = divided_far(sigma, zero, duration), ramped(zero, sigma, duration)
    return (levels @ force.level + growths @ force.growth).real
