"""The certified search for the next event.

An event function is ``phi = row . blocks + forced part``; it is negative until
the event. The search goes forward in steps. From the values at one time, bounds
on the second derivative of phi and on the amplitude of fast blocks give a step
within which phi provably stays below a threshold at rounding level. Far from an
event the fast blocks enter by their amplitude only, so the slow motion sets the
step. Close to an event the steps converge quadratically, from the left, to the
first root. Nothing is sampled at a fixed rate.

Some functions stay close to zero for long, for example where two masses begin to
move together. Bounds on the second derivative then allow only tiny steps. There
derivatives up to the eighth are computed and the ninth is bounded.

Functions are evaluated as changes since the beginning of the segment, because a
contact that has just closed or opened has a gap of exactly zero there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.clusters import ClusterFlow, cluster_change
from vofem.integrators.event_driven.motion import Motion, special_response
from vofem.kernels.jit import jit
from vofem.linalg.exponential import half_turns, oscillator_change
from vofem.linalg.vectors import copy, fill

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: A search ends without an event after this much work, so that the run returns to Python. The work of an evaluation is
#: the number of modes plus `EVALUATION_WORK`.
SEARCH_WORK, EVALUATION_WORK = 50_000, 10

#: Event functions are known to this many units of rounding of their largest terms.
_ROUNDING = 64.0 * float(np.finfo(float).eps)

#: A rate in complex modes below this share of its largest terms is rounding. Its terms have lost some digits in the
#: eigenproblem.
_COMPLEX_ROUNDING = 16.0 * _ROUNDING

#: Order of the highest derivative computed where a function stays close to zero, and the step, over the shortest
#: time scale, below which high derivatives are used.
_ORDER = 9
_SHORT = 1e-3

#: Motions below the first value are multiplied by the second one where they are squared, so that they do not underflow.
_TINY, _GROW = 1e-100, 2.0**500

#: Least level of rounding of an event function.
_LEAST = float(np.finfo(float).tiny)

#: Damping ratio above which a block is bounded by its two exponentials.
_OVERDAMPED = 2.0


@dataclass(frozen=True)
class EventFunctions:
    """Event functions: ``phi = start + change of (w z + u v + slope tau + sum Re(harmonic exp(i w tau)))``.

    Attributes
    ----------
    w : ndarray, shape (k, m)
    u : ndarray, shape (k, m) or (k, 0)
    w_size, u_size : ndarray, like w and u
        Bounds on the terms of the sums that w and u are.
    start : ndarray, shape (k,)
        Values at tau = 0.
    constant : ndarray, shape (k,)
        Size of the constants from which `start` was computed.
    slope : ndarray, shape (k,)
    harmonic : ndarray of complex, shape (k, n_h)
        Amplitudes of the harmonic parts, at the frequencies of the motion.
    """

    w: Array
    u: Array
    w_size: Array
    u_size: Array
    start: Array
    constant: Array
    slope: Array
    harmonic: Complex


class EventTerms(NamedTuple):
    """Event functions: changes of ``w z + u v + slope tau + steady`` since start.

    `mixed` says that modes are complex; u and u_size are not used for real modes.
    """

    mixed: bool
    w: Array
    u: Array
    w_size: Array
    u_size: Array
    start: Array
    slope: Array
    steady: Complex
    constant: Array


class BlockFlow(NamedTuple):
    """The motion of the blocks, as compiled code takes it; the names are those of `Motion` and `Special`.

    Without clusters `clusters` is None: what is called for them is then left out of the machine code.
    """

    delta: Array
    p: Array
    frequency: Array
    z0: Array
    v0: Array
    omega: Array
    block: NDArray[np.int64]
    exponent: Complex
    g1: Complex
    g2: Complex
    ramp: NDArray[np.bool_]
    clusters: ClusterFlow | None


class _Point(NamedTuple):
    """Work space: block states, rates, changes without the particular part, sizes of inputs' shares, phi, rate.

    `root` holds the damped frequencies in
    rad/s, 0 for blocks that do not oscillate, `turn` and `sine` the cosines of their phases less 1 and the sines.
    """

    z: Array
    v: Array
    zdot: Array
    vdot: Array
    dz: Array
    dv: Array
    z_size: Array
    v_size: Array
    phi: Array
    rate: Array
    root: Array
    turn: Array
    sine: Array


class SearchSpace(NamedTuple):
    """Work space of a search, in few arrays: kernels that are given arrays compile faster than those which make them.

    Attributes
    ----------
    hits : ndarray of bool, shape (k,)
        The functions that reach zero at the event; filled by `march`.
    blocks : ndarray, shape (30, m)
    functions : ndarray, shape (6, k)
    series : ndarray, shape (2, 10)
    cluster_state, cluster_norm : ndarray
        As large as `ClusterFlow.state` and `ClusterFlow.rate`; empty without clusters.
    """

    hits: NDArray[np.bool_]
    blocks: Array
    functions: Array
    series: Array
    cluster_state: Array
    cluster_norm: Array


def search_space(blocks: int, functions: int, clusters: ClusterFlow | None = None) -> SearchSpace:
    """Return work space for the search of events of so many functions of so many blocks."""
    states, norms = (0, 0) if clusters is None else (clusters.state.size, clusters.rate.size)
    return SearchSpace(
        np.zeros(functions, dtype=np.bool_), np.empty((30, blocks)), np.empty((6, functions)),
        np.empty((2, _ORDER + 1)), np.empty(states), np.empty(norms),
    )  # fmt: skip


def next_event(functions: EventFunctions, motion: Motion, duration: float) -> tuple[float, NDArray[np.bool_], int]:
    """Return the first time at which a function becomes positive.

    Parameters
    ----------
    functions : EventFunctions
        Event functions that are negative at tau = 0, or zero and falling.
    motion : Motion
    duration : float
        Time in s at which the search ends.

    Returns
    -------
    tau : float
        Time of the event in s. If there is no event, it is `duration`, or an earlier time after `SEARCH_WORK`.
    hits : ndarray of bool, shape (m,)
        The functions that reach zero at tau; simultaneous events count as one.
    evaluations : int
        Number of evaluations of the functions.
    """
    spectrum = motion.spectrum
    w, u = functions.w, functions.u
    poly = w @ motion.poly_z
    steady = w @ motion.steady_z + functions.harmonic
    if u.shape[1]:
        poly = poly + u @ motion.poly_v
        steady = steady + u @ motion.steady_v
    constant = np.maximum(np.abs(functions.constant), np.abs(poly[:, 0]))
    terms = EventTerms(
        u.shape[1] > 0, w, u, functions.w_size, functions.u_size, functions.start,
        poly[:, 1] + functions.slope, steady, constant,
    )  # fmt: skip
    flow = BlockFlow(
        spectrum.delta, spectrum.p, spectrum.frequency, motion.z, motion.v, motion.omega,
        motion.special.block, motion.special.exponent, motion.special.g1, motion.special.g2, motion.special.ramp,
        motion.clusters if motion.clusters.rate.size else None,
    )  # fmt: skip
    space = search_space(spectrum.p.size, w.shape[0], flow.clusters)
    tau, evaluations = march(terms, flow, spectrum.levels, duration, space)
    return tau, space.hits, evaluations


@jit
def _evaluate(tau: float, terms: EventTerms, flow: BlockFlow, at: _Point) -> None:
    """Fill `at` with the states, the event functions and their rates at tau."""
    n, m = flow.p.size, terms.w.shape[0]
    z, v, zdot, vdot, dz, dv = at.z, at.v, at.zdot, at.vdot, at.dz, at.dv
    mixed = terms.mixed
    half_turns(at.root, tau, at.turn, at.sine)
    for k in range(n):
        delta, p, z0, v0 = flow.delta[k], flow.p[k], flow.z0[k], flow.v0[k]
        if at.root[k] == 0.0:
            c, s = oscillator_change(delta, p, tau)
        elif delta == 0.0:
            c, s = at.turn[k], at.sine[k] / at.root[k]
        else:
            decay = np.expm1(-delta * tau)
            c, s = decay + at.turn[k] + decay * at.turn[k], (1.0 + decay) * at.sine[k] / at.root[k]
        dz[k] = c * z0 + s * (v0 + delta * z0)
        dv[k] = c * v0 - s * (p * z0 + delta * v0)
        z[k] = z0 + dz[k]
        v[k] = v0 + dv[k]
        zdot[k] = 0.0
        vdot[k] = 0.0
        at.z_size[k] = 0.0
        at.v_size[k] = 0.0
    for e in range(flow.block.size):
        k = flow.block[e]
        more_z, more_v = special_response(
            flow.delta[k], flow.p[k], flow.exponent[e], flow.g1[e], flow.g2[e], flow.ramp[e], tau
        )
        dz[k] += more_z
        dv[k] += more_v
        z[k] += more_z
        v[k] += more_v
        at.z_size[k] += abs(more_z) + abs(more_v) * tau
        at.v_size[k] += abs(more_v)
        wave = complex(tau, 0.0) if flow.ramp[e] else np.exp(flow.exponent[e] * tau)
        zdot[k] += (flow.g1[e] * wave).real
        vdot[k] += (flow.g2[e] * wave).real
    for k in range(n):
        zdot[k] += v[k]
        vdot[k] -= 2.0 * flow.delta[k] * v[k] + flow.p[k] * z[k]
    _evaluate_clusters(flow.clusters, tau, at)
    for j in range(m):
        value = terms.start[j] + terms.slope[j] * tau
        slope = terms.slope[j]
        for h in range(flow.omega.size):
            half = 0.5 * flow.omega[h] * tau
            sine, cosine = np.sin(half), np.cos(half)
            steady = terms.steady[j, h]
            turned = complex(-2.0 * sine * sine, 2.0 * sine * cosine)
            value += (steady * turned).real
            slope -= flow.omega[h] * (steady + steady * turned).imag
        for k in range(n):
            value += terms.w[j, k] * dz[k]
            slope += terms.w[j, k] * zdot[k]
        if mixed:
            for k in range(n):
                value += terms.u[j, k] * dv[k]
                slope += terms.u[j, k] * vdot[k]
        at.phi[j] = value
        at.rate[j] = slope


@jit
def _evaluate_clusters(clusters: ClusterFlow | None, tau: float, at: _Point) -> None:
    """Fill in the states, changes and rates of the blocks that belong to clusters."""
    if clusters is None:
        return
    for c in range(clusters.rate.size):
        change = cluster_change(clusters, c, tau)
        start = clusters.state[clusters.states[c] : clusters.states[c + 1]]
        now = start + change
        size = now.size
        matrix = clusters.matrix[clusters.matrices[c] : clusters.matrices[c + 1]].reshape(size, size)
        rate = matrix @ now
        first, count = clusters.members[c], clusters.members[c + 1] - clusters.members[c]
        norm = 0.0
        for i in range(2 * count):
            norm += start[i] ** 2 + now[i] ** 2
        for i in range(count):
            k = clusters.member[first + i]
            at.z[k], at.v[k] = now[i], now[count + i]
            at.dz[k], at.dv[k] = change[i], change[count + i]
            at.zdot[k], at.vdot[k] = rate[i], rate[count + i]
            at.z_size[k] = at.v_size[k] = np.sqrt(norm)


@jit
def _longest_step(clusters: ClusterFlow | None) -> float:
    """Return a step in which no cluster grows much."""
    longest = np.inf
    if clusters is None:
        return longest
    for c in range(clusters.rate.size):
        if clusters.growth[c] > 0.0:
            longest = min(longest, 1.0 / clusters.growth[c])
    return longest


@jit
def _bound_overdamped(
    flow: BlockFlow, at: _Point, step: float, inputs: Array, speed: Array, amplitude: Array, push: Array, jerk: Array
) -> None:
    """Lower bounds on states and on their second and third derivatives over a step, for overdamped blocks.

    With the decay rates ``r1 < r2`` of a block, ``z = A + B`` and ``v = -r1 A - r2 B``, where

        A' = -r1 A + (g2 + r2 g1) / (r2 - r1),    B' = -r2 B - (g2 + r1 g1) / (r2 - r1).

    B has soon decayed, and A changes slowly. Free energy does not distinguish them: its bounds on the derivatives of A
    are too large by a factor of at least ``r2 / r1``. Close to critical damping nothing would be gained.

    Parameters
    ----------
    inputs : ndarray, shape (4, n)
        Bounds on g1 and g2 and on their rates.
    """
    for k in range(flow.p.size):
        delta = flow.delta[k]
        if delta <= _OVERDAMPED * flow.frequency[k]:
            continue
        apart = 2.0 * np.sqrt(delta * delta - flow.p[k])
        r2 = delta + 0.5 * apart
        r1 = flow.p[k] / r2
        g1, g2 = inputs[0, k], inputs[1, k]
        # A and B are differences, known to the rounding of the state and of the parts that it is summed of.
        z_error = _ROUNDING * (abs(flow.z0[k]) + at.z_size[k] + abs(at.z[k]))
        v_error = _ROUNDING * (abs(flow.v0[k]) + at.v_size[k] + abs(at.v[k]))
        a = abs(at.v[k] + r2 * at.z[k]) + v_error + r2 * z_error + (g2 + r2 * g1) * step
        b = abs(at.v[k] + r1 * at.z[k]) + v_error + r1 * z_error + (g2 + r1 * g1) * min(step, 1.0 / r2)
        a, b = a / apart, b / apart
        amplitude[k] = min(amplitude[k], a + b)
        speed[k] = min(speed[k], r1 * a + r2 * b)
        push[k] = min(push[k], r1**2 * a + r2**2 * b + g2)
        jerk[k] = min(jerk[k], r1**3 * a + r2**3 * b + 2.0 * delta * g2 + flow.p[k] * g1 + inputs[3, k])


@jit
def _bound_clusters(
    clusters: ClusterFlow | None, at: _Point, step: float, speed: Array, amplitude: Array, push: Array, jerk: Array
) -> None:
    """Write bounds on states and on their second and third derivatives over a step, for the blocks in clusters."""
    if clusters is None:
        return
    for c in range(clusters.rate.size):
        first, count = clusters.members[c], clusters.members[c + 1] - clusters.members[c]
        norm = 0.0
        for i in range(count):
            k = clusters.member[first + i]
            norm += at.z[k] ** 2 + at.v[k] ** 2
        norm = (np.sqrt(norm) + clusters.push[c] * step) * np.exp(clusters.growth[c] * step)
        change = clusters.rate[c] * (clusters.rate[c] * norm + clusters.push[c]) + clusters.jerk[c]
        for i in range(count):
            k = clusters.member[first + i]
            speed[k], amplitude[k], push[k], jerk[k] = norm, norm, change, change


@jit
def _cluster_states(clusters: ClusterFlow | None, tau: float, amplitude: Array, now: Array, norm: Array) -> None:
    """Fill in the states of all clusters at a time, one after the other, and bounds on their norms."""
    if clusters is None:
        return
    copy(clusters.state, now)
    for c in range(clusters.rate.size):
        changed = cluster_change(clusters, c, tau)
        for k in range(changed.size):
            now[clusters.states[c] + k] += changed[k]
        norm[c] = amplitude[clusters.member[clusters.members[c]]]


@jit
def _differentiate_clusters(
    clusters: ClusterFlow | None, order: int, now: Array, norm: Array, at: tuple[Array, Array, Array, Array]
) -> None:
    """Replace derivatives of states of clusters, and bounds on their norms, by those of the next order.

    `at` holds those of all blocks: (z, v), and bounds on both.
    """
    if clusters is None:
        return
    z, v, z_size, v_size = at
    for c in range(clusters.rate.size):
        part = now[clusters.states[c] : clusters.states[c + 1]]
        matrix = clusters.matrix[clusters.matrices[c] : clusters.matrices[c + 1]].reshape(part.size, part.size)
        copy(matrix @ part, part)
        first, count = clusters.members[c], clusters.members[c + 1] - clusters.members[c]
        # The norm of a derivative bounds all of its entries.
        push = clusters.push[c] if order == 1 else clusters.jerk[c] * clusters.quickness[c] ** (order - 2)
        norm[c] = clusters.rate[c] * norm[c] + push
        for entry in range(count):
            k = clusters.member[first + entry]
            z[k], v[k] = part[entry], part[count + entry]
            z_size[k], v_size[k] = norm[c], norm[c]


@jit
def _noise(
    terms: EventTerms, flow: BlockFlow, tau: float, at: _Point, free: Array, cap: Array, noise: Array
) -> None:  # fmt: skip
    """Compute the level below which each function is rounding of its terms up to tau.

    Complex modes are summed of the velocities of blocks too. For a slow block the velocity divided by the frequency is
    large compared with all displacements, so only the change of a block within tau is counted.

    Parameters
    ----------
    free, cap : ndarray, shape (n,)
        Free energy of the blocks as sqrt(2 E), and the amplitude that it allows.
    """
    mixed = terms.mixed
    for j in range(terms.w.shape[0]):
        size = terms.constant[j] + abs(terms.slope[j]) * tau
        for h in range(flow.omega.size):
            size += abs(terms.steady[j, h])
        for k in range(flow.p.size):
            amplitude = min(abs(flow.z0[k]) + abs(flow.v0[k]) * tau, cap[k])
            if mixed:
                energy = free[k]
                # Free energy does not grow, so it bounds the rates.
                amplitude = min(amplitude, energy * tau)
                speed = min(energy, (2.0 * flow.delta[k] + flow.frequency[k]) * energy * tau)
                size += terms.u_size[j, k] * (speed + at.v_size[k])
            size += terms.w_size[j, k] * (amplitude + at.z_size[k])
        noise[j] = _ROUNDING * size + _LEAST


@jit
def _rate_is_rounding(j: int, terms: EventTerms, flow: BlockFlow, at: _Point) -> bool:
    """Return whether the rate of a function is the rounding of its terms."""
    size = abs(terms.slope[j])
    for h in range(flow.omega.size):
        size += flow.omega[h] * abs(terms.steady[j, h])
    for k in range(flow.p.size):
        size += terms.w_size[j, k] * abs(at.zdot[k])
        if terms.mixed:
            size += terms.u_size[j, k] * abs(at.vdot[k])
    return abs(at.rate[j]) <= _ROUNDING * size


@jit
def _complex_rate_is_rounding(j: int, terms: EventTerms, flow: BlockFlow, at: _Point) -> bool:
    """Return whether the rate of a function of complex modes is below the rounding of its terms."""
    size = abs(terms.slope[j])
    for h in range(flow.omega.size):
        size += flow.omega[h] * abs(terms.steady[j, h])
    for k in range(flow.p.size):
        size += abs(terms.w[j, k] * at.zdot[k]) + abs(terms.u[j, k] * at.vdot[k])
    return abs(at.rate[j]) <= _COMPLEX_ROUNDING * size


@jit
def _safe_time(distance: float, rate: float, curvature: float) -> float:
    """Return how long a function with this rate and curvature bound stays below `distance`."""
    root = np.sqrt(rate * rate + 2.0 * curvature * distance)
    if rate > 0.0:
        return 2.0 * distance / (rate + root)
    if curvature > 0.0:
        return (root - rate) / curvature
    return np.inf


@jit
def _safe_time_far(
    j: int, terms: EventTerms, flow: BlockFlow, at: _Point, space: SearchSpace, tau: float, duration: float,
    distance: float, step: float, amplitude: Array, speed: Array,
) -> float:  # fmt: skip
    """Return a time within which function j provably rises by less than `distance`, from high derivatives.

    Parameters
    ----------
    step : float
        Upper bound of the returned time; `amplitude` and `speed` hold until then.
    amplitude, speed : ndarray, shape (n,)
        Bounds on block states (z, v).
    """
    n = flow.p.size
    value, size = space.series[0], space.series[1]
    fill(value, 0.0)
    fill(size, 0.0)
    for h in range(flow.omega.size):
        wave = terms.steady[j, h] * np.exp(1j * flow.omega[h] * tau)
        for i in range(1, _ORDER + 1):
            wave *= 1j * flow.omega[h]
            value[i] += wave.real
            size[i] += abs(wave)
    value[1] += terms.slope[j]
    size[1] += abs(terms.slope[j])
    work = space.blocks
    z, v, z_size, v_size = work[22], work[23], work[24], work[25]
    in_z, in_v, in_z_size, in_v_size = work[26], work[27], work[28], work[29]
    for k in range(n):
        z[k], v[k], z_size[k], v_size[k] = at.z[k], at.v[k], amplitude[k], speed[k]
    _cluster_states(flow.clusters, tau, amplitude, space.cluster_state, space.cluster_norm)
    for i in range(1, _ORDER + 1):
        for k in range(n):
            in_z[k] = in_v[k] = in_z_size[k] = in_v_size[k] = 0.0
        for e in range(flow.block.size):
            k = flow.block[e]
            if flow.ramp[e]:
                factor = complex(tau if i == 1 else (1.0 if i == 2 else 0.0), 0.0)
                largest = duration if i == 1 else abs(factor)
            else:
                factor, largest, quickness = np.exp(flow.exponent[e] * tau), 1.0, abs(flow.exponent[e])
                for _ in range(i - 1):
                    factor *= flow.exponent[e]
                    largest *= quickness
            in_z[k] += (flow.g1[e] * factor).real
            in_v[k] += (flow.g2[e] * factor).real
            in_z_size[k] += abs(flow.g1[e]) * largest
            in_v_size[k] += abs(flow.g2[e]) * largest
        for k in range(n):
            delta, p = flow.delta[k], flow.p[k]
            z[k], v[k] = v[k] + in_z[k], in_v[k] - 2.0 * delta * v[k] - p * z[k]
            z_size[k], v_size[k] = v_size[k] + in_z_size[k], in_v_size[k] + 2.0 * delta * v_size[k] + p * z_size[k]
        _differentiate_clusters(flow.clusters, i, space.cluster_state, space.cluster_norm, (z, v, z_size, v_size))
        for k in range(n):
            value[i] += terms.w[j, k] * z[k]
            size[i] += terms.w_size[j, k] * z_size[k]
            if terms.mixed:
                value[i] += terms.u[j, k] * v[k]
                size[i] += terms.u_size[j, k] * v_size[k]
    safe_time = step
    for _ in range(200):
        rise, term = 0.0, 1.0
        for i in range(1, _ORDER + 1):
            term *= safe_time / i
            slope = size[i] if i == _ORDER else max(value[i], 0.0) + _ROUNDING * size[i]
            rise += slope * term
        if rise <= distance:
            return safe_time
        safe_time *= 0.5
    return safe_time


@jit
def _all_equal(values: Array, value: float) -> bool:
    """Return whether all entries of a vector have a value."""
    count = 0
    for j in range(values.size):
        count += values[j] == value
    return count == values.size


@jit
def exact_cut(t: float, tau: float) -> float:
    """Return the longest duration up to `tau` after which the time ``t + tau`` is exact.

    A segment without an event may end there, and the time loses no digits.
    """
    end = t + tau
    if end - t > tau:
        end = np.nextafter(end, t)
    return end - t if end > t else tau


@jit
def march(
    terms: EventTerms, flow: BlockFlow, levels: NDArray[np.int64], duration: float, space: SearchSpace
) -> tuple[float, int]:
    """Return time and evaluations of `next_event`, and fill in `space.hits`.

    `levels` are those of the spectrum.
    """
    n, m = flow.p.size, terms.w.shape[0]
    delta, p, frequency = flow.delta, flow.p, flow.frequency
    mixed = terms.mixed
    hits, work, of_functions = space.hits, space.blocks, space.functions
    at = _Point(
        work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], of_functions[0], of_functions[1],
        work[8], work[9], work[10],
    )  # fmt: skip
    for k in range(n):
        square = p[k] - delta[k] * delta[k]
        at.root[k] = np.sqrt(square) if square > 0.0 else 0.0
    # Free energy of the blocks as sqrt(2 E), the amplitude that it allows, and the inverse of the frequency.
    free, cap, slowness = work[11], work[12], work[13]
    largest = 0.0
    for k in range(n):
        largest = max(largest, abs(flow.v0[k]), frequency[k] * abs(flow.z0[k]))
    grow = _GROW if largest < _TINY else 1.0
    shrink = 1.0 / grow
    for k in range(n):
        free[k] = shrink * np.sqrt((grow * flow.v0[k]) ** 2 + p[k] * (grow * flow.z0[k]) ** 2)
        cap[k] = free[k] / frequency[k] if frequency[k] > 0.0 else np.inf
        slowness[k] = 1.0 / frequency[k] if frequency[k] > 0.0 else np.inf
    noise = of_functions[2]
    evaluations, most = 0, SEARCH_WORK // (n + EVALUATION_WORK)

    # Bounds on the inputs of the special blocks and on their rates, and the longest step that they allow.
    g1, g2, g1_rate, g2_rate = work[14], work[15], work[16], work[17]
    for k in range(n):
        g1[k] = g2[k] = g1_rate[k] = g2_rate[k] = 0.0
    longest = duration
    for e in range(flow.block.size):
        k = flow.block[e]
        size, quickness = (duration, 1.0) if flow.ramp[e] else (1.0, abs(flow.exponent[e]))
        g1[k] += abs(flow.g1[e]) * size
        g2[k] += abs(flow.g2[e]) * size
        g1_rate[k] += abs(flow.g1[e]) * quickness
        g2_rate[k] += abs(flow.g2[e]) * quickness
        if frequency[k] > 0.0:
            longest = min(longest, 4.0 / frequency[k])
    longest = min(longest, _longest_step(flow.clusters))
    # The last time at which each function was at or below zero. If a function is above zero within rounding, its root
    # lies before `before`.
    below = of_functions[3]
    # A gap that is zero up to rounding, such as that of masses which fall together, allows only tiny certified steps.
    # Its steps double while value and rate are rounding, up to a fraction of the shortest time scale.
    idle, steady_curvature = of_functions[4], of_functions[5]
    for j in range(m):
        hits[j] = False
        below[j] = idle[j] = steady_curvature[j] = 0.0
        for h in range(flow.omega.size):
            steady_curvature[j] += abs(terms.steady[j, h]) * flow.omega[h] ** 2

    speed, amplitude, push, jerk = work[18], work[19], work[20], work[21]
    tau, before = 0.0, 0.0
    quickest = 0.0
    for k in range(n):
        quickest = max(quickest, frequency[k], 2.0 * delta[k])
    for h in range(flow.omega.size):
        quickest = max(quickest, flow.omega[h])
    patience = 0.1 / quickest if quickest > 0.0 else np.inf
    while True:
        _evaluate(tau, terms, flow, at)
        _noise(terms, flow, tau, at, free, cap, noise)
        evaluations += 1
        if tau > 0.0:
            found = False
            for j in range(m):
                hits[j] = at.phi[j] > noise[j]
                found = found or hits[j]
            if found:
                break
        if tau >= duration:
            return duration, evaluations
        for j in range(m):
            if at.phi[j] <= 0.0:
                below[j] = tau
        if evaluations >= most and (evaluations >= 2 * most or _all_equal(below, tau)):
            return tau, evaluations
        step = min(duration - tau, longest)
        # Free energy never grows; inputs make sqrt(2 E) grow at most in proportion to time.
        for k in range(n):
            speed[k] = shrink * np.sqrt((grow * at.v[k]) ** 2 + p[k] * (grow * at.z[k]) ** 2)
            speed[k] += (g2[k] + frequency[k] * g1[k]) * step
            amplitude[k] = abs(at.z[k]) + (speed[k] + g1[k]) * step
            if frequency[k] > 0.0:
                amplitude[k] = min(amplitude[k], speed[k] * slowness[k])
            push[k] = (2.0 * delta[k] + frequency[k]) * speed[k] + g2[k]
            jerk[k] = 2.0 * delta[k] * push[k] + p[k] * (speed[k] + g1[k]) + g2_rate[k]
        _bound_overdamped(flow, at, step, work[14:18], speed, amplitude, push, jerk)
        _bound_clusters(flow.clusters, at, step, speed, amplitude, push, jerk)
        allowed = step
        for j in range(m):
            # Blocks below a level enter by value, rate and bound of the curvature, those above by amplitude.
            fast, value, rate, curvature = 0.0, at.phi[j], at.rate[j], steady_curvature[j]
            for k in range(n):
                fast += abs(terms.w[j, k]) * amplitude[k]
                value -= terms.w[j, k] * at.z[k]
                rate -= terms.w[j, k] * at.zdot[k]
                if mixed:
                    fast += abs(terms.u[j, k]) * speed[k]
                    value -= terms.u[j, k] * at.v[k]
                    rate -= terms.u[j, k] * at.vdot[k]
            safe = 0.0
            k = 0
            for level in range(levels.size - 1):
                while k < levels[level]:
                    fast -= abs(terms.w[j, k]) * amplitude[k]
                    value += terms.w[j, k] * at.z[k]
                    rate += terms.w[j, k] * at.zdot[k]
                    curvature += abs(terms.w[j, k]) * (push[k] + g1_rate[k])
                    if mixed:
                        fast -= abs(terms.u[j, k]) * speed[k]
                        value += terms.u[j, k] * at.v[k]
                        rate += terms.u[j, k] * at.vdot[k]
                        curvature += abs(terms.u[j, k]) * jerk[k]
                    k += 1
                if -value > fast:
                    ahead = grow * (2.0 * noise[j] - value - fast)
                    safe = max(safe, _safe_time(ahead, grow * rate, grow * curvature))
            while k < n:
                curvature += abs(terms.w[j, k]) * (push[k] + g1_rate[k])
                if mixed:
                    curvature += abs(terms.u[j, k]) * jerk[k]
                k += 1
            distance = max(-at.phi[j], 0.0) + 2.0 * noise[j]
            span = max(safe, _safe_time(grow * distance, grow * at.rate[j], grow * curvature))
            if abs(at.phi[j]) <= noise[j] and _rate_is_rounding(j, terms, flow, at):
                idle[j] = min(2.0 * max(idle[j], span), patience)
                span = max(span, idle[j])
            else:
                idle[j] = 0.0
            if span < _SHORT * patience and span < step:
                far = _safe_time_far(j, terms, flow, at, space, tau, duration, distance, allowed, amplitude, speed)
                span = max(span, far)
            step = min(step, span)
        before = tau
        tau = duration if step >= duration - tau else tau + step
        if tau == before:
            # The step is below the resolution of time itself.
            tau = np.nextafter(before, np.inf)

    # The first root lies in (below, tau]: a bracketed Newton iteration for each candidate; the earliest wins.
    first, winner = tau, 0
    for j in range(m):
        if not hits[j]:
            continue
        low, high, x = below[j], tau, tau
        for _ in range(100):
            _evaluate(x, terms, flow, at)
            evaluations += 1
            if at.phi[j] > 0.0:
                high = x
            else:
                low = x
            new = x - at.phi[j] / at.rate[j] if at.rate[j] != 0.0 else low
            if not low < new < high:
                new = 0.5 * (low + high)
            close = abs(new - x) <= 2.3e-16 * x or high - low <= 2.3e-16 * high
            x = new
            if close:
                break
        if x <= first:
            first, winner = x, j
    _evaluate(first, terms, flow, at)
    _noise(terms, flow, first, at, free, cap, noise)
    evaluations += 1
    for j in range(m):
        # A function that only rounding moves away from zero, as for bodies at rest that touch, is left out of the
        # event of another. In complex modes the bounds on rounding are too wide to distinguish this from slow motion,
        # so the terms themselves are compared.
        at_rest = _complex_rate_is_rounding(j, terms, flow, at) if mixed else _rate_is_rounding(j, terms, flow, at)
        hits[j] = abs(at.phi[j]) <= noise[j] and at.rate[j] > 0.0 and not at_rest
    hits[winner] = True
    return first, evaluations
