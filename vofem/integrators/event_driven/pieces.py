"""The contact statuses of a motion in flat arrays, and kernels that follow the motion through known segments.

In each status the motion is free motion of blocks, the loads among them; see `regime.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.integrators.event_driven.blocks import Blocks, Response, change, response
from vofem.integrators.event_driven.clusters import Cluster, Group, group_of
from vofem.integrators.event_driven.exosystem import Exosystem
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.regime import Answers, Regime, add_waves, answers_to_lines, coupled, wave_inputs
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.kernels.jit import jit, plain_form
from vofem.linalg.exponential import matrix_change, oscillator_change
from vofem.linalg.oscillators import oscillator_times, oscillators
from vofem.system import CLOSED, PINNED, ContactLaws

#: How block states follow from modal states: they are the same, by real modes, or by a matrix for whole states.
_SAME, _REAL, _COMPLEX = 0, 1, 2

#: Shares of a motion of few segments at which its size is measured, besides their ends, and what is few. Sliders rest
#: at the ends of many segments.
_INSIDE = np.array([0.13, 0.37, 0.61, 0.86])
_FEW = 5

#: Duration, over the time in which the fastest load turns by 1 rad, below which the difference of mean and last
#: velocity is computed from accelerations.
_SHORT = 1e-5

#: A column that has shrunk to this share of its first size is zero.
_NOTHING = 1e-33


class Structure(NamedTuple):
    """What a motion depends on beside its status: c contacts, n modes, e loads."""

    #: `stiffness`, `damping`: shape (n,).
    stiffness: Array
    damping: Array
    coupling: Array  #: Damping that couples modes; empty without any. Shape (n, n).
    rows: Array  #: Shape (c, n).
    gap: Array  #: Coordinates at which the springs of closed contacts are free of force, shape (c,).
    sources: Array  #: Modal forces of the loads, shape (e, n).
    #: An impact on a rigid stop takes this times the speed of approach and the row from the velocity, shape (c,).
    kick: Array


class Maps(NamedTuple):
    """Blocks of s statuses, and how their states follow from modal states of n modes.

    A status with pinned contacts has fewer blocks than there are modes. Its arrays are filled with zeros.
    """

    kind: IntArray  #: Shape (s,).
    #: `delta`, `p`: shape (s, n).
    delta: Array
    p: Array
    #: `down`, `up`: displacements of blocks from those of modes, and back, shape (s, n, n).
    down: Array
    up: Array
    #: `into`, `out`: the same for states; empty where no status needs them. Shape (s, 2n, 2n).
    into: Array
    out: Array
    shift: Array  #: Modal displacements that put pinned contacts at their gaps, shape (s, n).
    held: Array  #: Orthonormal rows that span those of the pinned contacts, shape (s, c, n).
    #: `closed`, `damper`: stiffness and damping of the closed contacts, zero for others, shape (s, c).
    closed: Array
    damper: Array
    #: `mean_z`, `mean_v`: contacts' coordinates from block states, shape (s, c, n).
    mean_z: Array
    mean_v: Array
    #: Parts of modal displacements that stay where they are while sliders stick; empty without sliders. Shape (s, n,
    #: n).
    carry: Array


class Pieces(NamedTuple):
    """Loads, and the blocks of s statuses under them: e loads, M = e + n blocks."""

    first: Array  #: Values and rates of the loads at t = 0, shape (2, e).
    omega: Array  #: Their frequencies in rad/s, 0 for lines, shape (e,).
    of: Array  #: Shape (s, 8, M).
    pairs: IntArray  #: Numbers of coupled blocks, shape (s,).
    #: `pair`, `gain`: see `Blocks`.
    pair: IntArray
    gain: Array
    steady: Array  #: Steady answers of the blocks, shape (s, 2n, 2e).
    push: Array  #: Modal forces of sliders that slide; empty without sliders. Shape (s, n).
    work: Array  #: Work space, shape (7, M).
    response: Response


class Still(NamedTuple):
    """What s statuses have at all frequencies of the loads: e loads, w harmonics among them, n modes.

    Arrays are filled as those of `Maps` are.
    """

    maps: Maps
    of: Array  #: That of `Pieces`, in which loads have no meaning, shape (s, 8, e + n).
    answers: Answers  #: To lines, zero for harmonics; `apart` is not filled in. First axis s, n for m.
    inputs: tuple[Array, Array | None]  #: By values and rates of the harmonics, shape (s, 2n, w).
    plain: Array  #: Zero for the members of clusters, else 1, shape (s, n).
    clusters: list[tuple[Cluster, ...]]
    push: Array  #: See `Pieces`.


def structure(space: ModalSpace, laws: ContactLaws | None, vectors: Array, loads: Exosystem) -> Structure:
    """Return what motions depend on beside their status, from the modal vectors of the loads' functions."""
    coupling = np.empty((0, 0)) if space.coupling is None else np.ascontiguousarray(space.coupling)
    gap = np.zeros(0) if laws is None else laws.offset.astype(float)
    sources, function = np.zeros((loads.size, space.size)), loads.function[0]
    sources[function >= 0] = vectors[function[function >= 0]]
    rows = np.ascontiguousarray(space.contacts)
    kick = np.zeros(0)
    if laws is not None:
        kick = np.where(laws.rigid, 1.0 + laws.restitution, 0.0) / np.sum(rows**2, axis=1)
    return Structure(space.stiffness, space.damping, coupling, rows, gap, sources, kick)


