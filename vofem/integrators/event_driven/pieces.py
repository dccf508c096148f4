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
from vofem.linalg.vectors import add, add_outer, add_product, copy, inner, multiply
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
def _mapped(kind: int, s: int, single: Array, double: Array, of: Array) -> Array:
    """Return differences of states of status s, shape (2n, k), by maps of displacements or of whole states."""
    if kind == 0:
        return of
    if kind == 2:
        return double[s] @ of
    n, out = of.shape[0] // 2, np.empty_like(of)
    np.dot(single[s], of[:n], out[:n])
    np.dot(single[s], of[n:], out[n:])
    return out


@jit
def _mapped_state(kind: int, s: int, single: Array, double: Array, of: Array) -> Array:
    """Return what `_mapped` does for one state, shape (2n,)."""
    n, out = of.size // 2, of.copy()
    if kind == 1:
        multiply(single[s], of[:n], out[:n])
        multiply(single[s], of[n:], out[n:])
    elif kind == 2:
        multiply(double[s], of, out)
    return out


@jit
def _loads_at(loads: Pieces, time: float, found: Array) -> None:
    """Write values and rates of the loads at a time into the first columns of an array with two rows."""
    for j in range(loads.omega.size):
        w, value, rate = loads.omega[j], loads.first[0, j], loads.first[1, j]
        if w == 0.0:
            found[0, j], found[1, j] = value + time * rate, rate
        else:
            cosine, sine = np.cos(w * time), np.sin(w * time)
            found[0, j], found[1, j] = cosine * value + sine / w * rate, cosine * rate - w * sine * value


@jit
def _add_answers(steady: Array, w: Array, factor: float, into: Array) -> None:
    """Add a multiple of the steady answers to states of e loads, in the first columns of `w`, to a state (2n,)."""
    e = steady.shape[1] // 2
    for i in range(into.size):
        for j in range(e):
            into[i] += factor * (w[0, j] * steady[i, j] + w[1, j] * steady[i, e + j])


@jit
def _block_change(
    loads: Pieces, groups: list[Group | None] | None, s: int, blocks: Array, time: float, tau: float
) -> Array:
    """Return by how much block states, shape (2n,), that hold at a time have changed after tau."""
    n, e = blocks.size // 2, loads.omega.size
    begin, moved, free = np.empty((2, e + n)), np.empty((2, e + n)), blocks.copy()
    _loads_at(loads, time, begin)
    _add_answers(loads.steady[s], begin, -1.0, free)
    copy(free[:n], begin[0, e:])
    copy(free[n:], begin[1, e:])
    r = loads.pairs[s]
    of, pair, gain = loads.of[s], loads.pair[s, :r], loads.gain[s, :r]
    if groups is None:
        change(Blocks(of, pair, gain, None, loads.work, loads.response), begin, tau, moved)
    else:
        change(Blocks(of, pair, gain, groups[s], loads.work, loads.response), begin, tau, moved)
    copy(moved[0, e:], free[:n])
    copy(moved[1, e:], free[n:])
    _add_answers(loads.steady[s], moved, 1.0, free)
    return free


@jit
def _rates(structure: Structure, maps: Maps, loads: Pieces, s: int, time: float, state: Array) -> Array:
    """Return the rates of a modal state under a status, both of shape (2n,)."""
    n, rates, w = state.size // 2, np.empty(state.size), np.empty((2, loads.omega.size))
    z, v, force = state[:n], state[n:], rates[n:]
    copy(v, rates[:n])
    for i in range(n):
        force[i] = -structure.stiffness[i] * z[i] - structure.damping[i] * v[i]
    _loads_at(loads, time, w)
    for j in range(loads.omega.size):
        add(structure.sources[j], w[0, j], force)
    if loads.push.shape[0]:
        add(loads.push[s], 1.0, force)
    if structure.coupling.size:
        for i in range(n):
            force[i] -= inner(structure.coupling[i], v)
    for j in range(structure.gap.size):
        closed, damper = maps.closed[s, j], maps.damper[s, j]
        if closed != 0.0 or damper != 0.0:
            row = structure.rows[j]
            add(row, -closed * (inner(row, z) - structure.gap[j]) - damper * inner(row, v), force)
    for j in range(structure.gap.size):
        row = maps.held[s, j]
        add(row, -inner(row, force), force)
    return rates


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
def turned(delta: Array, p: Array, turn: Array, sine: Array, of: Array) -> Array:
    """Return free block states, shape (2n, k), after the time to which `turns` belong."""
    n, after = p.size, np.empty_like(of)
    for i in range(n):
        c, s = 1.0 + turn[i], sine[i]
        for j in range(of.shape[1]):
            z, v = of[i, j], of[n + i, j]
            after[i, j] = c * z + s * (v + delta[i] * z)
            after[n + i, j] = c * v - s * (p[i] * z + delta[i] * v)
    return after


