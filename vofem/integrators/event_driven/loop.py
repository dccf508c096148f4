"""The loop over segments and events.

It begins the motion of a segment, searches for the next event, moves to it and changes the contact status. It returns
if it needs a status that the table does not hold, or room for more segments, and where an event takes a decision: when
several contacts switch at once, or one may be pinned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.blocks import Blocks, change
from vofem.integrators.event_driven.clusters import Group
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.search import (
    EVALUATION_WORK,
    EventFunctions,
    SearchSpace,
    exact_cut,
    march,
    search_space,
)
from vofem.integrators.event_driven.table import Table
from vofem.kernels.jit import borrowed, jit
from vofem.linalg.vectors import copy, inner, multiply, multiply_transposed

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Why the loop returns: the run is at its end, the requested number of segments is done, the table has no slot for what
#: follows, the record is full, an event takes a decision, or there were too many events.
DONE, PAUSED, NEW_STATUS, FULL, DECISION, STORM = range(6)

#: What `Reached.place` holds: number of the contact status in the record or -1, interval of the loads, the contact that
#: has just switched or -1, numbers of segments and of events in the record, how often event functions were evaluated,
#: and the status and the event function of the last event.
STATUS, INTERVAL, SWITCHED, SEGMENTS, EVENTS, EVALUATIONS, LEFT, FUNCTION = range(8)

#: Columns of `Table.counts` and `Table.flags`.
_FUNCTIONS, _PAIRS, _LEVELS = range(3)
_PLAIN, _COUPLED, _MIXED, _HELD = range(4)

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


class Loads(NamedTuple):
    """The loads of a run, see `Exosystem`.

    Attributes
    ----------
    drift : ndarray, shape (n_kinds, n_contacts, e)
        Factors with which the loads enter the coordinates of contacts; (n_kinds, n_contacts, 0) where none does.
    """

    edges: Array
    states: Array
    kind: Integers
    omega: Array
    bend: Integers
    drift: Array


class Reached(NamedTuple):
    """Time and state that a run has reached; changed in place.

    Attributes
    ----------
    time : ndarray, shape (1,)
        Time in s that has been reached.
    place : ndarray of int, shape (8,)
        Numbers whose order is that of `STATUS` and the constants after it.
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
    work, bits : ndarray
        See `Blocks`.
    states : ndarray, shape (2, 2, m)
        States of all blocks at the beginning, and their changes.
    modal : ndarray, shape (4, n)
        State at the beginning, and its change.
    both : ndarray, shape (3, 2m)
        States of the blocks of the structure, and of real modes.
    terms : ndarray, shape (2, k)
        Values of event functions at the beginning, and sizes of their constants.
    """

    search: SearchSpace
    work: Array
    bits: Integers
    states: Array
    modal: Array
    both: Array
    terms: Array


def loop_space(table: Table) -> LoopSpace:
    """Return work space for what a table holds."""
    m, n, functions = table.of.shape[2], table.shift.shape[1], table.sign.shape[1]
    return LoopSpace(
        search_space(m, functions), np.empty((6, m)), np.zeros(m, dtype=np.int64), np.empty((2, 2, m)),
        np.empty((4, n)), np.empty((3, 2 * table.steady.shape[3])), np.empty((2, functions)),
    )  # fmt: skip


@jit
def at_gap(laws: Laws, j: int, moved: float, displacement: Array) -> None:
    """Move the displacement so that a contact that has just switched, and has moved itself, is exactly at its gap.

    Otherwise a stiff contact would turn the rounding of the displacement into energy. If a contact's coordinate is a
    small difference of large modal displacements, it is not corrected, because the correction would change these
    displacements by its rounding.
    """
    size = 0.0
    for k in range(displacement.size):
        size += abs(laws.rows[j, k] * displacement[k])
    off = inner(laws.rows[j], displacement) + moved - laws.gap[j]
    if size <= CANCELLING * (abs(laws.gap[j]) + abs(off)):
        share = off / laws.squares[j]
        for k in range(displacement.size):
            displacement[k] -= laws.rows[j, k] * share


@jit
def _load_state(loads: Loads, interval: int, t: float, begin: Array) -> None:
    """Write values and rates of the loads at a time, into the first columns of an array (2, m)."""
    late, kind = t - loads.edges[interval], loads.kind[interval]
    for j in range(loads.omega.shape[1]):
        w, value, rate = loads.omega[kind, j], loads.states[interval, 0, j], loads.states[interval, 1, j]
        begin[0, j], begin[1, j] = value + late * rate, rate
        if w > 0.0:
            cosine, sine = np.cos(w * late), np.sin(w * late)
            begin[0, j], begin[1, j] = cosine * value + sine / w * rate, cosine * rate - w * sine * value
        bend = loads.bend[j]
        if bend >= 0:
            second, third = loads.states[interval, 0, bend], loads.states[interval, 1, bend]
            begin[0, j] += late * late * (second / 2.0 + late * third / 6.0)
            begin[1, j] += late * (second + late * third / 2.0)


@jit
def _moved(loads: Loads, kind: int, contact: int, values: Array) -> float:
    """Return what values of the loads, shape (m,) or more, add to the coordinate of a contact."""
    total = 0.0
    for i in range(loads.drift.shape[2]):
        total += loads.drift[kind, contact, i] * values[i]
    return total


@jit
def to_blocks(table: Table, s: int, displacement: Array, velocity: Array, both: Array) -> None:
    """Write a modal state in the blocks of a status, into the first row of an array (3, 2m), displacements first."""
    m = both.shape[1] // 2
    real = 1 if table.flags[s, _COUPLED] else 0
    if table.flags[s, _PLAIN]:
        copy(displacement, both[real, :m])
        copy(velocity, both[real, m:])
    else:
        multiply_transposed(table.modes[s], displacement, both[real, :m])
        multiply_transposed(table.modes[s], velocity, both[real, m:])
    if real:
        multiply(table.into[s].reshape(2 * m, 2 * m), both[1], both[0])


@jit
def from_blocks(table: Table, s: int, both: Array, displacement: Array, velocity: Array) -> None:
    """Write a state in the blocks of a status, or a difference of states, as a modal one, the shift left out."""
    m = both.shape[1] // 2
    real = 0
    if table.flags[s, _COUPLED]:
        multiply(table.out[s].reshape(2 * m, 2 * m), both[0], both[1])
        real = 1
    if table.flags[s, _PLAIN]:
        copy(both[real, :m], displacement)
        copy(both[real, m:], velocity)
    else:
        multiply(table.modes[s], both[real, :m], displacement)
        multiply(table.modes[s], both[real, m:], velocity)


@jit
def _add_answers(table: Table, s: int, states: Array, sign: float, both: Array) -> None:
    """Add the steady answers to the loads in the states of all blocks, times a sign, to states of shape (2m,)."""
    m, loads = both.size // 2, table.steady.shape[1] // 2
    for j in range(loads):
        value, rate = sign * states[0, j], sign * states[1, j]
        for half in range(2):
            answer, later = table.steady[s, j, half], table.steady[s, loads + j, half]
            for k in range(m):
                both[half * m + k] += value * answer[k] + rate * later[k]


@jit
def _begin(table: Table, s: int, laws: Laws, loads: Loads, reached: Reached, space: LoopSpace) -> None:
    """Fill in the states of the structure's blocks and the event functions at the beginning of a segment."""
    begin, modal, both, place = space.states[0], space.modal, space.both, reached.place
    n, m, first = modal.shape[1], both.shape[1] // 2, table.steady.shape[1] // 2
    held, displacement, velocity = table.flags[s, _HELD], modal[0], modal[1]
    copy(reached.displacement, displacement)
    copy(reached.velocity, velocity)
    if place[SWITCHED] >= 0:
        moved = _moved(loads, loads.kind[place[INTERVAL]], place[SWITCHED], begin[0])
        at_gap(laws, place[SWITCHED], moved, displacement)
        copy(displacement, reached.displacement)
    if held:
        for k in range(n):
            displacement[k] -= table.shift[s, k]
    to_blocks(table, s, displacement, velocity, both)
    copy(both[0], both[2])
    _add_answers(table, s, begin, -1.0, both[2])
    copy(both[2, :m], begin[0, first:])
    copy(both[2, m:], begin[1, first:])
    if held:
        # Pinned contacts are put at their gaps.
        from_blocks(table, s, both, displacement, velocity)
        for k in range(n):
            displacement[k] += table.shift[s, k]
    for j in range(table.counts[s, _FUNCTIONS]):
        sign, owner, size = table.sign[s, j], table.owner[s, j], table.level[s, j]
        if sign == 0.0:
            value = inner(table.rows[s, j, 0], begin[0]) + inner(table.rows[s, j, 1], begin[1])
        else:
            value = sign * reached.gaps[owner]
            if table.flags[s, _COUPLED]:
                # Rounding from earlier segments. The search itself considers only the changes within this segment.
                for k in range(n):
                    size += laws.row_sizes[owner, k] * abs(displacement[k])
        space.terms[0, j], space.terms[1, j] = value, size


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
    table: Table, group: Group | None, laws: Laws, loads: Loads, reached: Reached, out: Buffers, space: LoopSpace,
    segments: int, events: int,
) -> int:  # fmt: skip
    """Follow a run from segment to segment; return why it stops, see `DONE` and what follows it.

    Parameters
    ----------
    group : Group or None
        That of the only linear piece in the table; its blocks are not independent.
    reached : Reached
        Time and state of the run, changed in place.
    out : Buffers
        Arrays of the record, to which segments and events are added.
    space : LoopSpace
        Work space.
    segments : int
        Number of segments after which the loop returns `PAUSED`. It also returns after `_CALL_WORK`.
    events : int
        Largest number of events in the whole run.
    """
    table, laws, loads, reached = borrowed(table), borrowed(laws), borrowed(loads), borrowed(reached)
    out, space = borrowed(out), borrowed(space)
    n, contacts, m = reached.displacement.size, laws.gap.size, space.states.shape[2]
    place, begin, moved, modal = reached.place, space.states[0], space.states[1], space.modal
    first, intervals = loads.omega.shape[1], loads.kind.size
    most_evaluations = place[EVALUATIONS] + _CALL_WORK // (m + EVALUATION_WORK)
    for _ in range(segments):
        if place[EVALUATIONS] > most_evaluations:
            return PAUSED
        t = reached.time[0]
        if t >= loads.edges[intervals]:
            return DONE
        while loads.edges[place[INTERVAL] + 1] <= t:
            place[INTERVAL] += 1
        row, interval, number = place[SEGMENTS], place[INTERVAL], place[STATUS]
        s = table.slots[number, loads.kind[interval]] if 0 <= number < table.slots.shape[0] else -1
        if s < 0:
            return NEW_STATUS
        if row >= out.starts.size or place[EVENTS] >= out.event_time.size:
            return FULL
        _load_state(loads, interval, t, begin)
        _begin(table, s, laws, loads, reached, space)
        pairs, count = table.counts[s, _PAIRS], table.counts[s, _FUNCTIONS]
        blocks = Blocks(table.of[s], table.pair[s, :pairs], table.gain[s, :pairs], group, space.work, space.bits)
        duration = loads.edges[interval + 1] - t
        tau, hit, evaluations = duration, -1, 0
        if count:
            terms = EventFunctions(
                table.rows[s], table.sizes[s], space.terms[0, :count], space.terms[1, :count], first,
                m if table.flags[s, _MIXED] else first,
            )  # fmt: skip
            levels = table.levels[s, : table.counts[s, _LEVELS]]
            tau, evaluations = march(terms, blocks, levels, begin, duration, space.search)
            hit = _only(space.search.hits[:count])
            if hit == -1 and tau < duration:
                tau = exact_cut(t, tau)
        change(blocks, begin, tau, moved)
        copy(moved[0, first:], space.both[0, : m - first])
        copy(moved[1, first:], space.both[0, m - first :])
        _add_answers(table, s, moved, 1.0, space.both[0])
        from_blocks(table, s, space.both, modal[2], modal[3])
        out.starts[row], out.durations[row], out.status[row] = t, tau, number
        copy(reached.gaps, out.gaps[row])
        for k in range(n):
            out.displacement[row, k], out.velocity[row, k] = reached.displacement[k], reached.velocity[k]
            reached.displacement[k] = modal[0, k] + modal[2, k]
            reached.velocity[k] = modal[1, k] + modal[3, k]
        for j in range(contacts):
            reached.gaps[j] += inner(laws.rows[j], modal[2]) + _moved(loads, loads.kind[interval], j, moved[0])
        reached.time[0] = loads.edges[interval + 1] if tau >= duration else t + tau
        place[SEGMENTS] = row + 1
        place[EVALUATIONS] += evaluations
        place[SWITCHED] = -1
        if hit == -1:
            continue
        place[LEFT], place[FUNCTION], place[STATUS] = number, hit, -1
        if hit == -2:
            return DECISION
        contact = table.owner[s, hit]
        if table.sign[s, hit] != 0.0:
            speed = abs(inner(laws.rows[contact], reached.velocity))
            if speed * speed < laws.pinning[contact] + laws.pinning_rate[contact] * speed:
                return DECISION
        place[SWITCHED] = contact
        reached.gaps[contact] = 0.0
        e = place[EVENTS]
        out.event_time[e], out.event_contact[e] = reached.time[0], contact
        out.event_status[e] = table.leads[s, hit]
        place[EVENTS] = e + 1
        if number < table.after.shape[0]:
            place[STATUS] = table.after[number, hit]
        if e + 1 > events:
            return STORM
        if place[STATUS] < 0:
            return NEW_STATUS
    return PAUSED