def maps(
    space: ModalSpace, laws: ContactLaws | None, statuses: Sequence[IntArray], spectra: Sequence[Spectrum],
    carries: Sequence[Array | None],
) -> Maps:  # fmt: skip
    """Return the blocks of some statuses, given what stays where it is while sliders stick."""
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
        carry=np.zeros((s, n, n) if any(carry is not None for carry in carries) else (0, 0, 0)),
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
        if (carry := carries[k]) is not None:
            found.carry[k] = carry
    return found


def still(regimes: Sequence[Regime], maps: Maps) -> Still:
    """Return what some statuses have at all frequencies, from any one. Sliders have no belts."""
    s, n, e = len(regimes), maps.p.shape[1], regimes[0].loads
    of, plain = np.ones((s, 8, e + n)), np.ones((s, n))
    for k, regime in enumerate(regimes):
        m = regime.spectrum.p.size
        of[k, :, e : e + m] = regime.base.of
        plain[k, :m] = 1.0 if regime.spectrum.plain is None else regime.spectrum.plain
    lines = [answers_to_lines(one.base, one.kind, one.horizon, one.pushes) for one in regimes]
    values, rates = zip(*(wave_inputs(one.base, one.kind, one.pushes) for one in regimes), strict=True)
    # Which blocks have no answer is told by their drive.
    steady, drive, apart = *(_stacked([one[i] for one in lines], n) for i in (0, 1)), np.zeros((s, n, e), dtype=bool)
    push = [one.pushes.sources[:, 0] for one in regimes if one.pushes is not None]
    return Still(
        maps, of, Answers(steady, drive, apart),
        (_stacked(values, n), None if rates[0] is None else _stacked(rates, n)), plain,
        [() if one.spectrum.blocks is None else one.spectrum.blocks.clusters for one in regimes],
        np.array(push).reshape(len(push), n),
    )  # fmt: skip


