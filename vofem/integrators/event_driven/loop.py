"""The loop over segments and events in compiled code.

It repeats in compiled code the step that `follow.Follower` does in Python: it begins the motion of the status, searches
for the next event, moves to it and changes the status. It returns if it needs the eigensystem of a new status or room
for more segments. It also returns if a segment is not of the common kind; this segment is then computed in Python.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.block_motion import Blocks, begin, most_special, move
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.search import (
    EVALUATION_WORK,
    BlockFlow,
    EventTerms,
    SearchSpace,
    exact_cut,
    march,
    search_space,
)
from vofem.integrators.event_driven.status_table import Table, to_blocks
from vofem.kernels.jit import jit
from vofem.linalg.vectors import copy, inner
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Why the loop returns: the run is at its end, the requested number of segments is done, a status has no slot, the
#: record is full, a segment is not of the common kind, or there were too many events.
DONE, PAUSED, NEW_STATUS, FULL, SPECIAL, STORM = range(6)

#: What `Reached.place` holds: slot of the status, interval of the loads, the contact that has just switched or -1,
#: numbers of segments and of events in the record, and how often event functions were evaluated.
SLOT, INTERVAL, SWITCHED, SEGMENTS, EVENTS, EVALUATIONS = range(6)

#: Work of the searches of a call, in the unit of `SEARCH_WORK`, after which the loop returns.
_CALL_WORK = 500_000

#: Size of the terms of a contact's coordinate, divided by its own size, above which it counts as a difference of large
#: numbers.
CANCELLING = 8.0


class Laws(NamedTuple):
    """The contacts of a run.

    Attributes
    ----------
    rows, row_sizes : ndarray, shape (n_contacts, n)
        Modal rows, and bounds on the terms that they are summed of.
    squares : ndarray, shape (n_contacts,)
        Squared norms of the rows.
    gap : ndarray, shape (n_contacts,)
        Gaps in m.
    pinning, pinning_rate : ndarray, shape (n_contacts,)
        A contact may be pinned where its speed squared is below ``pinning + pinning_rate speed``.
    """

    rows: Array
    row_sizes: Array
    squares: Array
    gap: Array
    pinning: Array
    pinning_rate: Array


class Reached(NamedTuple):
    """Time and state that a run has reached; changed in place.

    Attributes
    ----------
    time : ndarray, shape (1,)
        Time in s that has been reached.
    place : ndarray of int, shape (6,)
        Numbers whose order is that of `SLOT` and the constants after it.
    displacement, velocity : ndarray, shape (n,)
        Modal state at this time.
    gaps : ndarray, shape (n_contacts,)
        Gap functions, m.
    """

    time: Array
    place: Integers
    displacement: Array
    velocity: Array
    gaps: Array


class LoopSpace(NamedTuple):
    """Work space of the loop, in few arrays.

    Attributes
    ----------
    search : SearchSpace
    block : ndarray of int, shape (k,)
    ramp : ndarray of bool, shape (k,)
    answers : ndarray of complex, shape (3, k)
    waves : ndarray of complex, shape (2, n, n_harmonics)
        These four are parts of `Blocks`.
    modes : ndarray, shape (11, n)
    both : ndarray, shape (3, 2n)
    terms : ndarray, shape (6, n_contacts)
    steady : ndarray of complex, shape (n_contacts, n_harmonics)
    """

    search: SearchSpace
    block: Integers
    ramp: NDArray[np.bool_]
    answers: NDArray[np.complex128]
    waves: NDArray[np.complex128]
    modes: Array
    both: Array
    terms: Array
    steady: NDArray[np.complex128]


def loop_space(n: int, contacts: int, harmonics: int) -> LoopSpace:
    """Return work space for runs with n modes, so many contacts and loads of so many frequencies at most."""
    most = most_special(n, harmonics)
    return LoopSpace(
        search_space(n, contacts), np.empty(most, dtype=np.int64), np.empty(most, dtype=np.bool_),
        np.empty((3, most), dtype=np.complex128), np.empty((2, n, harmonics), dtype=np.complex128), np.empty((11, n)),
        np.empty((3, 2 * n)), np.empty((3, contacts)), np.empty((contacts, harmonics), dtype=np.complex128),
    )  # fmt: skip


@jit
def _at_gap(laws: Laws, j: int, displacement: Array) -> None:
    """Put a contact that has just switched at its gap, as `EventSolution` does."""
    size = 0.0
    for k in range(displacement.size):
        size += abs(laws.rows[j, k] * displacement[k])
    off = inner(laws.rows[j], displacement) - laws.gap[j]
    if size <= CANCELLING * (abs(laws.gap[j]) + abs(off)):
        share = off / laws.squares[j]
        for k in range(displacement.size):
            displacement[k] -= laws.rows[j, k] * share


@jit
def _fill_terms(
    table: Table, s: int, laws: Laws, blocks: Blocks, count: int, reached: Reached, displacement: Array,
    terms: EventTerms,
) -> None:  # fmt: skip
    """Fill in the event functions of a segment, as `EventSolution.event_functions` and `search.next_event` do."""
    n, mixed, w, u = reached.velocity.size, terms.mixed, terms.w, terms.u
    for j in range(w.shape[0]):
        sign = table.sign[s, j]
        terms.start[j] = sign * reached.gaps[j]
        level, poly, moving = table.level[s, j], 0.0, 0.0
        for k in range(n):
            poly += w[j, k] * blocks.poly_z[k]
            moving += w[j, k] * blocks.rate_z[k]
        if mixed:
            level = abs(level)
            for k in range(n):
                poly += u[j, k] * blocks.poly_v[k]
                moving += u[j, k] * blocks.rate_v[k]
                level += laws.row_sizes[j, k] * abs(displacement[k])
        terms.constant[j] = max(abs(level), abs(poly))
        terms.slope[j] = moving
        for h in range(count):
            steady = 0.0j
            for k in range(n):
                steady += w[j, k] * blocks.steady_z[k, h]
            if mixed:
                for k in range(n):
                    steady += u[j, k] * blocks.steady_v[k, h]
            terms.steady[j, h] = steady


@jit
def _only(hits: NDArray[np.bool_]) -> int:
    """Return the one that is true, -1 where none is and -2 where several are."""
    found = -1
    for j in range(hits.size):
        if hits[j]:
            if found >= 0:
                return -2
            found = j
    return found


@jit
def run_segments(
    table: Table, laws: Laws, loads: LoadTable, reached: Reached, out: Buffers, space: LoopSpace, horizon: float,
    segments: int, events: int,
) -> int:  # fmt: skip
    """Follow a run from segment to segment; return why it stops, see `DONE` and what follows it.

    Parameters
    ----------
    reached : Reached
        Time and state of the run, changed in place.
    out : Buffers
        Arrays of the record, to which segments and events are added.
    space : LoopSpace
        Work space.
    horizon : float
        Longest time in s for which a motion is computed.
    segments : int
        Number of segments after which the loop returns `PAUSED`. It also returns after `_CALL_WORK`.
    events : int
        Largest number of events in the whole run.
    """
    n, m = reached.displacement.size, laws.gap.size
    place, intervals = reached.place, loads.constant.shape[0]
    modes, waves, answers = space.modes, space.waves, space.answers
    blocks = Blocks(
        modes[0], modes[1], modes[2], modes[3], modes[4], modes[5], modes[6], modes[7], waves[0], waves[1],
        space.block, answers[0], answers[1], answers[2], space.ramp,
    )  # fmt: skip
    start, change, both, own = modes[8], modes[9:], space.both, space.terms
    most_evaluations = place[EVALUATIONS] + _CALL_WORK // (n + EVALUATION_WORK)
    for _ in range(segments):
        if place[EVALUATIONS] > most_evaluations:
            return PAUSED
        t = reached.time[0]
        if t >= loads.edges[intervals]:
            return DONE
        while loads.edges[place[INTERVAL] + 1] <= t:
            place[INTERVAL] += 1
        row, interval, s = place[SEGMENTS], place[INTERVAL], place[SLOT]
        if s < 0:
            return NEW_STATUS
        if row >= out.starts.size or place[EVENTS] >= out.event_time.size:
            return FULL
        copy(reached.displacement, start)
        if place[SWITCHED] >= 0:
            _at_gap(laws, place[SWITCHED], start)
        to_blocks(table, s, start, reached.velocity, blocks.z_start, blocks.v_start, both)
        special = begin(table, s, loads, interval, t, horizon, blocks)
        omega = loads.omega[interval, : loads.counts[interval]]
        duration = loads.edges[interval + 1] - t
        tau, hit, evaluations = duration, -1, 0
        if m:
            mixed = table.mixed[s]
            w, w_size = table.w[s], table.w_size[s]
            u, u_size = table.u[s] if mixed else w, table.u_size[s] if mixed else w_size
            terms = EventTerms(mixed, w, u, w_size, u_size, own[0], own[1], space.steady, own[2])
            _fill_terms(table, s, laws, blocks, omega.size, reached, start, terms)
            flow = BlockFlow(
                table.delta[s], table.p[s], table.frequency[s], blocks.z, blocks.v,
                omega, blocks.block[:special], blocks.exponent[:special], blocks.g1[:special], blocks.g2[:special],
                blocks.ramp[:special], None,
            )  # fmt: skip
            levels = table.levels[s, : table.level_count[s]]
            tau, evaluations = march(terms, flow, levels, duration, space.search)
            hit = _only(space.search.hits)
            if hit == -2:
                return SPECIAL
            if hit < 0 and tau < duration:
                tau = exact_cut(t, tau)
        move(table, s, omega, blocks, special, tau, change, both)
        if hit >= 0:
            speed = 0.0
            for k in range(n):
                speed += laws.rows[hit, k] * (reached.velocity[k] + change[1, k])
            speed = abs(speed)
            if speed * speed < laws.pinning[hit] + laws.pinning_rate[hit] * speed:
                return SPECIAL
        out.starts[row], out.durations[row], out.status[row] = t, tau, table.number[s]
        copy(reached.gaps, out.gaps[row])
        for k in range(n):
            out.displacement[row, k], out.velocity[row, k] = start[k], reached.velocity[k]
            reached.displacement[k] = start[k] + change[0, k]
            reached.velocity[k] += change[1, k]
        for j in range(m):
            reached.gaps[j] += inner(laws.rows[j], change[0])
        reached.time[0] = loads.edges[interval + 1] if tau >= duration else t + tau
        place[SEGMENTS] = row + 1
        place[EVALUATIONS] += evaluations
        place[SWITCHED] = hit
        if hit < 0:
            continue
        reached.gaps[hit] = 0.0
        e = place[EVENTS]
        out.event_time[e], out.event_contact[e] = reached.time[0], hit
        out.event_status[e] = CLOSED if table.sign[s, hit] > 0.0 else OPEN
        place[EVENTS] = e + 1
        place[SLOT] = table.following[s, hit]
        if place[SLOT] >= 0 and table.number[place[SLOT]] < 0:
            place[SLOT] = -1
        if e + 1 > events:
            return STORM
        if place[SLOT] < 0:
            return NEW_STATUS
    return PAUSED
