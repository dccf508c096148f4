"""Follows a motion from segment to segment by the loop, and takes the decisions that the loop leaves open.

A compiled loop computes many segments in a call. The numbers do not depend on where it returns, so that a run that is
continued from a snapshot gives the same bits.
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.integrators.event_driven.loop import (
    DECISION,
    EVALUATIONS,
    EVENTS,
    FULL,
    FUNCTION,
    INTERVAL,
    LEFT,
    SEGMENTS,
    STATUS,
    SWITCHED,
    Laws,
    Loads,
    LoopSpace,
    Reached,
    loop_space,
    run_segments,
)
from vofem.integrators.event_driven.regime import Regime
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.table import MOST_MODES, Statuses, Table, single
from vofem.kernels.mode import kernels
from vofem.system import PINNED

if TYPE_CHECKING:
    from vofem.integrators.event_driven.walk import Walker

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Segments in the first call of the loop; seconds that a call may take; segments and events in any call.
FIRST_CALL, _SECONDS, MOST = 64, 0.1, 100_000


class Follower:
    """A motion that is followed from segment to segment.

    Parameters
    ----------
    solution : EventSolution
        Keeps the segments.
    edges : array_like, shape (k,)
        Times in s, from the beginning of the run on, between which each load has one closed form. The motion is
        computed to the last one.
    time : float
        Time in s from which the motion is computed.
    status : ndarray of int, shape (n_contacts,)
    displacement, velocity : ndarray, shape (n,)
        Modal state at this time.
    pin_fraction : float
        See `pinned`.
    most_events : int
        Number of events after which `advance` returns, so that the caller can stop.

    Attributes
    ----------
    time, status, displacement, velocity
        Time, contact status and modal state that have been reached.
    calls : int
        Number of calls of the loop.
    """

    def __init__(
        self, solution: EventSolution, edges: ArrayLike, time: float, status: Status, displacement: Array,
        velocity: Array, pin_fraction: float, most_events: int,
    ) -> None:  # fmt: skip
        self.solution = solution
        self.time, self.status, self.displacement, self.velocity = time, status, displacement, velocity
        self.calls = 0
        loads = solution.exosystem = solution.loads_between(np.asarray(edges, dtype=float))
        self._loads = Loads(loads.edges, loads.states, loads.kind, loads.omega, loads.bend, solution.drift())
        self._pin_fraction, self._most_events = pin_fraction, most_events
        self._segments = FIRST_CALL
        self._statuses = Statuses(len(loads.omega))
        self._space: LoopSpace | None = None
        self._shapes: tuple[int, ...] = ()
        contacts, n = solution.space.contacts.shape
        self._reached = Reached(np.zeros(1), np.full(8, -1), np.zeros(n), np.zeros(n), np.zeros(contacts))
        self._laws = solution.system.cache.get("laws of the loop", pin_fraction, self._laws_of_system)

    def _laws_of_system(self) -> Laws:
        solution = self.solution
        rows, laws = np.array(solution.space.contacts), solution.system.contacts
        squares = np.sum(rows**2, axis=1)
        if laws is None:
            return Laws(rows, rows, squares, squares, squares, squares)
        # As in `pinned.may_pin`.
        scale = np.where(laws.jump, 1.01 * squares * self._pin_fraction * laws.gap, 0.0)
        return Laws(
            rows, np.array(solution.row_sizes), squares, np.array(laws.gap, dtype=float),
            scale * laws.stiffness * laws.gap, scale * laws.damping,
        )  # fmt: skip

    def advance(self) -> None:
        """Compute one segment or more. In compiled code a call takes about 0.1 s of wall time at most."""
        solution, place = self.solution, self._reached.place
        loads, number = solution.exosystem, solution.record.number(self.status)
        place[INTERVAL] = loads.interval(np.array([self.time]))[0]
        kind = int(loads.kind[place[INTERVAL]])
        regime = solution.regime(self.status, kind)
        group = regime.blocks.group
        if group is not None or solution.space.size > MOST_MODES:
            table = single(regime, number, kind, len(solution.record.statuses), len(loads.omega))
        else:
            table = self._statuses.enter(regime, number, kind)
            left, function = place[LEFT], place[FUNCTION]
            if 0 <= left < len(table.after) and function < table.after.shape[1]:
                table.after[left, function] = number
        place[STATUS], place[LEFT] = number, -1
        with nullcontext() if group is None else kernels(compiled=False):
            self._loop(regime, table)

    def _loop(self, regime: Regime, table: Table) -> None:
        solution, reached = self.solution, self._reached
        record, counters, place = solution.record, solution.counters, reached.place
        self._enter()
        place[SEGMENTS], place[EVENTS], place[EVALUATIONS] = record.segments, record.events, 0
        shapes = (*table.rows.shape[1:], *table.steady.shape[1:])
        if self._space is None or shapes != self._shapes:
            self._space, self._shapes = loop_space(table), shapes
        group, first, first_event, begun = regime.blocks.group, record.segments, record.events, time.perf_counter()
        record.make_room(1, 1)
        while True:
            reason = run_segments(
                table, group, self._laws, self._loads, reached, record.buffers, self._space,
                1 if group is not None else self._segments, self._most_events,
            )  # fmt: skip
            self.calls += 1
            record.segments, record.events = int(place[SEGMENTS]), int(place[EVENTS])
            if reason != FULL:
                break
            more = max(min(record.segments, MOST), 1)
            record.make_room(more, more)
        seconds = time.perf_counter() - begun
        if record.segments - first >= self._segments:
            self._segments = min(2 * self._segments, MOST) if seconds < 0.5 * _SECONDS else self._segments
            self._segments = max(self._segments // 2, 1) if seconds > 2.0 * _SECONDS else self._segments
        counters.steps += record.segments - first
        counters.events += record.events - first_event
        counters.gap_evaluations += int(place[EVALUATIONS]) * reached.gaps.size
        if record.segments > first:
            self._take_over(table, decide=reason == DECISION)

    def _enter(self) -> None:
        """Write the state that has been reached as that at which the next segment begins."""
        solution, reached, record = self.solution, self._reached, self.solution.record
        displacement, switched = self.displacement, np.zeros(0, dtype=np.int64)
        if record.segments:
            switched = np.flatnonzero((self.status != record.last_status) & (self.status != PINNED))
            if switched.size > 1:
                displacement = solution.at_gaps(switched, displacement, self.time)
        reached.time[0] = self.time
        reached.displacement[:], reached.velocity[:] = displacement, self.velocity
        reached.place[SWITCHED] = switched[0] if switched.size == 1 else -1
        reached.gaps[:] = solution.gaps_at(self.status, displacement, self.time)

    def _take_over(self, table: Table, *, decide: bool) -> None:
        """Take over the time and the state at which the loop has stopped, and take the decision about an event."""
        solution, reached, place, record = self.solution, self._reached, self._reached.place, self.solution.record
        self.time = float(reached.time[0])
        self.displacement, self.velocity = reached.displacement.copy(), reached.velocity.copy()
        solution.gaps_now = reached.gaps.copy()
        self.status = record.last_status
        if not (decide or place[SWITCHED] >= 0):
            return
        if not decide:
            self.status = self.status.copy()
            self.status[place[SWITCHED]] = record.buffers.event_status[record.events - 1]
            return
        assert self._space is not None
        s = table.slots[record.status_numbers[-1], solution.exosystem.kind[place[INTERVAL]]]
        place[LEFT] = -1
        hits = np.flatnonzero(self._space.search.hits[: table.counts[s, 0]])
        entered = dict(zip(table.owner[s, hits].tolist(), table.leads[s, hits].tolist(), strict=True))
        self.status = solution.enter(
            self.time, self.status, entered, self.displacement, self.velocity, self._pin_fraction
        )  # fmt: skip


def follower_of(
    solution: EventSolution, edges: ArrayLike, time: float, status: Status, displacement: Array, velocity: Array,
    pin_fraction: float, most_events: int,
) -> Follower | Walker:  # fmt: skip
    """Return what follows a motion: the compiled loop, or Python where there are rigid stops or sliders."""
    arguments = solution, edges, time, status, displacement, velocity, pin_fraction, most_events
    if solution.bounces is None and solution.given.sliders is None:
        return Follower(*arguments)
    from vofem.integrators.event_driven.walk import Walker

    return Walker(*arguments)
