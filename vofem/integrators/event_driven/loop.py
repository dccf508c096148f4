"""The loop over segments and events.

It begins the motion of a segment, searches for the next event, moves to it and changes the contact status, lets a
body bounce off a rigid stop, or lets a slider stop or begin to slide. It returns if it needs a status that the table
does not hold, or room for more segments, and where an event takes a decision: when several contacts switch at once, one
may be pinned, an impact does more than turn the speed at its stop, or what a slider does moves others.

Sliders are the last rows of the contacts, see `sliders`. What a rigid one that sticks would have to hold tells at the
beginning of a segment whether it can.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.bounces import REST
from vofem.integrators.event_driven.search import (
    BEGINNING,
    BLOCKS,
    CONSTANTS,
    EVALUATION_WORK,
    FUNCTION_OF,
    FUNCTION_ROWS,
    FUNCTIONS,
    HIT,
    MOVED,
    OWN,
    START,
    WORK,
)
from vofem.integrators.event_driven.search import ROWS as SEARCH_ROWS
from vofem.integrators.event_driven.table import (
    CARRIED,
    INTO,
    LEADS,
    LEVEL,
    MODES,
    OF,
    OUT,
    OWNER,
    SHIFT,
    SIGN,
    SLIDES,
    STEADY,
    TAKEN,
)
from vofem.kernels.addresses import call, floats, integers, shaped
from vofem.kernels.jit import jit
from vofem.laws.friction import DOWN, UP
from vofem.linalg.vectors import copy, inner, multiply, multiply_transposed
from vofem.system import CLOSED, OPEN

Integers = NDArray[np.int64]

#: Why the loop returns: the run is at its end, the requested number of segments is done, the table has no slot for what
#: follows, the record is full, an event takes a decision, sliders cannot hold what follows, or there were too many
#: events.
DONE, PAUSED, NEW_STATUS, FULL, DECISION, OVERLOAD, STORM = range(7)

#: The numbers of a run begin with what the loop changes: number of the contact status in the record or -1, interval of
#: the loads, the contact that has just switched or -1 and its status, numbers of segments and of events in the record,
#: how often event functions were evaluated, the status and the event function of the last event, the numbers of bounces
#: and of events of sliders, and whether sliders hold what follows the last event is not known yet.
STATUS, INTERVAL, SWITCHED, SWITCHED_TO, SEGMENTS, EVENTS = range(6)
EVALUATIONS, LEFT, FUNCTION, BOUNCES, SLIPS, UNSURE = range(6, 12)

#: Then follow sizes: modes n, contacts c, of which the first ones are no sliders, loads e, intervals i of the loads,
#: loads that enter the coordinates of contacts (e or 0), rows of the record for segments and for events; and the
#: address of `march`.
MODES_OF_RUN, CONTACTS, STOPS, LOADS, INTERVALS, DRIFTING, SEGMENT_ROOM, EVENT_ROOM, SEARCH = range(12, 21)

#: Then places of arrays: of the loads, see `Exosystem` and `EventSolution.drift`; of the contacts their rows (c, n),
#: bounds on the terms that these are summed of, and `LAWS`; the frequencies of the modes (n,); with sliders bounds on
#: the modal loads in each interval (i, n); the largest speed of approach of each rigid stop (c,), and the largest modal
#: state of a scene with such stops or sliders (2, n); distances that are rounding of contacts that leave their stops
#: without speed, m, or -1e100 where nothing moves them, and 1 for the sliders that have just changed their status
#: (2, c); the time that has been reached (1,), the modal state (2, n) and the gap functions (c,); the arrays of the
#: record, see `Buffers`; and work space.
EDGES, STATES, KINDS, OMEGA, BEND, DRIFT, CONTACT_ROWS, CONTACT_SIZES, LAWS, FREQUENCIES, PUSHES = range(21, 32)
LARGEST, SEEN, FRESH, TIME, STATE, GAPS = range(32, 38)
STARTS, DURATIONS, STATUSES, DISPLACEMENTS, VELOCITIES, SEGMENT_GAPS, LOGGED = range(38, 45)
EVENT_TIME, EVENT_CONTACT, EVENT_STATUS, WORK_X, WORK_F, WORK_MODAL, WORK_BOTH, NUMBERS = range(45, 53)

#: Columns of the array of the laws, (c, 9): the gap in m, the squared norm of the row, two numbers (a contact may be
#: pinned where its speed squared is below ``pinning + pinning_rate speed``), the restitution of a rigid stop, which is
#: -1 for other contacts; and for sliders the limit at which they break away, in N or, behind a spring, as its
#: elongation in m, the elongation while they slide, which is zero for rigid ones, and the load that puts the anchor in
#: its place.
GAP, SQUARE_OF_ROW, PINNING, PINNING_RATE, RESTITUTION, BREAKS, STRETCH, ANCHOR, COLUMNS = range(9)

#: Work of the searches of a call, in the unit of `SEARCH_WORK`, after which the loop returns.
_CALL_WORK = 500_000

#: A speed or a force below this share of the terms that it is summed of, as large as they have been, is zero.
ZERO = 1e-13

#: Size of the terms of a contact's coordinate, divided by its own size, above which it counts as a difference of large
#: numbers.
CANCELLING = 8.0

#: Share of the time of a search within which an open contact is not told from one that rests at its gap.
NEAR = 1e-6

#: A slip speed below this share of the largest one so far is zero, and so is an acceleration of its terms.
STILL = 1e-11

#: Share of its limit by which a stuck slider may exceed it.
OVER = 1e-12


def work_space(table: Integers, n: int) -> list[Array]:
    """Return work space for the pieces of a table of n modes, in the order of its places."""
    functions, blocks, own = (int(table[:, column].max()) for column in (FUNCTIONS, BLOCKS, OWN))
    sizes = SEARCH_ROWS * blocks, FUNCTION_ROWS * functions, 4 * n, 6 * own
    return [np.empty(size) for size in sizes]


@jit
def at_gap(row: Array, law: Array, moved: float, displacement: Array) -> None:
    """Move the displacement so that a contact that has just switched, and has moved itself, is exactly at its gap.

    Otherwise a stiff contact would turn the rounding of the displacement into energy. If a contact's coordinate is a
    small difference of large modal displacements, it is not corrected, because the correction would change these
    displacements by its rounding.
    """
    size = 0.0
    for k in range(displacement.size):
        size += abs(row[k] * displacement[k])
    off = inner(row, displacement) + moved - law[GAP]
    if size <= CANCELLING * (abs(law[GAP]) + abs(off)):
        share = off / law[SQUARE_OF_ROW]
        for k in range(displacement.size):
            displacement[k] -= row[k] * share


@jit
def _see(seen: Array, displacement: Array, velocity: Array) -> None:
    """Take a modal state among those whose size tells what is rounding: the largest ones so far, shape (2, n)."""
    for k in range(displacement.size):
        seen[0, k], seen[1, k] = max(seen[0, k], abs(displacement[k])), max(seen[1, k], abs(velocity[k]))


@jit
def _zero(row: Array, seen: Array, frequencies: Array) -> float:
    """Return the speed at a contact that is rounding: displacements that are rounded move as they would vibrate."""
    size = 0.0
    for k in range(row.size):
        size += abs(row[k]) * (frequencies[k] * seen[0, k] + seen[1, k])
    return ZERO * size


@jit
def _fastest(row: Array, seen: Array) -> float:
    """Return the size of the terms of the speed at a contact, as large as they have been, m/s."""
    size = 0.0
    for k in range(row.size):
        size += abs(row[k]) * seen[1, k]
    return size


@jit
def _push(row: Array, seen: Array, frequencies: Array, load: Array) -> float:
    """Return the size of the acceleration at a contact, of which forces may balance each other, m/s^2.

    `load` (shape (n,)): bounds on the modal loads.
    """
    size = 0.0
    for k in range(row.size):
        size += abs(row[k]) * (frequencies[k] * (frequencies[k] * seen[0, k] + seen[1, k]) + load[k])
    return size


@jit
def _carry(carried: int, loads: Array, sign: float, modal: Array) -> None:
    """Add the displacements or velocities (n,) that follow from loads (e,), times a sign; see `sliders`."""
    if carried:
        factors = shaped(floats(carried), (modal.size, loads.size))
        for k in range(modal.size):
            modal[k] += sign * inner(factors[k], loads)


@jit
def _load_state(late: float, first: Array, omega: Array, bend: Integers, begin: Array) -> None:
    """Write values and rates of the loads, (2, m), at a time after the beginning of an interval, where they are first.

    They are the first columns.
    """
    for j in range(omega.size):
        w, value, rate = omega[j], first[0, j], first[1, j]
        begin[0, j], begin[1, j] = value + late * rate, rate
        if w > 0.0:
            cosine, sine = np.cos(w * late), np.sin(w * late)
            begin[0, j], begin[1, j] = cosine * value + sine / w * rate, cosine * rate - w * sine * value
        if bend[j] >= 0:
            second, third = first[0, bend[j]], first[1, bend[j]]
            begin[0, j] += late * late * (second / 2.0 + late * third / 6.0)
            begin[1, j] += late * (second + late * third / 2.0)


@jit
def to_blocks(slot: Integers, displacement: Array, velocity: Array, both: Array) -> None:
    """Write a modal state in the blocks of a slot of a table, into the first row of an array (3, 2m)."""
    m, real = both.shape[1] // 2, 1 if slot[INTO] else 0
    if slot[MODES]:
        modes = shaped(floats(slot[MODES]), (displacement.size, m))
        multiply_transposed(modes, displacement, both[real, :m])
        multiply_transposed(modes, velocity, both[real, m:])
    else:
        copy(displacement, both[real, :m])
        copy(velocity, both[real, m:])
    if real:
        multiply(shaped(floats(slot[INTO]), (2 * m, 2 * m)), both[1], both[0])


@jit
def from_blocks(slot: Integers, both: Array, displacement: Array, velocity: Array) -> None:
    """Write a state in the blocks of a slot, or a difference of states, as a modal one, the shift left out."""
    m, real = both.shape[1] // 2, 0
    if slot[OUT]:
        multiply(shaped(floats(slot[OUT]), (2 * m, 2 * m)), both[0], both[1])
        real = 1
    if slot[MODES]:
        modes = shaped(floats(slot[MODES]), (displacement.size, m))
        multiply(modes, both[real, :m], displacement)
        multiply(modes, both[real, m:], velocity)
    else:
        copy(both[real, :m], displacement)
        copy(both[real, m:], velocity)


@jit
def _add_answers(steady: Array, states: Array, sign: float, both: Array) -> None:
    """Add the steady answers to the loads in the states of all blocks, times a sign, to states of shape (2m,)."""
    loads = steady.shape[0] // 2
    for j in range(loads):
        value, rate = sign * states[0, j], sign * states[1, j]
        for k in range(both.size):
            both[k] += value * steady[j, k] + rate * steady[loads + j, k]


@jit
def run_segments(
    table: Integers, slots: Integers, after: Integers, run: Integers, segments: int, events: int
) -> int:  # fmt: skip
    """Follow a run from segment to segment; return why it stops, see `DONE` and what follows it.

    `table`, `slots`, `after`: see `Statuses`.
    `run` (shape (NUMBERS,)): the numbers of the run and the places of its arrays. Its state and the record are changed
    in place.
    `segments`: number of segments after which the loop returns `PAUSED`. It also returns after `_CALL_WORK`.
    `events`: largest number of events in the whole run.
    """
    n, contacts, first, intervals = run[MODES_OF_RUN], run[CONTACTS], run[LOADS], run[INTERVALS]
    edges, kinds = shaped(floats(run[EDGES]), (intervals + 1,)), shaped(integers(run[KINDS]), (intervals,))
    states = shaped(floats(run[STATES]), (intervals, 2, first))
    omega, bend = shaped(floats(run[OMEGA]), (slots.shape[1], first)), shaped(integers(run[BEND]), (first,))
    drifting = run[DRIFTING]
    drift = shaped(floats(run[DRIFT]), (slots.shape[1], contacts, drifting))
    rows = shaped(floats(run[CONTACT_ROWS]), (contacts, n))
    row_sizes = shaped(floats(run[CONTACT_SIZES]), (contacts, n))
    laws, gaps = shaped(floats(run[LAWS]), (contacts, COLUMNS)), shaped(floats(run[GAPS]), (contacts,))
    frequencies, largest = shaped(floats(run[FREQUENCIES]), (n,)), shaped(floats(run[LARGEST]), (contacts,))
    seen, rigid = shaped(floats(run[SEEN]), (2, n)), contacts > 0 and laws[:, RESTITUTION].max() >= 0.0
    stops, fresh = run[STOPS], shaped(floats(run[FRESH]), (2, contacts))
    sliding = stops < contacts
    pushes = shaped(floats(run[PUSHES]), (intervals if sliding else 0, n))
    time, state = shaped(floats(run[TIME]), (1,)), shaped(floats(run[STATE]), (2, n))
    modal, room, event_room = shaped(floats(run[WORK_MODAL]), (4, n)), run[SEGMENT_ROOM], run[EVENT_ROOM]
    starts, durations = shaped(floats(run[STARTS]), (room,)), shaped(floats(run[DURATIONS]), (room,))
    statuses, all_gaps = shaped(integers(run[STATUSES]), (room,)), shaped(floats(run[SEGMENT_GAPS]), (room, contacts))
    displacements = shaped(floats(run[DISPLACEMENTS]), (room, n))
    velocities, logged = shaped(floats(run[VELOCITIES]), (room, n)), shaped(integers(run[LOGGED]), (room,))
    event_time = shaped(floats(run[EVENT_TIME]), (event_room,))
    event_contact = shaped(integers(run[EVENT_CONTACT]), (event_room,))
    event_status = shaped(integers(run[EVENT_STATUS]), (event_room,))
    displacement, velocity, moved, moved_rate = modal[0], modal[1], modal[2], modal[3]
    evaluated = run[EVALUATIONS]
    for _ in range(segments):
        t = time[0]
        if t >= edges[intervals]:
            return DONE
        while edges[run[INTERVAL] + 1] <= t:
            run[INTERVAL] += 1
        row, interval, number = run[SEGMENTS], run[INTERVAL], run[STATUS]
        kind = kinds[interval]
        if not 0 <= number < slots.shape[0] or slots[number, kind] < 0:
            return NEW_STATUS
        if row + 1 >= room or run[EVENTS] + 1 >= event_room:
            return FULL
        slot = table[slots[number, kind]]
        count, m, own = slot[FUNCTIONS], slot[BLOCKS], slot[OWN]
        if run[EVALUATIONS] - evaluated > _CALL_WORK // (m + EVALUATION_WORK):
            return PAUSED
        x, f = shaped(floats(run[WORK_X]), (SEARCH_ROWS, m)), shaped(floats(run[WORK_F]), (FUNCTION_ROWS, count))
        both, steady = shaped(floats(run[WORK_BOTH]), (3, 2 * own)), shaped(floats(slot[STEADY]), (2 * first, 2 * own))
        event_rows = shaped(floats(slot[FUNCTION_OF]), (count, 2, m))
        owner, sign = shaped(integers(slot[OWNER]), (count,)), shaped(floats(slot[SIGN]), (count,))
        level, leads = shaped(floats(slot[LEVEL]), (count,)), shaped(integers(slot[LEADS]), (count,))
        slides = shaped(floats(slot[SLIDES]), (contacts,))

        # The states of all blocks at the beginning.
        begin, change = x[START:], x[MOVED:]
        copy(shaped(floats(slot[OF]), (START * m,)), shaped(floats(run[WORK_X]), (START * m,)))
        _load_state(t - edges[interval], states[interval], omega[kind], bend, begin)
        contact = run[SWITCHED]
        if 0 <= contact < stops:
            at_gap(rows[contact], laws[contact], inner(drift[kind, contact], begin[0, :drifting]), state[0])
        if rigid or sliding:
            _see(seen, state[0], state[1])
        for j in range(stops, contacts):
            line = int(laws[j, ANCHOR])
            begin[0, line] = 0.0
            begin[0, line] = inner(rows[j], state[0]) - gaps[j] + inner(drift[kind, j], begin[0, :drifting])
        copy(state[0], displacement)
        copy(state[1], velocity)
        _carry(slot[CARRIED], begin[0, :first], -1.0, displacement)
        _carry(slot[CARRIED], begin[1, :first], -1.0, velocity)
        if slot[SHIFT]:
            shift = shaped(floats(slot[SHIFT]), (n,))
            for k in range(n):
                displacement[k] -= shift[k]
        to_blocks(slot, displacement, velocity, both)
        copy(both[0], both[2])
        _add_answers(steady, begin, -1.0, both[2])
        for k in range(own):
            begin[0, first + k], begin[1, first + k] = both[2, k], both[2, own + k]
        if slot[SHIFT]:
            # Pinned contacts are put at their gaps.
            from_blocks(slot, both, displacement, velocity)
            shift = shaped(floats(slot[SHIFT]), (n,))
            for k in range(n):
                displacement[k] += shift[k]
            _carry(slot[CARRIED], begin[0, :first], 1.0, displacement)
            _carry(slot[CARRIED], begin[1, :first], 1.0, velocity)

        # The next event.
        duration, over = edges[interval + 1] - t, -1
        for j in range(count):
            size, o = level[j], owner[j]
            if o >= stops:
                held = laws[o, STRETCH]
                if slides[o] == 0.0 and held > 0.0:
                    value = (gaps[o] if leads[j] == UP else -gaps[o]) - laws[o, BREAKS]
                else:
                    value = inner(event_rows[j, 0], begin[0]) + inner(event_rows[j, 1], begin[1])
                    if slides[o] == 0.0 and value > OVER * laws[o, BREAKS]:
                        over = j if over == -1 and fresh[1, o] != 0.0 else -2
                if fresh[1, o] != 0.0:
                    if slides[o] != 0.0:
                        belt = abs(inner(drift[kind, o], begin[1, :drifting]))
                        if abs(value) <= STILL * (_fastest(rows[o], seen) + belt):
                            # It begins to slide from rest.
                            value = 0.0
                            size += _push(rows[o], seen, frequencies, pushes[interval]) * NEAR * duration
                    elif held > 0.0 and value >= 0.0:
                        # It has just come to rest, and its speed is zero but for rounding.
                        size += _push(rows[o], seen, frequencies, pushes[interval]) * (NEAR * duration) ** 2
                value = min(value, 0.0)
            elif sign[j] == 0.0:
                value = inner(event_rows[j, 0], begin[0]) + inner(event_rows[j, 1], begin[1])
            else:
                value, size = sign[j] * gaps[o] + min(fresh[0, o], 0.0), size + max(fresh[0, o], 0.0)
                if slot[INTO]:
                    # Rounding from earlier segments. The search itself considers only the changes within this segment.
                    for k in range(n):
                        size += row_sizes[o, k] * abs(displacement[k])
            f[BEGINNING, j], f[CONSTANTS, j], f[HIT, j] = value, size, 1.0 if sign[j] == 0.0 else 0.0
        if over != -1 and run[UNSURE]:
            contact = -1 if over == -2 else owner[over]
            if contact != run[SWITCHED]:
                run[LEFT], run[UNSURE] = -1, 0
                run[SLIPS] -= run[SWITCHED] >= stops
                return OVERLOAD
            # It does not rest, but slides back, or on.
            run[LEFT], run[FUNCTION], run[SWITCHED_TO] = number, over, leads[over]
            run[STATUS] = after[number, over] if number < after.shape[0] else -1
            if run[STATUS] < 0:
                return NEW_STATUS
            continue
        run[UNSURE] = 0
        tau = call(run[SEARCH], slot[TAKEN], x, 0, f, 0, t, duration)
        hit = -1
        for j in range(count):
            if f[HIT, j] != 0.0:
                hit = j if hit == -1 else -2

        # The state at its end.
        copy(change[0, first:], both[0, :own])
        copy(change[1, first:], both[0, own:])
        _add_answers(steady, change, 1.0, both[0])
        from_blocks(slot, both, moved, moved_rate)
        _carry(slot[CARRIED], change[0, :first], 1.0, moved)
        _carry(slot[CARRIED], change[1, :first], 1.0, moved_rate)
        starts[row], durations[row], statuses[row], logged[row] = t, tau, number, run[EVENTS]
        copy(gaps, all_gaps[row])
        copy(state[0], displacements[row])
        copy(state[1], velocities[row])
        for k in range(n):
            state[0, k], state[1, k] = displacement[k] + moved[k], velocity[k] + moved_rate[k]
        for j in range(contacts):
            gaps[j] += inner(rows[j], moved) + inner(drift[kind, j], change[0, :drifting])
            fresh[0, j], fresh[1, j] = 0.0, 0.0
            if j >= stops and (slides[j] != 0.0 or laws[j, STRETCH] == 0.0):
                gaps[j] = slides[j] * laws[j, STRETCH]
        time[0] = edges[interval + 1] if tau >= duration else t + tau
        run[SEGMENTS] = row + 1
        run[EVALUATIONS] += int(shaped(floats(slot[WORK]), (1,))[0])
        run[SWITCHED] = -1
        if hit == -1:
            if sliding:
                # Loads and belts may jump.
                return DECISION
            for j in range(count):
                if sign[j] != 0.0 and laws[owner[j], RESTITUTION] >= 0.0 and gaps[owner[j]] == 0.0:
                    # Loads may begin to press on what touches its stop.
                    run[STATUS] = -1
                    return DECISION
            continue
        run[LEFT], run[FUNCTION], run[STATUS] = number, hit, -1
        if hit == -2:
            return DECISION
        contact = owner[hit]
        run[SWITCHED_TO] = leads[hit]
        if contact >= stops:
            for j in range(count):
                touched = laws[owner[j], RESTITUTION] >= 0.0 and gaps[owner[j]] == 0.0
                if tau == 0.0 or touched or (sign[j] == 0.0 and owner[j] < stops):
                    # A stop that is touched or at which something rests may hold the slider too, or what it held.
                    return DECISION
            if leads[hit] == UP or leads[hit] == DOWN:
                gaps[contact] = laws[contact, STRETCH] if leads[hit] == UP else -laws[contact, STRETCH]
            fresh[1, contact] = 1.0
            run[SWITCHED], run[UNSURE] = contact, 1
            run[SLIPS] += 1
            run[STATUS] = after[number, hit] if number < after.shape[0] else -1
            if run[STATUS] < 0:
                return NEW_STATUS
            continue
        restitution = laws[contact, RESTITUTION]
        if restitution >= 0.0:
            for j in range(count):
                if sign[j] == 0.0 and (owner[j] < stops or slides[owner[j]] == laws[owner[j], STRETCH] == 0.0):
                    # What rests somewhere may move in an impact.
                    return DECISION
            gaps[contact] = 0.0
            if drifting:
                _load_state(time[0] - edges[interval], states[interval], omega[kind], bend, begin)
            copy(state[0], displacement)
            at_gap(rows[contact], laws[contact], inner(drift[kind, contact], begin[0, :drifting]), displacement)
            _see(seen, displacement, state[1])
            speed, zero = inner(rows[contact], state[1]), _zero(rows[contact], seen, frequencies)
            if speed <= max(REST * max(largest[contact], speed), zero) or restitution * speed <= zero:
                return DECISION
            turned = (1.0 + restitution) * speed / laws[contact, SQUARE_OF_ROW]
            for k in range(n):
                velocity[k] = state[1, k] - rows[contact, k] * turned
            for j in range(stops, contacts):
                slip = inner(rows[j], velocity) + inner(drift[kind, j], begin[1, :drifting])
                if slides[j] != 0.0 and slides[j] * slip <= STILL * _fastest(rows[j], seen):
                    # The impact stops the slider, or turns it.
                    return DECISION
            largest[contact] = max(largest[contact], speed)
            # The state before the impact is a segment of no duration.
            row, e = run[SEGMENTS], run[EVENTS]
            starts[row], durations[row], statuses[row], logged[row] = time[0], 0.0, number, e
            copy(gaps, all_gaps[row])
            copy(displacement, displacements[row])
            copy(state[1], velocities[row])
            copy(displacement, state[0])
            copy(velocity, state[1])
            for i in range(2):
                event_time[e + i], event_contact[e + i] = time[0], contact
                event_status[e + i] = CLOSED if i == 0 else OPEN
            run[SEGMENTS], run[EVENTS], run[STATUS], run[LEFT] = row + 1, e + 2, number, -1
            run[BOUNCES] += 1
            if e + 2 > events:
                return STORM
            continue
        if sign[hit] != 0.0:
            speed = abs(inner(rows[contact], state[1]))
            if speed * speed < laws[contact, PINNING] + laws[contact, PINNING_RATE] * speed:
                return DECISION
        run[SWITCHED], run[UNSURE] = contact, 1
        gaps[contact] = 0.0
        e = run[EVENTS]
        event_time[e], event_contact[e] = time[0], contact
        event_status[e] = leads[hit]
        run[EVENTS] = e + 1
        if number < after.shape[0]:
            run[STATUS] = after[number, hit]
        if e + 1 > events:
            return STORM
        if run[STATUS] < 0:
            return NEW_STATUS
    return PAUSED
