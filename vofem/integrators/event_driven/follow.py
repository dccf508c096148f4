"""Computes a motion segment by segment, in compiled code where this is possible and otherwise in Python.

A step in Python handles every segment: contacts that are pinned, events of several contacts at once, clusters of
complex modes. The compiled loop (`loop.run_segments`) handles the common ones, many in one call. The choice between
them depends on the motion alone, so that a run that is continued from a snapshot gives the same bits.
"""

from __future__ import annotations

import time
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.integrators.event_driven.load_table import LoadTable, load_table
from vofem.integrators.event_driven.loop import (
    EVALUATIONS,
    EVENTS,
    FULL,
    SEGMENTS,
    SLOT,
    SPECIAL,
    SWITCHED,
    Laws,
    LoopSpace,
    Reached,
    loop_space,
    run_segments,
)
from vofem.integrators.event_driven.search import exact_cut, next_event
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.status_table import MOST_MODES
from vofem.kernels.mode import compiled
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Segments in the first call of the compiled loop; seconds that a call may take; segments and events in any call.
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
    calls, steps : int
        Number of calls of the compiled loop, and number of segments that were computed in Python.
    """

    def __init__(
        self, solution: EventSolution, edges: ArrayLike, time: float, status: Status, displacement: Array,
        velocity: Array, pin_fraction: float, most_events: int,
    ) -> None:  # fmt: skip
        self.solution = solution
        self.time, self.status, self.displacement, self.velocity = time, status, displacement, velocity
        self.calls, self.steps = 0, 0
        self._edges = np.asarray(edges, dtype=float)
        self._stop = 0
        self._pin_fraction, self._most_events = pin_fraction, most_events
        self._segments = FIRST_CALL
        self._in_loop = compiled() and solution.space.size <= MOST_MODES

    def advance(self) -> None:
        """Compute one segment or more. In compiled code a call takes about 0.1 s of wall time at most."""
        slot = self._slot() if self._in_loop else -1
        if slot >= 0:
            self._loop(slot)
        else:
            self._step()

    # -- in Python --------------------------------------------------------------------------------

    def _step(self) -> None:
        """Compute one segment."""
        solution, edges = self.solution, self._edges
        self.steps += 1
        while edges[self._stop] <= self.time:
            self._stop += 1
        t, stop = self.time, float(edges[self._stop])
        motion = solution.add_segment(t, self.status, self.displacement, self.velocity)
        tau, duration = stop - t, stop - t
        entered = None
        if solution.system.contacts is not None:
            functions, owner, entering = solution.event_functions(motion)
            if owner.size:
                tau, hits, evaluations = next_event(functions, motion, duration)
                solution.counters.gap_evaluations += evaluations * len(solution.system.contacts)
                if hits.any():
                    entered = dict(zip(owner[hits].tolist(), entering[hits].tolist(), strict=True))
                elif tau < duration:
                    tau = exact_cut(t, tau)
        self.displacement, self.velocity = solution.end_segment(tau)
        self.time = stop if tau >= duration else t + tau
        if entered is not None:
            self.status = solution.enter(
                self.time, self.status, entered, self.displacement, self.velocity, self._pin_fraction
            )

    # -- in compiled code -------------------------------------------------------------------------

    @cached_property
    def _loads(self) -> LoadTable | None:
        return load_table(self.solution.load_functions, self._edges)

    @cached_property
    def _laws(self) -> Laws:
        return self.solution.system.cache.get("laws of the loop", self._pin_fraction, self._laws_of_system)

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

    @cached_property
    def _reached(self) -> Reached:
        n, contacts = self.solution.space.contacts.shape[1], self.solution.space.contacts.shape[0]
        return Reached(np.zeros(1), np.zeros(6, dtype=np.int64), np.zeros(n), np.zeros(n), np.zeros(contacts))

    @cached_property
    def _space(self) -> LoopSpace:
        assert self._loads is not None
        contacts, n = self.solution.space.contacts.shape
        return loop_space(n, contacts, self._loads.omega.shape[1])

    def _slot(self) -> int:
        """Return the slot of the status for the compiled loop; -1 where the next segment is for Python."""
        status, record = self.status, self.solution.record
        if self._loads is None:
            return -1
        if record.segments and np.count_nonzero(status != record.last_status) > 1:
            return -1
        return self.solution.slot(status)

    def _loop(self, slot: int) -> None:
        """Continue in compiled code from a slot, or with a step in Python if the next segment needs it."""
        assert self._loads is not None
        solution, reached = self.solution, self._reached
        record, counters = solution.record, solution.counters
        reached.time[0] = self.time
        reached.displacement[:], reached.velocity[:] = self.displacement, self.velocity
        changed = np.flatnonzero(self.status != record.last_status).tolist() if record.segments else []
        reached.place[SLOT], reached.place[SWITCHED] = slot, changed[0] if changed else -1
        reached.place[SEGMENTS], reached.place[EVENTS], reached.place[EVALUATIONS] = record.segments, record.events, 0
        reached.gaps[:] = solution.gaps_at(self.status, self.displacement)
        first, first_event, begun = record.segments, record.events, time.perf_counter()
        record.make_room(1, 1)
        while True:
            reason = run_segments(
                solution.table.arrays, self._laws, self._loads, reached, record.buffers, self._space, solution.t_end,
                self._segments, self._most_events,
            )  # fmt: skip
            self.calls += 1
            record.segments, record.events = int(reached.place[SEGMENTS]), int(reached.place[EVENTS])
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
        counters.gap_evaluations += int(reached.place[EVALUATIONS]) * reached.gaps.size
        if record.segments > first:
            self._take_over()
        if reason == SPECIAL:
            self._step()

    def _take_over(self) -> None:
        """Take over the time and the state at which the compiled loop has stopped."""
        reached, record = self._reached, self.solution.record
        self.time = float(reached.time[0])
        self.displacement, self.velocity = reached.displacement.copy(), reached.velocity.copy()
        self.solution.gaps_now = reached.gaps.copy()
        self.status = record.last_status
        if reached.place[SWITCHED] >= 0:
            contact = reached.place[SWITCHED]
            self.status = self.status.copy()
            self.status[contact] = OPEN if self.status[contact] == CLOSED else CLOSED
