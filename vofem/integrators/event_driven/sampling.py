"""Samples of a run at many times: block states in compiled code, and products of matrices that lead to modes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.block_motion import Blocks, begin, work_space
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.motion import special_response
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.status_table import Table, to_blocks
from vofem.kernels.jit import jit
from vofem.linalg.oscillators import Oscillators, oscillators, oscillators_at

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Numbers of block states that are computed together.
_TOGETHER = 200_000


def sample_segments(
    table: Table, slots: Integers, rows: Array, loads: LoadTable, parts: Buffers,
    horizon: float, segments: Integers, tau: Array, columns: Integers, z: Array, v: Array, gaps: Array,
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
    status = parts.status[segments]
    # Times of one status come together, so that its matrices are multiplied by many states at once.
    order = np.argsort(status, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(status[order])) + 1):
        s = int(slots[status[group[0]]])
        if s < 0:
            continue
        of, out = oscillators(table.delta[s], table.p[s]), Outputs(parts, rows, z, v, gaps)
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
    change = np.empty((together, 2 * n))
    up = None if table.plain[s] else table.up[s]
    both = table.out[s] if table.mixed[s] else None
    if both is not None and up is not None and tau.size >= n:
        both, up = (both.reshape(4 * n, n) @ up).reshape(2 * n, 2 * n), None
    for first in range(0, tau.size, together):
        chunk = slice(first, first + together)
        own, at = segments[chunk], columns[chunk]
        used = slice(own.size)
        block_changes(table, s, loads, parts, horizon, own, tau[chunk], of, blocks, change)
        moved = change[used] if both is None else change[used] @ both
        displacement, velocity = moved[:, :n], moved[:, n:]
        if up is not None:
            displacement, velocity = displacement @ up, velocity @ up
        out.z[at] = parts.displacement[own] + displacement
        out.v[at] = parts.velocity[own] + velocity
        if out.gaps.shape[1]:
            out.gaps[at] = parts.gaps[own] + displacement @ out.rows.T


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
def block_changes(
    table: Table, s: int, loads: LoadTable, parts: Buffers, horizon: float, segments: Integers, tau: Array,
    of: Oscillators, blocks: Blocks, change: Array,
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
    """
    n = table.p.shape[1]
    both = np.empty((3, 2 * n))
    c, sine, pull, push = np.empty((4, n))
    waves = np.empty((blocks.steady_z.shape[1], 4, n))
    found = np.empty((2, blocks.block.size))
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
        _add_up(blocks, special, omega, waves, found, c, sine, pull, push, t, change[i])


@jit
def _add_up(
    blocks: Blocks, special: int, omega: Array, waves: Array, found: Array, c: Array, sine: Array, pull: Array,
    push: Array, tau: float, row: Array,
) -> None:  # fmt: skip
    """Write the change of all block states at tau."""
    n = c.size
    z, v = row[:n], row[n:]
    for k in range(n):
        z[k] = c[k] * blocks.z[k] + sine[k] * pull[k] + tau * blocks.rate_z[k]
        v[k] = c[k] * blocks.v[k] - sine[k] * push[k] + tau * blocks.rate_v[k]
    for h in range(omega.size):
        half = 0.5 * omega[h] * tau
        turn, wave = -2.0 * np.sin(half) ** 2, 2.0 * np.sin(half) * np.cos(half)
        for k in range(n):
            z[k] += turn * waves[h, 0, k] - wave * waves[h, 1, k]
            v[k] += turn * waves[h, 2, k] - wave * waves[h, 3, k]
    for e in range(special):
        k = blocks.block[e]
        z[k] += found[0, e]
        v[k] += found[1, e]
