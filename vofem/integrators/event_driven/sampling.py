"""Samples of a run at many times: block states in compiled code, and products of matrices that lead to modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.block_motion import Blocks, begin, work_space
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.motion import LONG, special_response
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.status_table import Table, to_blocks
from vofem.kernels.jit import jit
from vofem.linalg.oscillators import Oscillators, oscillators, oscillators_at, remainders_at

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Numbers of block states that are computed together.
_TOGETHER = 200_000


def sample_segments(
    table: Table, slots: Integers, rows: Array, loads: LoadTable, parts: Buffers, horizon: float, segments: Integers,
    tau: Array, columns: Integers, z: Array, v: Array, gaps: Array,
) -> None:  # fmt: skip
    """Fill in modal displacements and velocities, and gap functions where wanted, at some times.

    Parameters
    ----------
    slots : ndarray of int, shape (n_statuses,)
        In the table, of the statuses of the record; segments of those without, -1, are left out.
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
    n = rows.shape[1]
    status = parts.status[segments]
    # Times of one status come together, so that its matrices are multiplied by many states at once.
    order = np.argsort(status, kind="stable")
    blocks, together = work_space(n, loads.omega.shape[1]), max(_TOGETHER // n, 1)
    change, rest, early = np.empty((together, 2 * n)), np.empty((together, 2 * n)), np.empty(together)
    for group in np.split(order, np.flatnonzero(np.diff(status[order])) + 1):
        s = int(slots[status[group[0]]])
        if s < 0:
            continue
        mixed, of = bool(table.mixed[s]), oscillators(table.delta[s], table.p[s])
        to_displacement, to_velocity, up = _maps(table, s, group.size)
        for first in range(0, group.size, together):
            mine = group[first : first + together]
            own, used = segments[mine], slice(mine.size)
            block_changes(table, s, loads, parts, horizon, own, tau[mine], of, blocks, change, rest, early)
            displacement, velocity = change[used, :n], change[used, n:]
            if mixed:
                displacement, velocity = rest[used] @ to_displacement, change[used] @ to_velocity
            if up is not None:
                displacement, velocity = displacement @ up, velocity @ up
            if mixed:
                displacement += early[used, None] * parts.velocity[own]
            at = columns[mine]
            z[at] = parts.displacement[own] + displacement
            v[at] = parts.velocity[own] + velocity
            if gaps.shape[1]:
                gaps[at] = parts.gaps[own] + displacement @ rows.T


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
            interval = max(np.searchsorted(loads.edges, parts.starts[k], side="right") - 1, 0)
            interval = min(interval, loads.constant.shape[0] - 1)
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