def _stacked(parts: Sequence[Any], n: int) -> Array:
    """Return s arrays (2m, k) of m <= n blocks as one, (s, 2n, k), with zeros for missing blocks."""
    found = np.zeros((len(parts), 2, n, parts[0].shape[1]))
    for into, part in zip(found, parts, strict=True):
        into[:, : len(part) // 2] = part.reshape(2, len(part) // 2, part.shape[1])
    return found.reshape(len(parts), 2 * n, parts[0].shape[1])


def pieces(still: Still, loads: Exosystem) -> tuple[Pieces, list[Group | None]]:
    """Return the blocks of s statuses under loads without breakpoints, and the group of each status."""
    kind, e, of, delta, p = loads.kinds[0], loads.size, still.of.copy(), still.maps.delta, still.maps.p
    of[:, :, :e] = kind.of
    steady, drive, _ = add_waves(still.answers, (delta, p, still.plain), still.inputs, kind, loads.horizon)
    each = [coupled(*own, kind.bend) for own in zip(drive, still.plain, strict=True)]
    pairs = np.array([len(numbers) for numbers, _ in each], dtype=np.int64)
    pair, gain = np.zeros((len(p), pairs.max(), 3), dtype=np.int64), np.zeros((len(p), pairs.max(), 4))
    for k, r in enumerate(pairs.tolist()):
        pair[k, :r], gain[k, :r] = each[k]
    groups = [
        group_of(*own, kind.omega, kind.bend, loads.horizon) for own in zip(still.clusters, drive, strict=True)
    ]  # fmt: skip
    work, first, respond = np.empty((7, of.shape[2])), loads.states[0], response(False)
    return Pieces(first, kind.omega, of, pairs, pair, gain, steady, still.push, work, respond), groups


# -- kernels ------------------------------------------------------------------------------------------


@jit
def _mapped(kind: int, s: int, single: Array, double: Array, z: Array, v: Array) -> tuple[Array, Array]:
    """Return differences of states of status s, each (n, k), by maps of displacements or of whole states."""
    if kind == 0:
        return z, v
    if kind == 1:
        return single[s] @ z, single[s] @ v
    n = z.shape[0]
    both = double[s] @ np.concatenate((z, v))
    return both[:n], both[n:]


@jit
def _into_blocks(maps: Maps, s: int, z: Array, v: Array) -> tuple[Array, Array]:
    """Return block states, each (n, k), of differences of modal states, each (n, k)."""
    return _mapped(maps.kind[s], s, maps.down, maps.into, z, v)


@jit
def _out_of_blocks(maps: Maps, s: int, z: Array, v: Array) -> tuple[Array, Array]:
    """Return differences of modal states, each (n, k), of block states, each (n, k)."""
    return _mapped(maps.kind[s], s, maps.up, maps.out, z, v)


@jit
def _loads_at(loads: Pieces, time: float) -> Array:
    """Return values and rates of the loads at a time, shape (2, e)."""
    found = np.empty((2, loads.omega.size))
    for j in range(loads.omega.size):
        w, value, rate = loads.omega[j], loads.first[0, j], loads.first[1, j]
        if w == 0.0:
            found[0, j], found[1, j] = value + time * rate, rate
        else:
            cosine, sine = np.cos(w * time), np.sin(w * time)
            found[0, j], found[1, j] = cosine * value + sine / w * rate, cosine * rate - w * sine * value
    return found


@jit
def _answered(steady: Array, w: Array) -> Array:
    """Return the steady answers (2n,) to states (2, e) of the loads."""
    found = np.zeros(steady.shape[0])
    for j in range(w.shape[1]):
        found += w[0, j] * steady[:, j] + w[1, j] * steady[:, w.shape[1] + j]
    return found


@jit
def _block_changes(
    loads: Pieces, groups: list[Group | None] | None, s: int, z: Array, v: Array, time: float, tau: float
) -> tuple[Array, Array]:
    """Return by how much block states, each (n, 1), that hold at a time have changed after tau."""
    n, e = z.shape[0], loads.omega.size
    begin, moved = np.empty((2, e + n)), np.empty((2, e + n))
    begin[:, :e] = _loads_at(loads, time)
    steady = _answered(loads.steady[s], begin[:, :e])
    begin[0, e:], begin[1, e:] = z[:, 0] - steady[:n], v[:, 0] - steady[n:]
    r = loads.pairs[s]
    of, pair, gain = loads.of[s], loads.pair[s, :r], loads.gain[s, :r]
    if groups is None:
        change(Blocks(of, pair, gain, None, loads.work, loads.response), begin, tau, moved)
    else:
        change(Blocks(of, pair, gain, groups[s], loads.work, loads.response), begin, tau, moved)
    steady = _answered(loads.steady[s], moved[:, :e])
    return (moved[0, e:] + steady[:n]).reshape(n, 1), (moved[1, e:] + steady[n:]).reshape(n, 1)


@jit
def _rates(structure: Structure, maps: Maps, loads: Pieces, s: int, time: float, z: Array, v: Array) -> Array:
    """Return the rates of a modal state under a status, shape (2n,)."""
    w = _loads_at(loads, time)
    force = -structure.stiffness * z - structure.damping * v
    for j in range(w.shape[1]):
        force += w[0, j] * structure.sources[j]
    if loads.push.shape[0]:
        force += loads.push[s]
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
def turns(delta: Array, p: Array, t: float) -> tuple[Array, Array]:
    """Return ``c - 1`` and ``s`` of `oscillator_change` for some blocks, each (n,)."""
    turn, sine = np.empty(p.size), np.empty(p.size)
    for i in range(p.size):
        turn[i], sine[i] = oscillator_change(delta[i], p[i], t)
    return turn, sine


@plain_form(turns)
def _turns_at_once(delta: Array, p: Array, t: float) -> tuple[Array, Array]:
    turn, sine = oscillator_times(oscillators(delta, p), np.array([t]))
    return turn[0], sine[0]


@jit
def turned(delta: Array, p: Array, turn: Array, sine: Array, z: Array, v: Array) -> tuple[Array, Array]:
    """Return free block states, each (n, k), after the time to which `turns` belong."""
    after_z, after_v = np.empty_like(z), np.empty_like(v)
    for i in range(p.size):
        c, s = 1.0 + turn[i], sine[i]
        for j in range(z.shape[1]):
            after_z[i, j] = c * z[i, j] + s * (v[i, j] + delta[i] * z[i, j])
            after_v[i, j] = c * v[i, j] - s * (p[i] * z[i, j] + delta[i] * v[i, j])
    return after_z, after_v


@plain_form(turned)
def _turned_at_once(delta: Array, p: Array, turn: Array, sine: Array, z: Array, v: Array) -> tuple[Array, Array]:
    c, s, d, q = 1.0 + turn[:, None], sine[:, None], delta[:, None], p[:, None]
    return c * z + s * (v + d * z), c * v - s * (q * z + d * v)


@jit
def _columns_of_group(
    group: Group | None, duration: float, before: tuple[Array, Array], after: tuple[Array, Array],
    weights: tuple[Array, Array], maps: Maps, s: int,
) -> Array:  # fmt: skip
    """Fill in the columns of the blocks of a group; return the mean rates of the contacts in all columns, (c, k)."""
    if group is None:
        return weights[0] @ before[0] + weights[1] @ before[1]
    g, e = group.member.size, group.scale.size // 2
    member = group.member - e
    both = np.concatenate((before[0][member], before[1][member]))
    generator = group.matrix[: 2 * g, : 2 * g].copy()
    moved = matrix_change(generator, duration) @ both
    mean = moved / duration if duration != 0.0 else generator @ both
    after[0][member], after[1][member] = both[:g] + moved[:g], both[g:] + moved[g:]
    weights[0][:, member] = weights[1][:, member] = 0.0
    rows = weights[0] @ before[0] + weights[1] @ before[1]
    return np.asarray(rows + maps.mean_z[s][:, member] @ mean[:g] + maps.mean_v[s][:, member] @ mean[g:])


@jit
def _columns_after(
    maps: Maps, groups: list[Group | None] | None, s: int, duration: float, columns: Array
) -> tuple[Array, Array]:
    """Return columns (2n, k) at a fixed time after a duration, and the mean rates of the contacts in them, (c, k)."""
    n = columns.shape[0] // 2
    first = columns[:n].copy()
    if maps.carry.shape[0]:
        first -= maps.carry[s] @ columns[:n].copy()
    z, v = _into_blocks(maps, s, first, columns[n:].copy())
    delta, p = maps.delta[s], maps.p[s]
    turn, sine = turns(delta, p, duration)
    after_z, after_v = turned(delta, p, turn, sine, z, v)
    # Their means over the duration.
    turn, sine = (turn / duration, sine / duration) if duration != 0.0 else (-delta, np.ones(n))
    rows_z, rows_v = maps.mean_z[s], maps.mean_v[s]
    weight_z = rows_z * (turn + sine * delta) - rows_v * (sine * p)
    weight_v = rows_z * sine + rows_v * (turn - sine * delta)
    if groups is None:
        rows = weight_z @ z + weight_v @ v
    else:
        rows = _columns_of_group(groups[s], duration, (z, v), (after_z, after_v), (weight_z, weight_v), maps, s)
    after_z, after_v = _out_of_blocks(maps, s, after_z, after_v)
    if maps.carry.shape[0]:
        after_z = after_z + maps.carry[s] @ columns[:n].copy()
    return np.concatenate((after_z, after_v)), rows


@jit
def pass_segments(
    structure: Structure, maps: Maps, loads: Pieces, groups: list[Group | None] | None, time: float, state: Array,
    status: IntArray, durations: Array, struck: IntArray, given: Array, columns: Array, lengthen: Array,
    all_columns: Array, horizon: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Follow a motion from a modal state (2n,) at a time through m segments, with k columns (2n, k).

    The columns at the ends of segments are written to `all_columns`, shape (m, 2n, k) or empty. At the end of a segment
    the rigid stop `struck` may be hit, -1 for none; the state at the end is that before this impact.
    Segments after the first begin in `given` modal states, shape (m, 2n), or, where it is empty, where the one before
    ends. What a segment misses of the given state of the next one enters the last column there.

    Returns `begins, starts, ends` (shape (m, 2n)): modal states, at the begin before and after pinned contacts are put
    at their gaps.
    Returns `means` (shape (m, c)): mean rates of the contacts' coordinates.
    Returns `shifts` (shape (m, k)): derivatives of the times of the ends.
    Returns `end_rows, mean_rows` (shape (m, c, k)): derivatives of the contacts' coordinates at the ends, and of their
    mean rates.
    Returns `columns` (shape (2n, k)): at the end of the last segment, after an impact there.
    Returns `sizes` (shape (4,)): largest norms of displacement and velocity, and of what is missed of given states.
    """
    m, n, c, k = durations.size, state.size // 2, structure.gap.size, columns.shape[1]
    begins, starts, ends = np.empty((m, 2 * n)), np.empty((m, 2 * n)), np.empty((m, 2 * n))
    means = np.zeros((m, c))
    shifts, end_rows, mean_rows = np.zeros((m, k)), np.zeros((m, c, k)), np.zeros((m, c, k))
    shift, sizes = np.zeros(k), np.zeros(4)
    first_size = np.zeros(k)
    for j in range(k):
        first_size[j] = np.max(np.abs(columns[:, j]))
    fastest = 1.0 / horizon
    for j in range(loads.omega.size):
        fastest = max(fastest, loads.omega[j])
    state = state.copy()
    for i in range(m):
        s, h = status[i], durations[i]
        if i > 0 and given.shape[0]:
            missed = state - given[i]
            sizes[2] = max(sizes[2], np.sqrt(np.sum(missed[:n] ** 2)))
            sizes[3] = max(sizes[3], np.sqrt(np.sum(missed[n:] ** 2)))
            for a in range(2 * n if k else 0):
                columns[a, k - 1] += missed[a]
            state = given[i].copy()
        begins[i] = state
        z, v = state[:n].copy(), state[n:].copy()
        shifted = maps.shift[s]
        if maps.carry.shape[0]:
            shifted = shifted + maps.carry[s] @ z
        block_z, block_v = _into_blocks(maps, s, (z - shifted).reshape(n, 1), v.reshape(n, 1))
        pinned = np.any(maps.held[s] != 0.0)
        if pinned:
            held_z, held_v = _out_of_blocks(maps, s, block_z, block_v)
            z, v = held_z[:, 0] + shifted, held_v[:, 0].copy()
        starts[i, :n], starts[i, n:] = z, v
        first = _rates(structure, maps, loads, s, time, z, v)
        change_z, change_v = _block_changes(loads, groups, s, block_z, block_v, time, h)
        change_z, change_v = _out_of_blocks(maps, s, change_z, change_v)
        dz, dv = change_z[:, 0].copy(), change_v[:, 0].copy()
        mean = dz / h if h != 0.0 else v
        means[i] = structure.rows @ mean
        last_z, last_v = z + dz, v + dv
        ends[i, :n], ends[i, n:] = last_z, last_v
        sizes[0] = max(sizes[0], np.sqrt(np.sum(last_z * last_z)))
        sizes[1] = max(sizes[1], np.sqrt(np.sum(last_v * last_v)))
        if m < _FEW or loads.push.shape[0]:
            for share in _INSIDE:
                more_z, more_v = _block_changes(loads, groups, s, block_z, block_v, time, share * h)
                more_z, more_v = _out_of_blocks(maps, s, more_z, more_v)
                sizes[0] = max(sizes[0], np.sqrt(np.sum((z + more_z[:, 0]) ** 2)))
                sizes[1] = max(sizes[1], np.sqrt(np.sum((v + more_v[:, 0]) ** 2)))
        if k:
            last = _rates(structure, maps, loads, s, time + h, last_z, last_v)
            for a in range(2 * n):
                columns[a] = columns[a] - first[a] * shift
            columns, rows = _columns_after(maps, groups, s, h, columns)
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
        if struck[i] >= 0:
            row, kick = structure.rows[struck[i]], structure.kick[struck[i]]
            state[n:] -= kick * np.sum(row * state[n:]) * row
            if k:
                speeds = kick * (row @ columns[n:].copy())
                for a in range(n):
                    columns[n + a] = columns[n + a] - row[a] * speeds
    return begins, starts, ends, means, shifts, end_rows, mean_rows, columns, sizes
