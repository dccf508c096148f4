"""Follows a motion from segment to segment by the loop, and takes the decisions that the loop leaves open.

`walk.Walker` adds those of rigid stops and sliders.

A compiled loop computes many segments in a call. The numbers do not depend on where it returns, so that a run that is
continued from a snapshot gives the same bits.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.exosystem import load_bounds
from vofem.integrators.event_driven.loop import (
    ANCHOR,
    BOUNCES,
    COLUMNS,
    DECISION,
    DONE,
    EDGES,
    EVALUATIONS,
    EVENT_ROOM,
    EVENTS,
    FULL,
    FUNCTION,
    INTERVAL,
    LEFT,
    MODES_OF_RUN,
    NUMBERS,
    OVERLOAD,
    SEARCH,
    SEGMENT_ROOM,
    SEGMENTS,
    SLIPS,
    STATUS,
    SWITCHED,
    SWITCHED_TO,
    UNSURE,
    WORK_F,
    WORK_X,
    run_segments,
    work_space,
)
from vofem.integrators.event_driven.regime import Regime
from vofem.integrators.event_driven.search import HIT, march
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.table import Statuses
from vofem.kernels.addresses import address_of, place_of
from vofem.kernels.jit import CompiledFunction
from vofem.kernels.mode import kernels
from vofem.system import PINNED

Status = NDArray[np.int64]

#: Most segments in a call of the loop, whose work is bounded too, and most by which the record grows at once.
MOST = 100_000


class Follower:
    """A motion that is followed from segment to segment.

    `solution`: keeps the segments.
    `time`: time in s from which the motion is computed.
    `status` has shape (n_contacts,).
    `displacement`, `velocity` (shape (n,)): modal state at this time.
    `pin_fraction`: see `pinned`.
    `most_events`: number of events after which `advance` returns, so that the caller can stop.
    `time`, `status`, `displacement`, `velocity`: time, contact status and modal state that have been reached.
    `calls`: number of calls of the loop.
    """

    def __init__(
        self, solution: EventSolution, time: float, status: Status, displacement: Array, velocity: Array,
        pin_fraction: float, most_events: int,
    ) -> None:  # fmt: skip
        self.solution = solution
        self.time, self.status, self.displacement, self.velocity = time, status, displacement, velocity
        self.calls = 0
        loads = solution.exosystem
        self._pin_fraction, self._most_events = pin_fraction, most_events
        self._statuses = Statuses(len(loads.omega))
        # The table and the arrays of the record whose places the loop has, and its work space.
        self._placed: tuple[Any, Any] = (None, None)
        self._space: list[Array] = []
        contacts, n = solution.space.contacts.shape
        drift = solution.drift()
        self._run = np.full(NUMBERS, -1)
        # Rows from this one on are sliders.
        self._stops = contacts if solution.sliders is None else solution.sliders.first
        self._run[MODES_OF_RUN:SEARCH] = n, contacts, self._stops, loads.size, loads.kind.size, drift.shape[2], 0, 0
        self._run[UNSURE] = 0
        self._time, self._state, self._gaps = np.zeros(1), np.zeros((2, n)), np.zeros(contacts)
        # The largest speed of approach of each rigid stop, and the largest modal displacements and velocities so far.
        self._largest, self._seen = np.zeros(contacts), np.zeros((2, n))
        # Rounding of the distances of contacts that leave their stops, and the sliders that have changed their status.
        self._fresh = np.zeros((2, contacts))
        # Whether the next segment is one with rounding of its own, see `_fresh`.
        self._single = False
        laws = solution.system.cache.get("laws of the loop", pin_fraction, self._laws_of_system)
        bounds = np.zeros((0, n))
        if solution.sliders is not None:
            laws = laws.copy()
            laws[self._stops :, ANCHOR] = solution.sliders.lines(loads.function[0], loads.omega[0])
            bounds = load_bounds(loads, solution.load_vectors)
        rows = solution.space.contacts
        row_sizes = rows if solution.system.contacts is None else solution.row_sizes
        self._frequencies = np.sqrt(np.abs(solution.space.stiffness))
        given = [
            loads.edges, loads.states, loads.kind, loads.omega, loads.bend, drift, rows, row_sizes, laws,
            self._frequencies, bounds,
        ]  # fmt: skip
        # Arrays of the loop in the order of their places, up to those of the record.
        now = [self._largest, self._seen, self._fresh, self._time, self._state, self._gaps]
        self._arrays = [*map(np.ascontiguousarray, given), *now]

    def _laws_of_system(self) -> Array:
        """Return the array of the laws, see `loop.GAP`."""
        solution = self.solution
        laws, squares = solution.system.contacts, np.sum(np.array(solution.space.contacts) ** 2, axis=1)
        if laws is None:
            return np.zeros((0, COLUMNS))
        # As in `pinned.may_pin`.
        scale = np.where(laws.jump, 1.01 * squares * self._pin_fraction * laws.gap, 0.0)
        pinning = scale * laws.stiffness * laws.gap, scale * laws.damping
        limits = np.zeros((2, laws.gap.size))
        if solution.sliders is not None:
            limits[:, self._stops :] = solution.sliders.breaks, solution.sliders.stretch
        restitution = np.where(laws.rigid, laws.restitution, -1.0)
        return np.stack([laws.gap, squares, *pinning, restitution, *limits, np.zeros(laws.gap.size)], axis=1)

    def advance(self) -> None:
        """Compute one segment or more. In compiled code a call takes about 0.1 s at most."""
        solution, run, statuses = self.solution, self._run, self._statuses
        loads, number = solution.exosystem, solution.record.number(self.status)
        run[INTERVAL] = loads.interval(np.array([self.time]))[0]
        kind = int(loads.kind[run[INTERVAL]])
        regime = solution.regime(self.status, kind)
        group = regime.blocks.group
        with nullcontext() if group is None else kernels(compiled=False):
            if group is not None:
                statuses = Statuses(len(loads.omega))
            statuses.enter(regime, number, kind)
            left, function = run[LEFT], run[FUNCTION]
            if 0 <= left < statuses.after.shape[0] and function < statuses.after.shape[1]:
                statuses.after[left, function] = number
                # The contact may switch back.
                contact, exits = run[SWITCHED], regime.exits
                back = (exits.owner == contact) & (exits.leads == solution.record.statuses[left][contact])
                statuses.after[number, : back.size][back] = left
            run[STATUS], run[LEFT] = number, -1
            self._loop(regime, statuses)

    def _loop(self, regime: Regime, statuses: Statuses) -> None:
        solution, run = self.solution, self._run
        record, counters, group = solution.record, solution.counters, regime.blocks.group
        self._enter()
        run[SEGMENTS], run[EVENTS] = record.segments, record.events
        run[EVALUATIONS] = run[BOUNCES] = run[SLIPS] = 0
        first, first_event = record.segments, record.events
        record.make_room(2, 2)
        while True:
            self._place(statuses.table)
            reason = run_segments(
                statuses.table, statuses.slots, statuses.after, run,
                1 if group is not None or self._single else MOST, self._most_events,
            )  # fmt: skip
            self.calls += 1
            record.segments, record.events = int(run[SEGMENTS]), int(run[EVENTS])
            if reason != FULL:
                break
            more = max(min(record.segments, MOST), 2)
            record.make_room(more, more)
        counters.steps += record.segments - first - int(run[BOUNCES])
        counters.events += record.events - first_event + int(run[SLIPS])
        counters.gap_evaluations += int(run[EVALUATIONS]) * self._gaps.size
        if record.segments > first or reason != DONE:
            self._take_over(self._space[WORK_F - WORK_X] if reason == DECISION else None, overload=reason == OVERLOAD)

    def _place(self, table: NDArray[np.int64]) -> None:
        """Write the places of all arrays, where these are no longer those of the last call."""
        run, buffers = self._run, self.solution.record.buffers
        if table is self._placed[0] and buffers is self._placed[1]:
            return
        if table is not self._placed[0]:
            self._space = work_space(table, self.solution.space.size)
        self._placed = table, buffers
        run[SEARCH] = address_of(cast(CompiledFunction, march))
        run[SEGMENT_ROOM], run[EVENT_ROOM] = buffers.starts.size, buffers.event_time.size
        run[EDGES:] = [place_of(array) for array in (*self._arrays, *buffers, *self._space)]

    def _enter(self) -> None:
        """Write the state that has been reached as that at which the next segment begins."""
        solution, record = self.solution, self.solution.record
        displacement, switched = self.displacement, np.zeros(0, dtype=np.int64)
        if record.segments:
            changed = (self.status != record.last_status) & (self.status != PINNED)
            switched = np.flatnonzero(changed[: self._stops])
            if switched.size > 1:
                displacement = solution.at_gaps(switched, displacement, self.time)
        self._time[0], self._state[0], self._state[1] = self.time, displacement, self.velocity
        if not self._run[UNSURE]:
            # Else it is known what has switched.
            self._run[SWITCHED] = switched[0] if switched.size == 1 else -1
        self._gaps[:] = solution.gaps_at(self.status, displacement, self.time)

    def _take_over(self, functions: Array | None, *, overload: bool) -> None:
        """Take over the time and the state at which the loop has stopped; decide about an event by its functions.

        `overload`: whether sliders cannot hold what follows the last event.
        """
        solution, run, record = self.solution, self._run, self.solution.record
        self.time = float(self._time[0])
        self.displacement, self.velocity = self._state.copy()
        solution.gaps_now = self._gaps.copy()
        self.status = record.last_status
        if functions is None:
            if run[SWITCHED] >= 0:
                self.status = self.status.copy()
                self.status[run[SWITCHED]] = run[SWITCHED_TO]
            return
        regime = solution.regime(self.status, int(solution.exosystem.kind[run[INTERVAL]]))
        count = regime.exits.sign.size
        hits = np.flatnonzero(functions[HIT * count : (HIT + 1) * count])
        entered = dict(zip(regime.exits.owner[hits].tolist(), regime.exits.leads[hits].tolist(), strict=True))
        run[LEFT] = -1
        self._pass_event(entered)

    def _pass_event(self, entered: dict[int, int]) -> None:
        """Change the status at an event, given the contacts that reach a limit and where this leads."""
        self.status = self.solution.enter(
            self.time, self.status, entered, self.displacement, self.velocity, self._pin_fraction
        )
