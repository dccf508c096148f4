"""The motion of all blocks of a segment in compiled code. The form in Python is `motion.Motion`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.motion import RESONANT, special_response
from vofem.integrators.event_driven.status_table import Table, add_columns, to_modes
from vofem.kernels.jit import jit
from vofem.linalg.exponential import oscillator_change
from vofem.linalg.vectors import fill

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Blocks(NamedTuple):
    """Work space: the motion of the blocks of a segment; the names are those of `Motion` and `Special`."""

    z_start: Array
    v_start: Array
    z: Array
    v: Array
    poly_z: Array
    poly_v: Array
    rate_z: Array
    rate_v: Array
    steady_z: NDArray[np.complex128]
    steady_v: NDArray[np.complex128]
    block: Integers
    exponent: NDArray[np.complex128]
    g1: NDArray[np.complex128]
    g2: NDArray[np.complex128]
    ramp: NDArray[np.bool_]


def most_special(n: int, harmonics: int) -> int:
    """Return how many responses from rest n blocks may have under loads with so many frequencies."""
    return n * (harmonics + 2)


def work_space(n: int, harmonics: int) -> Blocks:
    """Return work space for n blocks under loads with so many frequencies at most."""
    most = most_special(n, harmonics)
    work = np.empty((8, n))
    waves = np.empty((2, n, harmonics), dtype=np.complex128)
    answers = np.empty((3, most), dtype=np.complex128)
    return Blocks(
        work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], waves[0], waves[1],
        np.empty(most, dtype=np.int64), answers[0], answers[1], answers[2], np.empty(most, dtype=np.bool_),
    )  # fmt: skip


@jit
def begin(table: Table, s: int, loads: LoadTable, interval: int, t: float, horizon: float, blocks: Blocks) -> int:
    """Split the motion of all blocks into parts, as `motion.start_motion` does; return how many are from rest."""
    n, functions = blocks.z.size, loads.constant.shape[1]
    mixed = table.mixed[s]
    late = t - loads.edges[interval]
    special = 0
    # The static response of complex modes and the remaining inputs. For real modes only g2 is not zero.
    for k in range(n):
        blocks.poly_z[k], blocks.poly_v[k] = table.push[s, 0, k], table.push[s, 1, k]
        blocks.rate_z[k] = blocks.rate_v[k] = 0.0
    for k in range(n):
        c1, c2, r1, r2 = table.push[s, 2, k], table.push[s, 3, k], 0.0, 0.0
        for f in range(functions):
            slope = loads.slope[interval, f]
            constant = loads.constant[interval, f] + slope * late
            if mixed:
                blocks.poly_z[k] += constant * table.constant[s, f, 0, k] + slope * table.slope[s, f, 0, k]
                blocks.poly_v[k] += constant * table.constant[s, f, 1, k] + slope * table.slope[s, f, 2, k]
                blocks.rate_z[k] += slope * table.slope[s, f, 1, k]
                blocks.rate_v[k] += slope * table.slope[s, f, 3, k]
                c1 += constant * table.constant[s, f, 2, k] + slope * table.slope[s, f, 4, k]
                c2 += constant * table.constant[s, f, 3, k] + slope * table.slope[s, f, 5, k]
                r1 += slope * table.slope[s, f, 6, k]
                r2 += slope * table.slope[s, f, 7, k]
            else:
                c2 += constant * table.g2[s, f, k]
                r2 += slope * table.g2[s, f, k]
        if c1 == 0.0 and c2 == 0.0 and r1 == 0.0 and r2 == 0.0:
            continue
        delta, p = table.delta[s, k], table.p[s, k]
        if p * horizon**2 >= 1.0:
            rate_v = -r1
            rate_z = (r2 - 2.0 * delta * rate_v) / p
            poly_v = rate_z - c1
            blocks.rate_v[k] += rate_v
            blocks.rate_z[k] += rate_z
            blocks.poly_v[k] += poly_v
            blocks.poly_z[k] += (c2 - 2.0 * delta * poly_v - rate_v) / p
            continue
        if c1 != 0.0 or c2 != 0.0:
            _enter_special(blocks, special, k, 0.0j, complex(c1, 0.0), complex(c2, 0.0), False)
            special += 1
        if r1 != 0.0 or r2 != 0.0:
            _enter_special(blocks, special, k, 0.0j, complex(r1, 0.0), complex(r2, 0.0), True)
            special += 1
    for k in range(n):
        blocks.z[k] = blocks.z_start[k] - blocks.poly_z[k]
        blocks.v[k] = blocks.v_start[k] - blocks.poly_v[k]
    for h in range(loads.counts[interval]):
        w = loads.omega[interval, h]
        turned = complex(np.cos(w * late), np.sin(w * late))
        for k in range(n):
            g1, g2 = 0.0j, 0.0j
            for f in range(functions):
                wave = loads.amplitude[interval, f, h] * turned
                g1 += wave * table.g1[s, f, k]
                g2 += wave * table.g2[s, f, k]
            delta, p = table.delta[s, k], table.p[s, k]
            impedance = complex(p - w * w, 2.0 * delta * w)
            slow = w * horizon < 1.0 and p * horizon**2 < 1.0
            if slow or abs(impedance) < RESONANT * max(p, w * w):
                blocks.steady_z[k, h] = blocks.steady_v[k, h] = 0.0j
                if g1 != 0.0 or g2 != 0.0:
                    _enter_special(blocks, special, k, complex(0.0, w), g1, g2, False)
                    special += 1
                continue
            steady = (complex(2.0 * delta, w) * g1 + g2) / impedance
            blocks.steady_z[k, h] = steady
            blocks.steady_v[k, h] = complex(0.0, w) * steady - g1
            blocks.z[k] -= steady.real
            blocks.v[k] -= blocks.steady_v[k, h].real
    return special


@jit
def _enter_special(blocks: Blocks, e: int, k: int, exponent: complex, g1: complex, g2: complex, ramp: bool) -> None:
    blocks.block[e], blocks.exponent[e], blocks.g1[e], blocks.g2[e], blocks.ramp[e] = k, exponent, g1, g2, ramp


@jit
def _changes(table: Table, s: int, omega: Array, blocks: Blocks, special: int, tau: float, z: Array, v: Array) -> None:
    """Write by how much the block states have changed at tau."""
    for k in range(z.size):
        delta, p, z0, v0 = table.delta[s, k], table.p[s, k], blocks.z[k], blocks.v[k]
        c, sine = oscillator_change(delta, p, tau)
        z[k] = c * z0 + sine * (v0 + delta * z0) + blocks.rate_z[k] * tau
        v[k] = c * v0 - sine * (p * z0 + delta * v0) + blocks.rate_v[k] * tau
    for h in range(omega.size):
        half = 0.5 * omega[h] * tau
        sine, cosine = np.sin(half), np.cos(half)
        turned = complex(-2.0 * sine * sine, 2.0 * sine * cosine)
        for k in range(z.size):
            z[k] += (blocks.steady_z[k, h] * turned).real
            v[k] += (blocks.steady_v[k, h] * turned).real
    for e in range(special):
        k = blocks.block[e]
        more_z, more_v = special_response(
            table.delta[s, k], table.p[s, k], blocks.exponent[e], blocks.g1[e], blocks.g2[e], blocks.ramp[e], tau
        )
        z[k] += more_z
        v[k] += more_v


@jit
def move(
    table: Table, s: int, omega: Array, blocks: Blocks, special: int, tau: float, change: Array, both: Array
) -> None:  # fmt: skip
    """Write by how much modal displacement and velocity have changed at tau, as `Motion.mode_changes` does.

    Parameters
    ----------
    change : ndarray, shape (2, n)
        Filled.
    both : ndarray, shape (3, 2n)
        Work space.
    """
    n = change.shape[1]
    _changes(table, s, omega, blocks, special, tau, both[0, :n], both[0, n:])
    part = 0
    if table.mixed[s]:
        fill(both[1], 0.0)
        add_columns(both[0], table.out[s], 0, 2 * n, both[1])
        part = 1
    to_modes(table, s, both[part, :n], change[0])
    to_modes(table, s, both[part, n:], change[1])
