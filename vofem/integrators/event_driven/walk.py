"""Follows a motion segment by segment where events do more than switch a spring: impacts on rigid stops.

The compiled loop of `loop.py` follows scenes of elastic contacts alone. Here every event is treated in Python; motion
and search are the same.
"""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.errors import EventStormError
from vofem.integrators.event_driven.bounces import REST, struck
from vofem.integrators.event_driven.follow import Follower
from vofem.integrators.event_driven.regime import Regime
from vofem.integrators.event_driven.search import EventFunctions, exact_cut, march, search_space
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.tangent import acceleration
from vofem.kernels.mode import kernels
from vofem.system import CLOSED, OPEN, PINNED

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Most impacts at one time.
_MOST_AT_ONCE = 10_000

#: A speed below this share of the terms that it is summed of is zero.
_ZERO = 1e-13

#: Share of the time of a search within which an open contact is not told from one that rests at its gap.
_NEAR = 1e-6


class Walker:
    """A motion that is followed from segment to segment; see `Follower`, whose interface it has."""

    def __init__(
        self, solution: EventSolution, edges: ArrayLike, time: float, status: Status, displacement: Array,
        velocity: Array, pin_fraction: float, most_events: int,
    ) -> None:  # fmt: skip
        self.solution = solution
        self.time, self.status, self.displacement, self.velocity = time, status.copy(), displacement, velocity
        solution.exosystem = solution.loads_between(np.asarray(edges, dtype=float))
        laws = solution.system.contacts
        assert laws is not None
        self._laws, self._rows, self._pin_fraction = laws, solution.space.contacts, pin_fraction
        # The largest speed of approach of each rigid stop.
        self._largest = np.zeros(len(laws))
        if solution.record.segments:
            assert solution.bounces is not None
            np.maximum.at(self._largest, solution.bounces.contact, solution.bounces.approach)
        self._gaps = solution.gaps_at(self.status, displacement, time)
        if not solution.record.segments:
            self._strike(self._laws.rigid & (self._gaps == 0.0))

    def advance(self) -> None:
        """Compute one segment, and what the event at its end does."""
        solution, record = self.solution, self.solution.record
        loads = solution.exosystem
        interval = int(loads.interval(np.array([self.time]))[0])
        regime = solution.regime(self.status, int(loads.kind[interval]))
        duration = float(loads.edges[interval + 1]) - self.time
        group = regime.blocks.group
        index = self._record()
        begin = regime.begin(self.displacement[None], self.velocity[None], loads.at(np.array([self.time])))
        if regime.held:
            self.displacement, self.velocity = (part[0] for part in regime.to_modes(begin, shifted=True))
        with nullcontext() if group is None else kernels(compiled=False):
            tau, hits = self._next_event(regime, begin[0], duration)
        moved = regime.changes(begin, np.zeros(1, dtype=np.int64), np.array([tau]))
        displacement, velocity = (part[0] for part in regime.to_modes(moved))
        record.buffers.durations[index] = tau
        self.time = float(loads.edges[interval + 1]) if tau >= duration else self.time + tau
        self.displacement, self.velocity = self.displacement + displacement, self.velocity + velocity
        self._gaps = self._gaps + self._rows @ displacement
        solution.gaps_now = self._gaps
        solution.counters.steps += 1
        if hits.size:
            self._pass_event(dict(zip(regime.owner[hits].tolist(), regime.leads[hits].tolist(), strict=True)))
            solution.gaps_now = self._gaps

    def _record(self) -> int:
        """Begin a segment in the present state; return its number."""
        record = self.solution.record
        record.add(self.time, self.status, self.displacement, self.velocity)
        record.buffers.gaps[record.segments - 1] = self._gaps
        record.buffers.durations[record.segments - 1] = 0.0
        return record.segments - 1

    def _next_event(self, regime: Regime, begin: Array, duration: float) -> tuple[float, Status]:
        """Return the time until the next event, and the event functions that reach zero then."""
        none = np.zeros(0, dtype=np.int64)
        if not regime.sign.size:
            return duration, none
        contact = regime.sign != 0.0
        start = np.where(contact, regime.sign * self._gaps[regime.owner], np.sum(regime.rows * begin, axis=(1, 2)))
        level = regime.level.copy()
        if regime.spectrum.blocks is not None:
            sizes = self.solution.row_sizes @ np.abs(self.displacement)
            level += np.where(contact, sizes[regime.owner], 0.0)
        slow = np.abs(self._rows @ self.velocity) <= _ZERO * (np.abs(self._rows) @ np.abs(self.velocity))
        leaving = contact & (start == 0.0) & slow[regime.owner]
        if leaving.any():
            # What leaves its stop without speed, as forces slowly change their signs, is not followed from nothing.
            level += np.where(leaving, self._forces()[regime.owner] * (_NEAR * duration) ** 2, 0.0)
        m, first = begin.shape[1], regime.loads
        terms = EventFunctions(regime.rows, regime.sizes, start, level, first, m if regime.mixed else first)
        space = search_space(m, start.size)
        tau, evaluations = march(terms, regime.blocks, regime.levels, begin, duration, space)
        self.solution.counters.gap_evaluations += evaluations * len(self._laws)
        hits = np.flatnonzero(space.hits)
        return (exact_cut(self.time, tau) if not hits.size and tau < duration else tau), hits

    def _forces(self) -> Array:
        """Return the sizes of the accelerations at the contacts, of which forces may balance each other, m/s^2."""
        solution = self.solution
        push = solution.space.stiffness * np.abs(self.displacement)
        for vector, function in zip(solution.load_vectors, solution.load_functions, strict=True):
            push = push + np.abs(vector) * abs(float(function(self.time)))
        return np.asarray(np.abs(self._rows) @ push)

    def _pass_event(self, entered: dict[int, int]) -> None:
        """Change status and velocity at an event, given the contacts that reach a limit and where this leads."""
        solution, rigid = self.solution, self._laws.rigid
        yielding = {j: new for j, new in entered.items() if not rigid[j]}
        before = self.status
        after = solution.enter(self.time, before, yielding, self.displacement, self.velocity, self._pin_fraction)
        touching = np.zeros(rigid.size, dtype=bool)
        for j in entered:
            if rigid[j] and before[j] == PINNED:
                after[j] = OPEN
                self._log(j, OPEN)
            touching[j] = rigid[j] and before[j] != PINNED
        changed = np.array(sorted(entered))
        self._gaps = self._gaps.copy()
        self._gaps[changed] = 0.0
        free = changed[after[changed] != PINNED]
        if free.size:
            self.displacement = solution.at_gaps(free, self.displacement, self.time)
        self.status = after
        if touching.any():
            self._strike(touching)

    def _log(self, contact: int, status: int) -> None:
        self.solution.record.add_event(self.time, contact, status)
        self.solution.counters.events += 1

    def _strike(self, touching: NDArray[np.bool_]) -> None:
        """Let bodies bounce off the rigid stops that they touch, one after the other, until none approaches its stop.

        Parameters
        ----------
        touching : ndarray of bool, shape (n_contacts,)
            Rigid stops without those at which something rests, which join when an impact moves it.
        """
        laws, rows = self._laws, self._rows
        for _ in range(_MOST_AT_ONCE):
            at_rest = laws.rigid & (self.status == PINNED)
            speed, zero = rows @ self.velocity, _ZERO * (np.abs(rows) @ np.abs(self.velocity))
            self._largest = np.where(touching | at_rest, np.maximum(self._largest, speed), self._largest)
            limit = np.maximum(REST * self._largest, zero)
            for j in np.flatnonzero(at_rest & (speed < -limit)).tolist():
                self._change(j, OPEN)
            settled = touching & (speed >= -zero) & ((speed <= limit) | (laws.restitution == 0.0))
            moving = (touching | at_rest) & ~settled & (speed > limit)
            if not moving.any():
                break
            j = int(np.argmax(np.where(moving, speed, -np.inf)))
            self._bounce(j)
            touching[j] = True
        else:
            raise EventStormError(
                f"more than {_MOST_AT_ONCE} impacts at t = {self.time:.6g} s: bodies are caught between rigid stops "
                f"such as {laws.labels[int(np.argmax(touching))]}"
            )
        self._settle(settled)
        speed = rows @ self.velocity
        chattering = (self.status == PINNED) & ~laws.rigid & (np.abs(speed) > zero)
        for j in np.flatnonzero(chattering).tolist():
            self._change(j, CLOSED if speed[j] > 0.0 else OPEN)

    def _change(self, j: int, status: int) -> None:
        """Give a contact a status, and record it."""
        self.status = self.status.copy()
        self.status[j] = status
        self._log(j, status)

    def _bounce(self, j: int) -> None:
        """Let a body bounce off a stop; the state before is a segment of its own."""
        self._record()
        self.velocity = struck(self._rows[j], float(self._laws.restitution[j]), self.velocity)
        self._log(j, CLOSED)
        self._change(j, OPEN)

    def _settle(self, settled: NDArray[np.bool_]) -> None:
        """Pin the contacts that no longer move against their stops if forces press them on; else let them go."""
        solution = self.solution
        space, load = solution.space, solution.load(self.time)
        for j in np.flatnonzero(settled).tolist():
            row = self._rows[j]
            held = self._rows[settled | (self.status == PINNED)]
            velocity = self.velocity - np.linalg.pinv(held) @ (held @ self.velocity)
            force = acceleration(space, None, self.status, self.displacement, velocity, load)
            pushed = row @ acceleration(space, self._laws, self.status, self.displacement, velocity, load)
            if pushed > _ZERO * (np.abs(row) @ np.abs(force)):
                self._change(j, PINNED)
            elif row @ self.velocity > 0.0:
                self._bounce(j)


def follower_of(
    solution: EventSolution, edges: ArrayLike, time: float, status: Status, displacement: Array, velocity: Array,
    pin_fraction: float, most_events: int,
) -> Follower | Walker:  # fmt: skip
    """Return what follows a motion: the compiled loop, or Python where there are rigid stops."""
    kind = Follower if solution.bounces is None else Walker
    return kind(solution, edges, time, status, displacement, velocity, pin_fraction, most_events)