@plain_form(turned)
def _turned_at_once(delta: Array, p: Array, turn: Array, sine: Array, of: Array) -> Array:
    c, s, d, q = 1.0 + turn[:, None], sine[:, None], delta[:, None], p[:, None]
    z, v = of[: p.size], of[p.size :]
    return np.concatenate([c * z + s * (v + d * z), c * v - s * (q * z + d * v)])


@jit
def _largest(columns: Array) -> Array:
    """Return the largest absolute value of each column."""
    found = np.zeros(columns.shape[1])
    for i in range(columns.shape[0]):
        for j in range(found.size):
            found[j] = max(found[j], abs(columns[i, j]))
    return found


@plain_form(_largest)
def _largest_at_once(columns: Array) -> Array:
    return np.asarray(np.abs(columns).max(axis=0, initial=0.0))


@jit
def _columns_of_group(
    group: Group | None, duration: float, before: Array, after: Array, weights: Array, maps: Maps, s: int, rows: Array
) -> None:
    """Fill in the columns of the blocks of a group, and add their part to the mean rates of the contacts, (c, k).

    `before`, `after` have shape (2n, k), `weights` (c, 2n).
    """
    if group is None:
        return
    g, n = group.member.size, before.shape[0] // 2
    member = group.member - (group.scale.size // 2)
    places = np.concatenate((member, n + member))
    both = before[places]
    generator = group.matrix[: 2 * g, : 2 * g].copy()
    moved = matrix_change(generator, duration) @ both
    mean = moved / duration if duration != 0.0 else generator @ both
    after[places] = both + moved
    weights[:, places] = 0.0
    rows += maps.mean_z[s][:, member] @ mean[:g] + maps.mean_v[s][:, member] @ mean[g:]


@jit
def _columns_after(
    maps: Maps, groups: list[Group | None] | None, s: int, duration: float, columns: Array, rows: Array
) -> Array:
    """Return columns (2n, k) at a fixed time after a duration.

    Writes the mean rates of the contacts in them into `rows` (c, k), which are zero before.
    """
    n, c = columns.shape[0] // 2, rows.shape[0]
    stays = maps.carry[s] @ columns[:n] if maps.carry.shape[0] else columns[:0]
    free = columns.copy()
    for i in range(stays.shape[0]):
        add(stays[i], -1.0, free[i])
    free = _mapped(maps.kind[s], s, maps.down, maps.into, free)
    delta, p, weights = maps.delta[s], maps.p[s], np.empty((c, 2 * n))
    turn, sine = turns(delta, p, duration)
    after = turned(delta, p, turn, sine, free)
    for i in range(n):
        # Their means over the duration.
        t, q = (turn[i] / duration, sine[i] / duration) if duration != 0.0 else (-delta[i], 1.0)
        for j in range(c):
            in_z, in_v = maps.mean_z[s, j, i], maps.mean_v[s, j, i]
            weights[j, i] = in_z * (t + q * delta[i]) - in_v * (q * p[i])
            weights[j, n + i] = in_z * q + in_v * (t - q * delta[i])
    if groups is not None:
        _columns_of_group(groups[s], duration, free, after, weights, maps, s, rows)
    add_product(weights, free, rows)
    after = _mapped(maps.kind[s], s, maps.up, maps.out, after)
    for i in range(stays.shape[0]):
        add(stays[i], 1.0, after[i])
    return after


@jit
def _enlarge(sizes: Array, first: int, state: Array) -> None:
    """Let two sizes be no less than the norms of displacement and velocity of a state (2n,)."""
    n = state.size // 2
    sizes[first] = max(sizes[first], np.sqrt(inner(state[:n], state[:n])))
    sizes[first + 1] = max(sizes[first + 1], np.sqrt(inner(state[n:], state[n:])))


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
    first_size, mean, later, sizes = _largest(columns), np.empty(n), np.empty(n), np.zeros(4)
    fastest = 1.0 / horizon
    for j in range(loads.omega.size):
        fastest = max(fastest, loads.omega[j])
    state = state.copy()
    for i in range(m):
        s, h = status[i], durations[i]
        if i > 0 and given.shape[0]:
            add(given[i], -1.0, state)
            _enlarge(sizes, 2, state)
            for a in range(2 * n if k else 0):
                columns[a, k - 1] += state[a]
            copy(given[i], state)
        copy(state, begins[i])
        # Block states belong to what is left of displacements without the part that stays.
        shifted = maps.shift[s].copy()
        if maps.carry.shape[0]:
            for a in range(n):
                shifted[a] += inner(maps.carry[s, a], state[:n])
        add(shifted, -1.0, state[:n])
        blocks = _mapped_state(maps.kind[s], s, maps.down, maps.into, state)
        pinned = False
        for j in range(c):
            pinned = pinned or inner(maps.held[s, j], maps.held[s, j]) > 0.0
        if pinned:
            copy(_mapped_state(maps.kind[s], s, maps.up, maps.out, blocks), state)
            add(shifted, 1.0, state[:n])
        else:
            copy(begins[i], state)
        copy(state, starts[i])
        first = _rates(structure, maps, loads, s, time, state)
        moved = _mapped_state(maps.kind[s], s, maps.up, maps.out, _block_change(loads, groups, s, blocks, time, h))
        for a in range(n):
            mean[a] = moved[a] / h if h != 0.0 else state[n + a]
        multiply(structure.rows, mean, means[i])
        if m < _FEW or loads.push.shape[0]:
            for share in _INSIDE:
                inside = _block_change(loads, groups, s, blocks, time, share * h)
                inside = _mapped_state(maps.kind[s], s, maps.up, maps.out, inside)
                add(state, 1.0, inside)
                _enlarge(sizes, 0, inside)
        add(moved, 1.0, state)
        copy(state, ends[i])
        _enlarge(sizes, 0, state)
        if k:
            shift = shifts[i]
            if i:
                copy(shifts[i - 1], shift)
            last = _rates(structure, maps, loads, s, time + h, state)
            add_outer(first, shift, -1.0, columns)
            columns = _columns_after(maps, groups, s, h, columns, mean_rows[i])
            for a in range(n):
                if abs(h) * fastest > _SHORT:
                    later[a] = (state[n + a] - mean[a]) / h
                else:
                    later[a] = first[n + a] / 6.0 + last[n + a] / 3.0
                mean[a] = moved[n + a] / h if h != 0.0 else first[n + a]
            for j in range(c):
                add(shift, inner(structure.rows[j], mean), mean_rows[i, j])
                add(lengthen[i], inner(structure.rows[j], later), mean_rows[i, j])
            add(lengthen[i], 1.0, shift)
            size = _largest(columns)
            for j in range(k):
                for a in range(2 * n if size[j] < _NOTHING * first_size[j] else 0):
                    columns[a, j] = 0.0
            add_outer(last, shift, 1.0, columns)
            add_product(structure.rows, columns[:n], end_rows[i])
            if all_columns.size:
                for a in range(2 * n):
                    copy(columns[a], all_columns[i, a])
        time += h
        if struck[i] >= 0:
            row, kick = structure.rows[struck[i]], structure.kick[struck[i]]
            add(row, -kick * inner(row, state[n:]), state[n:])
            if k:
                # All speeds before any of them changes.
                speeds = np.zeros(k)
                for a in range(n):
                    add(columns[n + a], row[a], speeds)
                add_outer(row, speeds, -kick, columns[n:])
    return begins, starts, ends, means, shifts, end_rows, mean_rows, columns, sizes
