"""Samples of a run at many times in compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.block_motion import begin, move, work_space
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.record import Buffers
from vofem.integrators.event_driven.status_table import Table, to_blocks
from vofem.linalg.jit import jit
from vofem.linalg.vectors import inner

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@jit
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
    blocks = work_space(n, loads.omega.shape[1])
    change, both = np.empty((2, n)), np.empty((3, 2 * n))
    before, special, omega = -1, 0, loads.omega[0]
    for i in range(segments.size):
        k = segments[i]
        s = slots[parts.status[k]]
        if s < 0:
            continue
        if k != before:
            before = k
            interval = max(np.searchsorted(loads.edges, parts.starts[k], side="right") - 1, 0)
            interval = min(interval, loads.constant.shape[0] - 1)
            to_blocks(table, s, parts.displacement[k], parts.velocity[k], blocks.z_start, blocks.v_start, both)
            special = begin(table, s, loads, interval, parts.starts[k], horizon, blocks)
            omega = loads.omega[interval, : loads.counts[interval]]
        move(table, s, omega, blocks, special, tau[i], parts.velocity[k], change, both)
        for m in range(n):
            z[columns[i], m] = parts.displacement[k, m] + change[0, m]
            v[columns[i], m] = parts.velocity[k, m] + change[1, m]
        for j in range(gaps.shape[1]):
            gaps[columns[i], j] = parts.gaps[k, j] + inner(rows[j], change[0])
