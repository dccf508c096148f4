"""Samples of a run at many times: block states in compiled code, and products of matrices that lead to modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.block_motion import Blocks, begin, work_space
from vofem.integrators.event_driven.fading import DENSE, Fading, second_order_rows
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.motion import LONG, special_response
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.status_table import Table, to_blocks
from vofem.kernels.jit import jit
from vofem.linalg.oscillators import Oscillators, oscillators, oscillators_at, remainders_at
from vofem.linalg.vectors import fill

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Numbers of block states that are computed together.
_TOGETHER = 200_000

#: Times that are treated together where only some coordinates move.
_CHUNK = 1024


def sample_segments(
    table: Table, slots: Integers, fading_of: Callable[[int], Fading], rows: Array, loads: LoadTable, parts: Buffers,
    horizon: float, segments: Integers, tau: Array, columns: Integers, z: Array, v: Array, gaps: Array,
) -> None:  # fmt: skip
    """Fill in modal displacements and velocities, and gap functions where wanted, at some times.

    Parameters
    ----------
    slots : ndarray of int, shape (n_statuses,)
        In the table, of the statuses of the record; segments of those without, -1, are left out.
    fading_of : callable
        Returns the free motion of a status of the record.
    rows : ndarray, shape (n_contacts, n)
        Modal rows of the contacts.
    horizon : float
        Longest time in s for which a motion is computed.
    segments : ndarray of int, shape (k,)
        In which segment each time lies, in ascending order.
    tau : ndarray, shape (k,)
        The times from the begin of their segments, s.
    columns : ndarray of int, shape (k,)
        Rows of `z`, `v` and `gaps` to which the values are written.
    z, v : ndarray, shape (n_times, n)
        A time is a row, because columns that lie far apart in memory take longer to write than to compute.
    gaps : ndarray, shape (n_times, n_contacts) or (n_times, 0)
    """
    status = parts.status[segments]
    # Times of one status come together, so that its matrices are multiplied by many states at once.
    order = np.argsort(status, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(status[order])) + 1):
        s = int(slots[status[group[0]]])
        if s < 0:
            continue
        of, out = oscillators(table.delta[s], table.p[s]), Outputs(parts, rows, z, v, gaps)
        if table.mixed[s] and group.size >= DENSE:
            members, local = np.unique(segments[group], return_inverse=True)
            start, driven = begin_segments(table, s, loads, parts, horizon, members)
            # Responses from rest, as at resonance, belong to whole blocks.
            plain = ~np.isnan(start[local, 0])
            mine, group = group[plain], group[~plain]
            fading = fading_of(int(status[mine[0]])) if mine.size else None
            if fading is not None:
                _sample_fading(
                    table, s, fading, loads, start, driven, members, local[plain], tau[mine], columns[mine], out
                )
        if group.size:
            _sample_blocks(table, s, of, loads, horizon, segments[group], tau[group], columns[group], out)


class Outputs(NamedTuple):
    """Where samples are written, see `sample_segments`, and the states at the begins of segments."""

    parts: Buffers
    rows: Array
    z: Array
    v: Array
    gaps: Array


def _sample_blocks(
    table: Table, s: int, of: Oscillators, loads: LoadTable, horizon: float, segments: Integers, tau: Array,
    columns: Integers, out: Outputs,
) -> None:  # fmt: skip
    """Fill in samples of one status, all blocks at all times."""
    parts, n = out.parts, table.p.shape[1]
    blocks, together = work_space(n, loads.omega.shape[1]), max(_TOGETHER // n, 1)
    together = min(together, tau.size)
    change, rest, early = np.empty((together, 2 * n)), np.empty((together, 2 * n)), np.empty(together)
    mixed = bool(table.mixed[s])
    to_displacement, to_velocity, up = _maps(table, s, tau.size)
    for first in range(0, tau.size, together):
        chunk = slice(first, first + together)
        own, at = segments[chunk], columns[chunk]
        used = slice(own.size)
        block_changes(table, s, loads, parts, horizon, own, tau[chunk], of, blocks, change, rest, early)
        displacement, velocity = change[used, :n], change[used, n:]
        if mixed:
            displacement, velocity = rest[used] @ to_displacement, change[used] @ to_velocity
        if up is not None:
            displacement, velocity = displacement @ up, velocity @ up
        if mixed:
            displacement += early[used, None] * parts.velocity[own]
        out.z[at] = parts.displacement[own] + displacement
        out.v[at] = parts.velocity[own] + velocity
        if out.gaps.shape[1]:
            out.gaps[at] = parts.gaps[own] + displacement @ out.rows.T


def _sample_fading(
    table: Table, s: int, fading: Fading, loads: LoadTable, start: Array, driven: Array, members: Integers,
    local: Integers, tau: Array, columns: Integers, out: Outputs,
) -> None:  # fmt: skip
    """Fill in samples of one status with complex modes, of what still moves at each time.

    Parameters
    ----------
    start, driven : ndarray
        What `begin_segments` returns.
    members : ndarray of int, shape (k,)
        Segments of this status.
    local : ndarray of int, shape (n_times,)
        Number of the segment of each time, in `members`.
    """
    parts, n = out.parts, table.p.shape[1]
    up = None if table.plain[s] else table.up[s]
    both = table.out[s].reshape(2 * n, 2, n)
    both = (both if up is None else both @ up).reshape(2 * n, 2 * n)
    driven = (driven.reshape(-1, 2 * n) @ both).reshape(driven.shape)
    maps, states = np.ascontiguousarray(fading.functionals(both.T).T), fading.states(start.T)
    chosen = fading.choose(states, local, tau, parts.durations[members], np.zeros(0, dtype=np.int64))
    interval = np.searchsorted(loads.edges, parts.starts[members], side="right") - 1
    interval = np.clip(interval, 0, loads.constant.shape[0] - 1)
    quickest = max(float(table.frequency[s, n - 1]), float(table.delta[s].max()))
    for number in np.unique(chosen).tolist():
        moving, mine = fading.moving(number), np.flatnonzero(chosen == number)
        begin = np.ascontiguousarray(states[moving.which].T)
        to_modes = [np.ascontiguousarray(part) for part in (maps[moving.which, :n], maps[moving.which, n:])]
        fixed = -states[moving.rest].T @ maps[moving.rest]
        for first in range(0, mine.size, _CHUNK):
            at = mine[first : first + _CHUNK]
            own, t, early = local[at], tau[at], np.zeros(at.size)
            change, rest = np.empty((2, at.size, moving.which.size))
            # Small displacements after a short time are sums of large velocities of blocks.
            second_order_rows(moving.pairs, moving.rate, begin, own, t, change, rest)
            short = t * quickest < LONG
            early[short] = t[short]
            rest[~short] = change[~short]
            values = np.empty((at.size, 2 * n))
            np.matmul(rest, to_modes[0], out=values[:, :n])
            np.matmul(change, to_modes[1], out=values[:, n:])
            segment = members[own]
            finish(
                driven, fixed, loads.omega, loads.counts, interval, own, t, early, parts.displacement, parts.velocity,
                segment, columns[at], values, out.z, out.v,
            )  # fmt: skip
            if out.gaps.shape[1]:
                out.gaps[columns[at]] = parts.gaps[segment] + values[:, :n] @ out.rows.T


def _maps(table: Table, s: int, count: int) -> tuple[Array, Array, Array | None]:
    """Return the matrices that lead from blocks to displacements and velocities, and from these to modes, or None."""
    n = table.p.shape[1]
    up = None if table.plain[s] else table.up[s]
    if not table.mixed[s]:
        return np.zeros((0, 0)), np.zeros((0, 0)), up
    displacement, velocity = table.out[s][:, :n], table.out[s][:, n:]
    if up is None or count < n:
        return displacement, velocity, up
    return displacement @ up, velocity @ up, None


def begin_segments(
    table: Table, s: int, loads: LoadTable, parts: Buffers, horizon: float, members: Integers
) -> tuple[Array, Array]:
    """Return the free motion at the begins of segments of one status, and the motion that loads drive.

    Parameters
    ----------
    members : ndarray of int, shape (k,)
        Numbers of the segments.

    Returns
    -------
    start : ndarray, shape (k, 2n)
        Free block states; NaN in segments whose motion has other parts too.
    driven : ndarray, shape (k, 1 + 2 n_h, 2n)
        Rates of ramps, and real and imaginary parts of each harmonic.
    """
    n, waves = table.p.shape[1], loads.omega.shape[1]
    start, driven = np.empty((members.size, 2 * n)), np.zeros((members.size, 1 + 2 * waves, 2 * n))
    _begin_all(
        table, s, loads, parts, horizon, members, work_space(n, waves), np.empty((3, 2 * n)), start, driven
    )  # fmt: skip
    return start, driven


@jit
def _begin_all(
    table: Table, s: int, loads: LoadTable, parts: Buffers, horizon: float, members: Integers, blocks: Blocks,
    both: Array, start: Array, driven: Array,
) -> None:  # fmt: skip
    """Fill in what `begin_segments` returns."""
    n = table.p.shape[1]
    for i in range(members.size):
        k = members[i]
        interval = _interval(loads, parts.starts[k])
        to_blocks(table, s, parts.displacement[k], parts.velocity[k], blocks.z_start, blocks.v_start, both)
        if begin(table, s, loads, interval, parts.starts[k], horizon, blocks) > 0:
            fill(start[i], np.nan)
            continue
        for j in range(n):
            start[i, j], start[i, n + j] = blocks.z[j], blocks.v[j]
            driven[i, 0, j], driven[i, 0, n + j] = blocks.rate_z[j], blocks.rate_v[j]
            for h in range(loads.counts[interval]):
                driven[i, 1 + 2 * h, j] = blocks.steady_z[j, h].real
                driven[i, 2 + 2 * h, j] = blocks.steady_z[j, h].imag
                driven[i, 1 + 2 * h, n + j] = blocks.steady_v[j, h].real
                driven[i, 2 + 2 * h, n + j] = blocks.steady_v[j, h].imag


@jit
def _interval(loads: LoadTable, t: float) -> int:
    """Return the interval of the loads in which a time lies, the later one of two that meet there."""
    first, last = 0, loads.constant.shape[0]
    while last - first > 1:
        middle = (first + last) // 2
        if loads.edges[middle] <= t:
            first = middle
        else:
            last = middle
    return first


@jit
def finish(
    driven: Array, fixed: Array, omega: Array, counts: Integers, interval: Integers, own: Integers, tau: Array,
    early: Array, displacement: Array, velocity: Array, segment: Integers, columns: Integers, values: Array, z: Array,
    v: Array,
) -> None:  # fmt: skip
    """Complete changes of displacements and velocities, and write these to rows of `z` and `v`.

    What loads drive and what coordinates at rest have changed is added to the changes.

    Parameters
    ----------
    driven : ndarray, shape (k, 1 + 2 n_h, 2n)
    fixed : ndarray, shape (k, 2n)
    omega, counts : ndarray
        Of the table of loads.
    interval : ndarray of int, shape (k,)
        Interval of the loads in each segment.
    own, tau : ndarray, shape (n_times,)
        Number of the segment of each time, and times from the begins of segments, s.
    early : ndarray, shape (n_times,)
        Times for which the initial velocity gives the part of displacements that is in proportion to time, or 0.
    displacement, velocity : ndarray, shape (n_segments, n)
        States at the begins of the segments of the record.
    segment, columns : ndarray of int, shape (n_times,)
        Number of the segment in the record, and rows of `z` and `v`.
    values : ndarray, shape (n_times, 2n)
        Changes of displacements and velocities; completed.
    """
    n = fixed.shape[1] // 2
    for i in range(tau.size):
        k, t, row = own[i], tau[i], values[i]
        add(fixed[k], 1.0, row)
        add(driven[k, 0, :n], t - early[i], row[:n])
        add(driven[k, 0, n:], t, row[n:])
        for h in range(counts[interval[k]]):
            w = omega[interval[k], h]
            half = 0.5 * w * t
            turn, wave = -2.0 * np.sin(half) ** 2, 2.0 * np.sin(half) * np.cos(half)
            add(driven[k, 1 + 2 * h], turn, row)
            add(driven[k, 2 + 2 * h, :n], w * early[i] - wave, row[:n])
            add(driven[k, 2 + 2 * h, n:], -wave, row[n:])
        at, before, rate = columns[i], displacement[segment[i]], velocity[segment[i]]
        if early[i] > 0.0:
            # The velocity at the start, of what still moves.
            add(rate, early[i], row[:n])
            add(fixed[k, n:], early[i], row[:n])
        for j in range(n):
            z[at, j], v[at, j] = before[j] + row[j], rate[j] + row[n + j]


@jit
def add(part: Array, factor: float, row: Array) -> None:
    """Add a multiple of a vector to another one."""
    for j in range(row.size):
        row[j] += factor * part[j]


@jit
def block_changes(
    table: Table, s: int, loads: LoadTable, parts: Buffers, horizon: float, segments: Integers, tau: Array,
    of: Oscillators, blocks: Blocks, change: Array, rest: Array, early: Array,
) -> None:  # fmt: skip
    """Fill in by how much the block states of one status have changed since the begins of segments, a row each time.

    Parameters
    ----------
    segments, tau : ndarray, shape (k,)
        Numbers of segments, equal ones one after the other, and times from their begins, s.
    of : Oscillators
        Those of the status.
    change : ndarray, shape (k, 2n)
        Filled.
    rest : ndarray, shape (k, 2n)
        Filled in complex modes, as `Motion.mode_changes` needs it: the changes without the part in proportion to time.
    early : ndarray, shape (k,)
        Filled in complex modes: the times, or 0 where `rest` holds that part.
    """
    n = table.p.shape[1]
    mixed, both = table.mixed[s], np.empty((3, 2 * n))
    c, sine, pull, push = np.empty((4, n))
    waves = np.empty((blocks.steady_z.shape[1], 4, n))
    found = np.empty((2, blocks.block.size))
    quickest = table.frequency[s, n - 1]
    for k in range(n):
        quickest = max(quickest, table.delta[s, k])
    before, special, omega = -1, 0, loads.omega[0]
    for i in range(segments.size):
        k, t = segments[i], tau[i]
        if k != before:
            before = k
            interval = _interval(loads, parts.starts[k])
            to_blocks(table, s, parts.displacement[k], parts.velocity[k], blocks.z_start, blocks.v_start, both)
            special = begin(table, s, loads, interval, parts.starts[k], horizon, blocks)
            omega = loads.omega[interval, : loads.counts[interval]]
            for j in range(n):
                pull[j] = blocks.v[j] + of.delta[j] * blocks.z[j]
                push[j] = of.p[j] * blocks.z[j] + of.delta[j] * blocks.v[j]
                for h in range(omega.size):
                    waves[h, 0, j], waves[h, 1, j] = blocks.steady_z[j, h].real, blocks.steady_z[j, h].imag
                    waves[h, 2, j], waves[h, 3, j] = blocks.steady_v[j, h].real, blocks.steady_v[j, h].imag
        for e in range(special):
            j = blocks.block[e]
            found[0, e], found[1, e] = special_response(
                of.delta[j], of.p[j], blocks.exponent[e], blocks.g1[e], blocks.g2[e], blocks.ramp[e], t
            )
        oscillators_at(of, t, c, sine)
        _add_up(blocks, special, omega, waves, found, c, sine, pull, push, t, 0.0, change[i])
        if mixed:
            early[i] = t if t * quickest < LONG else 0.0
            if early[i] > 0.0:
                remainders_at(of, t, c, sine)
            _add_up(blocks, special, omega, waves, found, c, sine, pull, push, t, early[i], rest[i])


@jit
def _add_up(
    blocks: Blocks, special: int, omega: Array, waves: Array, found: Array, c: Array, sine: Array, pull: Array,
    push: Array, tau: float, early: float, row: Array,
) -> None:  # fmt: skip
    """Write the change of all block states at tau; from forced motion what is in proportion to `early` is taken off."""
    n, along = c.size, tau - early
    z, v = row[:n], row[n:]
    for k in range(n):
        z[k] = c[k] * blocks.z[k] + sine[k] * pull[k] + along * blocks.rate_z[k]
        v[k] = c[k] * blocks.v[k] - sine[k] * push[k] + along * blocks.rate_v[k]
    for h in range(omega.size):
        half = 0.5 * omega[h] * tau
        turn, wave = -2.0 * np.sin(half) ** 2, 2.0 * np.sin(half) * np.cos(half) - omega[h] * early
        for k in range(n):
            z[k] += turn * waves[h, 0, k] - wave * waves[h, 1, k]
            v[k] += turn * waves[h, 2, k] - wave * waves[h, 3, k]
    for e in range(special):
        k = blocks.block[e]
        less = 0.0 if blocks.ramp[e] else early
        z[k] += found[0, e] - less * blocks.g1[e].real
        v[k] += found[1, e] - less * blocks.g2[e].real
