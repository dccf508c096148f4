"""The contact statuses of a motion in flat arrays, and kernels that follow the motion through known segments.

In each status the motion is a constant part, harmonic answers to the loads and a free part; see `motion.py`. The first
two do not depend on the state. They are computed once for each status; at another time the harmonic answers turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.motion import Forcing, free_changes, special_response, start_motion
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.kernels.jit import jit, plain_form
from vofem.linalg.exponential import matrix_change, oscillator, oscillator_changes
from vofem.system import CLOSED, PINNED, ContactLaws

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
IntArray = NDArray[np.int64]

#: How block states follow from modal states: they are the same, by real modes, or by a matrix for whole states.
_SAME, _REAL, _COMPLEX = 0, 1, 2

#: Shares of a motion of few segments at which its size is measured, besides their ends, and what is few.
_INSIDE = np.array([0.13, 0.37, 0.61, 0.86])
_FEW = 5

#: Duration, over the time in which the fastest load turns by 1 rad, below which the difference of mean and last
#: velocity is computed from accelerations.
_SHORT = 1e-5

#: A column that has shrunk to this share of its first size is zero.
_NOTHING = 1e-33


class Structure(NamedTuple):
    """What a motion depends on beside its status: c contacts, n modes, h frequencies of loads.

    Attributes
    ----------
    stiffness, damping : ndarray, shape (n,)
    coupling : ndarray, shape (n, n)
        Damping that couples modes; empty without any.
    rows : ndarray, shape (c, n)
    gap : ndarray, shape (c,)
        Coordinates at which the springs of closed contacts are free of force.
    omega : ndarray, shape (h,)
    constant : ndarray, shape (n,)
        Modal load.
    harmonic : ndarray of complex, shape (n, h)
        Modal loads ``Re(harmonic exp(i omega t))``.
    """

    stiffness: Array
    damping: Array
    coupling: Array
    rows: Array
    gap: Array
    omega: Array
    constant: Array
    harmonic: Complex


class Maps(NamedTuple):
    """Blocks of s statuses, and how their states follow from modal states of n modes.

    A status with pinned contacts has fewer blocks than there are modes. Its arrays are filled with zeros.

    Attributes
    ----------
    kind : ndarray of int, shape (s,)
    delta, p : ndarray, shape (s, n)
    down, up : ndarray, shape (s, n, n)
        Displacements of blocks from those of modes, and back.
    into, out : ndarray, shape (s, 2n, 2n)
        The same for states; empty where no status needs them.
    shift : ndarray, shape (s, n)
        Modal displacements that put pinned contacts at their gaps.
    held : ndarray, shape (s, c, n)
        Orthonormal rows that span those of the pinned contacts.
    closed, damper : ndarray, shape (s, c)
        Stiffness and damping of the closed contacts, zero for others.
    mean_z, mean_v : ndarray, shape (s, c, n)
        Contacts' coordinates from block states.
    """

    kind: IntArray
    delta: Array
    p: Array
    down: Array
    up: Array
    into: Array
    out: Array
    shift: Array
    held: Array
    closed: Array
    damper: Array
    mean_z: Array
    mean_v: Array


class Answers(NamedTuple):
    """Answers of blocks to loads, at t = 0.

    Attributes
    ----------
    still_z, still_v : ndarray, shape (s, n)
        Constant parts.
    steady_z, steady_v : ndarray of complex, shape (s, n, h)
        Amplitudes of the harmonic parts.
    specials : ndarray of int, shape (s + 1,)
        Where the responses from rest of a status begin. They stand for resonant and rigid blocks.
    block : ndarray of int, shape (q,)
    exponent, g1, g2 : ndarray of complex, shape (q,)
        Inputs ``Re(g exp(exponent t))`` of these blocks.
    clusters : ndarray of int, shape (s + 1,)
        Where the clusters of a status begin.
    member, members, matrix, matrices, state, states : ndarray
        As in `ClusterFlow`.
    """

    still_z: Array
    still_v: Array
    steady_z: Complex
    steady_v: Complex
    specials: IntArray
    block: IntArray
    exponent: Complex
    g1: Complex
    g2: Complex
    clusters: IntArray
    member: IntArray
    members: IntArray
    matrix: Array
    matrices: IntArray
    state: Array
    states: IntArray


def structure(space: ModalSpace, laws: ContactLaws | None, load: Forcing) -> Structure:
    """Return what motions depend on beside their status, from the modal load at t = 0."""
    coupling = np.empty((0, 0)) if space.coupling is None else np.ascontiguousarray(space.coupling)
    gap = np.zeros(0) if laws is None else laws.offset.astype(float)
    return Structure(
        space.stiffness, space.damping, coupling, np.ascontiguousarray(space.contacts), gap, load.omega, load.constant,
        np.ascontiguousarray(load.harmonic),
    )  # fmt: skip


def maps(
    space: ModalSpace, laws: ContactLaws | None, statuses: Sequence[IntArray], spectra: Sequence[Spectrum]
) -> Maps:
    """Return the blocks of some statuses."""
    n, s, c = space.size, len(statuses), space.contacts.shape[0]
    wide = 2 * n if any(spectrum.blocks is not None for spectrum in spectra) else 0
    found = Maps(
        kind=np.zeros(s, dtype=np.int64),
        delta=np.zeros((s, n)),
        p=np.zeros((s, n)),
        down=np.zeros((s, n, n)),
        up=np.zeros((s, n, n)),
        into=np.zeros((s, wide, wide)),
        out=np.zeros((s, wide, wide)),
        shift=np.zeros((s, n)),
        held=np.zeros((s, c, n)),
        closed=np.zeros((s, c)),
        damper=np.zeros((s, c)),
        mean_z=np.zeros((s, c, n)),
        mean_v=np.zeros((s, c, n)),
    )
    for k, (status, spectrum) in enumerate(zip(statuses, spectra, strict=True)):
        real, m = spectrum.real, spectrum.p.size
        modes = np.eye(n) if real.modes is None else real.modes
        found.delta[k, :m], found.p[k, :m] = spectrum.delta, spectrum.p
        found.down[k, :m], found.up[k, :, :m] = modes.T, modes
        found.kind[k] = _SAME if real.modes is None else _REAL
        if spectrum.blocks is not None:
            found.kind[k] = _COMPLEX
            for first, rows in ((0, slice(0, m)), (n, slice(m, 2 * m))):
                into, out = spectrum.blocks.into[rows], spectrum.blocks.out[:, rows]
                found.into[k, first : first + m, :n] = into[:, :m] @ modes.T
                found.into[k, first : first + m, n:] = into[:, m:] @ modes.T
                found.out[k, :n, first : first + m] = modes @ out[:m]
                found.out[k, n:, first : first + m] = modes @ out[m:]
        z, v = spectrum.functions(space.contacts @ modes)
        found.mean_z[k, :, :m] = z
        found.mean_v[k, :, : v.shape[1]] = v
        if laws is not None:
            found.closed[k] = laws.stiffness * (status == CLOSED)
            found.damper[k] = laws.damping * (status == CLOSED)
        pinned = space.contacts[status == PINNED]
        if pinned.shape[0]:
            found.held[k, : pinned.shape[0]] = np.linalg.qr(pinned.T)[0].T
            assert real.shift is not None
            found.shift[k] = real.shift
    return found


def answers(spectra: Sequence[Spectrum], forcings: Sequence[Forcing], horizon: float) -> Answers:
    """Return the answers of the blocks of some statuses to their forces at t = 0."""
    n, h = forcings[0].constant.size, forcings[0].omega.size
    still, steady = np.zeros((2, len(spectra), n)), np.zeros((2, len(spectra), n, h), dtype=complex)
    motions = []
    for k, (spectrum, forcing) in enumerate(zip(spectra, forcings, strict=True)):
        m, rest = spectrum.p.size, np.zeros(n)
        one = start_motion(spectrum, rest, rest, forcing, horizon)
        still[:, k, :m] = one.poly_z[:, 0], one.poly_v[:, 0]
        steady[:, k, :m] = one.steady_z, one.steady_v
        motions.append(one)
    special = [one.special for one in motions]
    flows = [one.clusters for one in motions]
    member, members = _joined([flow.member for flow in flows], [flow.members for flow in flows])
    matrix, matrices = _joined([flow.matrix for flow in flows], [flow.matrices for flow in flows])
    state, states = _joined([flow.state for flow in flows], [flow.states for flow in flows])
    return Answers(
        still[0],
        still[1],
        steady[0],
        steady[1],
        np.cumsum([0, *(one.block.size for one in special)]).astype(np.int64),
        np.concatenate([one.block for one in special]),
        np.concatenate([one.exponent for one in special]),
        np.concatenate([one.g1 for one in special]),
        np.concatenate([one.g2 for one in special]),
        np.cumsum([0, *(flow.rate.size for flow in flows)]).astype(np.int64),
        member,
        members,
        matrix,
        matrices,
        state,
        states,
    )


def _joined(parts: list[Any], places: list[IntArray]) -> tuple[Any, IntArray]:
    """Return flat arrays one after the other, and the places in them where things begin."""
    base = np.cumsum([0, *(part.size for part in parts)]).tolist()
    ends = [place[1:] + first for place, first in zip(places, base, strict=False)]
    return np.concatenate(parts), np.concatenate([[0], *ends]).astype(np.int64)


# -- kernels ------------------------------------------------------------------------------------------


@jit
def _into_blocks(maps: Maps, s: int, z: Array, v: Array) -> tuple[Array, Array]:
    """Return block states, each (n, k), of differences of modal states, each (n, k)."""
    if maps.kind[s] == 0:
        return z, v
    if maps.kind[s] == 1:
        return maps.down[s] @ z, maps.down[s] @ v
    n = z.shape[0]
    both = maps.into[s] @ np.concatenate((z, v))
    return both[:n], both[n:]


@jit
def _out_of_blocks(maps: Maps, s: int, z: Array, v: Array) -> tuple[Array, Array]:
    """Return differences of modal states, each (n, k), of block states, each (n, k)."""
    if maps.kind[s] == 0:
        return z, v
    if maps.kind[s] == 1:
        return maps.up[s] @ z, maps.up[s] @ v
    n = z.shape[0]
    both = maps.out[s] @ np.concatenate((z, v))
    return both[:n], both[n:]


@jit
def _block_changes(
    maps: Maps, loads: Answers, omega: Array, s: int, z: Array, v: Array, time: float, tau: float
) -> tuple[Array, Array]:
    """Return by how much block states, each (n, 1), that hold at a time have changed after tau."""
    free_z, free_v = z[:, 0] - loads.still_z[s], v[:, 0] - loads.still_v[s]
    steady_z, steady_v = loads.steady_z[s], loads.steady_v[s]
    for h in range(omega.size):
        turned = np.exp(1j * (omega[h] * time))
        free_z = free_z - (steady_z[:, h] * turned).real
        free_v = free_v - (steady_v[:, h] * turned).real
    change_z, change_v = free_changes(maps.delta[s], maps.p[s], free_z, free_v, np.array([tau]))
    for h in range(omega.size):
        half = 0.5 * omega[h] * tau
        turn = np.exp(1j * (omega[h] * time)) * complex(-2.0 * np.sin(half) ** 2, 2.0 * np.sin(half) * np.cos(half))
        change_z[:, 0] += (steady_z[:, h] * turn).real
        change_v[:, 0] += (steady_v[:, h] * turn).real
    for e in range(loads.specials[s], loads.specials[s + 1]):
        k, turned = loads.block[e], np.exp(loads.exponent[e] * time)
        dz, dv = special_response(
            maps.delta[s, k], maps.p[s, k], loads.exponent[e], loads.g1[e] * turned, loads.g2[e] * turned, False, tau
        )
        change_z[k, 0] += dz
        change_v[k, 0] += dv
    for c in range(loads.clusters[s], loads.clusters[s + 1]):
        first, count = loads.members[c], loads.members[c + 1] - loads.members[c]
        begin = loads.state[loads.states[c] : loads.states[c + 1]].copy()
        size = begin.size
        matrix = loads.matrix[loads.matrices[c] : loads.matrices[c + 1]].copy().reshape(size, size)
        for j in range(count):
            k = loads.member[first + j]
            begin[j], begin[count + j] = z[k, 0] - loads.still_z[s, k], v[k, 0] - loads.still_v[s, k]
        for j in range(2 * count, size - 1, 2):
            angle, amplitude = -matrix[j, j + 1] * time, begin[j]
            begin[j], begin[j + 1] = amplitude * np.cos(angle), amplitude * np.sin(angle)
        change = matrix_change(matrix, tau) @ begin
        for j in range(count):
            k = loads.member[first + j]
            change_z[k, 0], change_v[k, 0] = change[j], change[count + j]
    return change_z, change_v


@jit
def _load(structure: Structure, time: float) -> Array:
    """Return the modal load at a time, shape (n,)."""
    force = structure.constant.copy()
    for h in range(structure.omega.size):
        force += (structure.harmonic[:, h] * np.exp(1j * (structure.omega[h] * time))).real
    return force


@jit
def _rates(structure: Structure, maps: Maps, s: int, time: float, z: Array, v: Array) -> Array:
    """Return the rates of a modal state under a status, shape (2n,)."""
    force = _load(structure, time) - structure.stiffness * z - structure.damping * v
    if structure.coupling.size:
        force -= structure.coupling @ v
    for j in range(structure.gap.size):
        if maps.closed[s, j] != 0.0 or maps.damper[s, j] != 0.0:
            row = structure.rows[j]
            push = maps.closed[s, j] * (np.sum(row * z) - structure.gap[j]) + maps.damper[s, j] * np.sum(row * v)
            force -= push * row
    for j in range(structure.gap.size):
        row = maps.held[s, j]
        force -= np.sum(row * force) * row
    return np.concatenate((v, force))


@jit
def _turned(delta: Array, p: Array, t: float, z: Array, v: Array) -> tuple[Array, Array]:
    """Return free block states, each (n, k), after a time."""
    after_z, after_v = np.empty_like(z), np.empty_like(v)
    for i in range(p.size):
        c, s = oscillator(delta[i], p[i], t)
        for j in range(z.shape[1]):
            after_z[i, j] = c * z[i, j] + s * (v[i, j] + delta[i] * z[i, j])
            after_v[i, j] = c * v[i, j] - s * (p[i] * z[i, j] + delta[i] * v[i, j])
    return after_z, after_v


@plain_form(_turned)
def _turned_at_once(delta: Array, p: Array, t: float, z: Array, v: Array) -> tuple[Array, Array]:
    """Do what `_turned` does, for all blocks at once."""
    c, s = np.empty((p.size, 1)), np.empty((p.size, 1))
    for i in range(p.size):
        c[i], s[i] = oscillator(delta[i], p[i], t)
    d, q = delta[:, None], p[:, None]
    return c * z + s * (v + d * z), c * v - s * (q * z + d * v)


@jit
def _mean_weights(delta: Array, p: Array, t: float) -> tuple[Array, Array]:
    """Return means over a time of the rates of ``c`` and ``s`` of `oscillator`, each (n,)."""
    turn, sine = np.empty(p.size), np.empty(p.size)
    one = np.ones(1)
    for i in range(p.size):
        # Both by the changes of a motion, which are accurate for short times too.
        z, v = free_changes(delta[i : i + 1], p[i : i + 1], np.zeros(1), one, np.array([t]))
        turn[i], sine[i] = v[0, 0] + delta[i] * z[0, 0], z[0, 0]
    return turn / t, sine / t


@plain_form(_mean_weights)
def _mean_weights_at_once(delta: Array, p: Array, t: float) -> tuple[Array, Array]:
    """Do what `_mean_weights` does, for all blocks at once."""
    turn, sine = oscillator_changes(delta, p, np.array([t]))
    return turn[:, 0] / t, sine[:, 0] / t


@jit
def _columns_after(maps: Maps, loads: Answers, s: int, duration: float, columns: Array) -> tuple[Array, Array]:
    """Return columns (2n, k) at a fixed time after a duration, and the mean rates of the contacts in them, (c, k)."""
    n = columns.shape[0] // 2
    z, v = _into_blocks(maps, s, columns[:n].copy(), columns[n:].copy())
    delta, p = maps.delta[s], maps.p[s]
    after_z, after_v = _turned(delta, p, duration, z, v)
    if duration != 0.0:
        turn, sine = _mean_weights(delta, p, duration)
    else:
        turn, sine = -delta, np.ones(n)
    rows_z, rows_v = maps.mean_z[s], maps.mean_v[s]
    weight_z = rows_z * (turn + sine * delta) - rows_v * (sine * p)
    weight_v = rows_z * sine + rows_v * (turn - sine * delta)
    if loads.clusters[s + 1] > loads.clusters[s]:
        for e in range(loads.member.size):
            if loads.members[loads.clusters[s]] <= e < loads.members[loads.clusters[s + 1]]:
                weight_z[:, loads.member[e]] = 0.0
                weight_v[:, loads.member[e]] = 0.0
    rows = weight_z @ z + weight_v @ v
    for c in range(loads.clusters[s], loads.clusters[s + 1]):
        first, count = loads.members[c], loads.members[c + 1] - loads.members[c]
        size = loads.states[c + 1] - loads.states[c]
        matrix = loads.matrix[loads.matrices[c] : loads.matrices[c + 1]].copy().reshape(size, size)
        generator = matrix[: 2 * count, : 2 * count].copy()
        both = np.empty((2 * count, columns.shape[1]))
        for j in range(count):
            both[j], both[count + j] = z[loads.member[first + j]], v[loads.member[first + j]]
        change = matrix_change(generator, duration) @ both
        mean = change / duration if duration != 0.0 else generator @ both
        for j in range(count):
            k = loads.member[first + j]
            after_z[k], after_v[k] = both[j] + change[j], both[count + j] + change[count + j]
            for contact in range(rows.shape[0]):
                rows[contact] += rows_z[contact, k] * mean[j] + rows_v[contact, k] * mean[count + j]
    after_z, after_v = _out_of_blocks(maps, s, after_z, after_v)
    return np.concatenate((after_z, after_v)), rows


@jit
def pass_segments(
    structure: Structure, maps: Maps, loads: Answers, time: float, state: Array, status: IntArray, durations: Array,
    columns: Array, lengthen: Array, nodes: Array, all_columns: Array, horizon: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Follow a motion from a modal state (2n,) at a time through m segments, with k columns (2n, k).

    The columns at the ends of segments are written to `all_columns`, shape (m, 2n, k) or empty.

    Returns
    -------
    starts, ends : ndarray, shape (m, 2n)
        Modal states.
    means : ndarray, shape (m, c)
        Mean rates of the contacts' coordinates.
    shifts : ndarray, shape (m, k)
        Derivatives of the times of the ends.
    end_rows, mean_rows : ndarray, shape (m, c, k)
        Derivatives of the contacts' coordinates at the ends, and of their mean rates.
    columns : ndarray, shape (2n, k)
        At the end of the last segment.
    sizes : ndarray, shape (2,)
        Largest norms of displacement and velocity.
    """
    m, n, c, k = durations.size, state.size // 2, structure.gap.size, columns.shape[1]
    starts, ends, means = np.empty((m, 2 * n)), np.empty((m, 2 * n)), np.zeros((m, c))
    shifts, end_rows, mean_rows = np.zeros((m, k)), np.zeros((m, c, k)), np.zeros((m, c, k))
    shift, sizes = np.zeros(k), np.zeros(2)
    first_size = np.zeros(k)
    for j in range(k):
        first_size[j] = np.max(np.abs(columns[:, j]))
    fastest = 1.0 / horizon
    for h in range(structure.omega.size):
        fastest = max(fastest, structure.omega[h])
    state = state.copy()
    for i in range(m):
        s, h = status[i], durations[i]
        z, v = state[:n].copy(), state[n:].copy()
        block_z, block_v = _into_blocks(maps, s, (z - maps.shift[s]).reshape(n, 1), v.reshape(n, 1))
        pinned = np.any(maps.held[s] != 0.0)
        if pinned:
            held_z, held_v = _out_of_blocks(maps, s, block_z, block_v)
            z, v = held_z[:, 0] + maps.shift[s], held_v[:, 0].copy()
        starts[i, :n], starts[i, n:] = z, v
        first = _rates(structure, maps, s, time, z, v)
        change_z, change_v = _block_changes(maps, loads, structure.omega, s, block_z, block_v, time, h)
        change_z, change_v = _out_of_blocks(maps, s, change_z, change_v)
        dz, dv = change_z[:, 0].copy(), change_v[:, 0].copy()
        mean = dz / h if h != 0.0 else v
        means[i] = structure.rows @ mean
        last_z, last_v = z + dz, v + dv
        ends[i, :n], ends[i, n:] = last_z, last_v
        sizes[0] = max(sizes[0], np.sqrt(np.sum(last_z * last_z)))
        sizes[1] = max(sizes[1], np.sqrt(np.sum(last_v * last_v)))
        if m < _FEW:
            for share in _INSIDE:
                more_z, more_v = _block_changes(maps, loads, structure.omega, s, block_z, block_v, time, share * h)
                more_z, more_v = _out_of_blocks(maps, s, more_z, more_v)
                sizes[0] = max(sizes[0], np.sqrt(np.sum((z + more_z[:, 0]) ** 2)))
                sizes[1] = max(sizes[1], np.sqrt(np.sum((v + more_v[:, 0]) ** 2)))
        if k:
            last = _rates(structure, maps, s, time + h, last_z, last_v)
            for a in range(2 * n):
                columns[a] = columns[a] - first[a] * shift
            columns, rows = _columns_after(maps, loads, s, h, columns)
            later = (last_v - mean) / h if abs(h) * fastest > _SHORT else first[n:] / 6.0 + last[n:] / 3.0
            slope = structure.rows @ (dv / h if h != 0.0 else first[n:].copy())
            more = structure.rows @ later
            for j in range(c):
                mean_rows[i, j] = rows[j] + slope[j] * shift + more[j] * lengthen[i]
            shift = shift + lengthen[i]
            for j in range(k):
                if np.max(np.abs(columns[:, j])) < _NOTHING * first_size[j]:
                    columns[:, j] = 0.0
            for a in range(2 * n):
                columns[a] = columns[a] + last[a] * shift
            shifts[i] = shift
            end_rows[i] = structure.rows @ columns[:n].copy()
            if all_columns.size:
                all_columns[i] = columns
        time += h
        state = ends[i].copy()
        if i < nodes.shape[0]:
            if k:
                columns[:, k - 1] += ends[i] - nodes[i]
            state = nodes[i].copy()
    return starts, ends, means, shifts, end_rows, mean_rows, columns, sizes
