"""The certified search for the next event.

An event function is a row over the states of all blocks; it is negative until the event. The search goes forward in
steps. From the values at one time, bounds on the second derivative and on the amplitude of fast blocks give a step
within which the function provably stays below a threshold at rounding level. Far from an event the fast blocks enter by
their amplitude only, so the slow motion sets the step. Close to an event the steps converge quadratically, from the
left, to the first root. Nothing is sampled at a fixed rate.

Some functions stay close to zero for long, for example where two masses begin to move together. Bounds on the second
derivative then allow only tiny steps. There derivatives up to the eighth are computed and the ninth is bounded.

Functions are evaluated as changes since the beginning of the segment, because a contact that has just closed or opened
has a gap of exactly zero there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.blocks import Blocks, change, change_at_once
from vofem.integrators.event_driven.clusters import Group, group_rate
from vofem.kernels.jit import jit, plain_form
from vofem.linalg.oscillators import DELTA, FREQUENCY, SQUARE

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

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

#: Certified step, over the time since the start, below which bounds over that time alone are tried.
_LITTLE = 0.05

#: Least level of rounding of an event function.
_LEAST = float(np.finfo(float).tiny)

#: Roots of sums of squares below this size are computed without squares, which would underflow.
_TINY = 1e-150

#: Damping ratio above which a block is bounded by its two exponentials.
_OVERDAMPED = 2.0


class EventFunctions(NamedTuple):
    """Event functions: ``start`` and the changes of rows over all blocks.

    Attributes
    ----------
    rows, sizes : ndarray, shape (k, 2, m)
        Rows, and bounds on the terms of the sums that they are.
    start : ndarray, shape (k,)
        Values at tau = 0.
    level : ndarray, shape (k,)
        Size of the constants from which `start` was computed.
    loads : int
        Number of blocks that are loads, the first ones.
    tail : int
        Number of blocks whose velocities enter, the first ones: all, or those of the loads.
    """

    rows: Array
    sizes: Array
    start: Array
    level: Array
    loads: int
    tail: int


class SearchSpace(NamedTuple):
    """Work space of a search, in few arrays: kernels that are given arrays compile faster than those which make them.

    Attributes
    ----------
    hits : ndarray of bool, shape (k,)
        The functions that reach zero at the event; filled by `march`.
    states : ndarray, shape (6, 2, m)
        Changes, states and rates of all blocks; the others have no fixed use.
    bounds : ndarray, shape (11, m)
        Bounds over a step on velocities and displacements and on their second derivatives; those on inputs to coupled
        blocks and on their rates; free energy as sqrt(2 E) and the amplitude that it allows; 1 for coupled blocks.
    functions : ndarray, shape (4, k)
        Values, rates, levels of rounding, and the last times at or below zero.
    series : ndarray, shape (2, 10)
    """

    hits: NDArray[np.bool_]
    states: Array
    bounds: Array
    functions: Array
    series: Array


def search_space(blocks: int, functions: int) -> SearchSpace:
    """Return work space for the search of events of so many functions of so many blocks."""
    return SearchSpace(
        np.zeros(functions, dtype=np.bool_), np.empty((6, 2, blocks)), np.empty((11, blocks)), np.empty((4, functions)),
        np.empty((2, _ORDER + 1)),
    )  # fmt: skip


#: Names of the arrays of a work space.
_CHANGE, _STATE, _RATE = range(3)
_SPEED, _AMPLITUDE, _PUSH, _JERK, _IN_Z, _IN_V, _IN_Z_RATE, _IN_V_RATE, _ENERGY, _CAP, _COUPLED = range(11)
_VALUE, _SLOPE, _NOISE, _BELOW = range(4)


@jit
def _rates(blocks: Blocks, state: Array, out: Array) -> None:
    """Write the rates of the states of all blocks."""
    of, pair, gain = blocks.of, blocks.pair, blocks.gain
    for k in range(of.shape[1]):
        out[0, k] = state[1, k]
        out[1, k] = -2.0 * of[DELTA, k] * state[1, k] - of[SQUARE, k] * state[0, k]
    if pair.shape[0] > 0:
        _add_inputs(pair, gain, state, out)
    group_rate(blocks.group, state, out)


@jit
def _add_inputs(pair: Integers, gain: Array, state: Array, out: Array) -> None:
    """Add what loads do to the rates of coupled blocks."""
    for e in range(pair.shape[0]):
        k, j = pair[e, 0], pair[e, 1]
        out[0, k] += gain[e, 0] * state[0, j] + gain[e, 1] * state[1, j]
        out[1, k] += gain[e, 2] * state[0, j] + gain[e, 3] * state[1, j]


@plain_form(_rates)
def _rates_at_once(blocks: Blocks, state: Array, out: Array) -> None:
    of, pair, gain = blocks.of, blocks.pair, blocks.gain
    out[0] = state[1]
    out[1] = -2.0 * of[DELTA] * state[1] - of[SQUARE] * state[0]
    if pair.size:
        _add_inputs(pair, gain, state, out)
    if blocks.group is not None:
        group_rate(blocks.group, state, out)


@jit
def _evaluate(tau: float, terms: EventFunctions, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    """Fill in states and rates of all blocks, and values and rates of the event functions, at tau."""
    changed, state, rate = space.states[_CHANGE], space.states[_STATE], space.states[_RATE]
    change(blocks, begin, tau, changed)
    of = blocks.of
    for k in range(state.shape[1]):
        z, v = begin[0, k] + changed[0, k], begin[1, k] + changed[1, k]
        state[0, k], state[1, k] = z, v
        rate[0, k], rate[1, k] = v, -2.0 * of[DELTA, k] * v - of[SQUARE, k] * z
    if blocks.pair.shape[0] > 0:
        _add_inputs(blocks.pair, blocks.gain, state, rate)
    group_rate(blocks.group, state, rate)
    rows, tail = terms.rows, terms.tail
    for j in range(terms.start.size):
        value, slope = terms.start[j], 0.0
        for k in range(state.shape[1]):
            value += rows[j, 0, k] * changed[0, k]
            slope += rows[j, 0, k] * rate[0, k]
        for k in range(tail):
            value += rows[j, 1, k] * changed[1, k]
            slope += rows[j, 1, k] * rate[1, k]
        space.functions[_VALUE, j], space.functions[_SLOPE, j] = value, slope


@plain_form(_evaluate)
def _evaluate_at_once(tau: float, terms: EventFunctions, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    changed, state, rate = space.states[:3]
    change_at_once(blocks, begin, tau, changed)
    np.add(begin, changed, out=state)
    _rates_at_once(blocks, state, rate)
    rows = terms.rows[: terms.start.size].reshape(terms.start.size, changed.size)
    space.functions[_VALUE, : terms.start.size] = terms.start + rows @ changed.ravel()
    space.functions[_SLOPE, : terms.start.size] = rows @ rate.ravel()


@jit
def _fill_noise(tau: float, terms: EventFunctions, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    """Fill in the level below which each function is rounding of its terms up to tau.

    Complex modes are summed of the velocities of blocks too. For a slow block the velocity divided by the frequency is
    large compared with all displacements, so only the change of a block within tau is counted. What loads add to a
    coupled block is at most its change and that of its free motion.
    """
    of, changed, bounds, sizes = blocks.of, space.states[_CHANGE], space.bounds, terms.sizes
    loads, mixed = terms.loads, terms.tail > terms.loads
    amplitude, speed = space.states[3, 0], space.states[3, 1]
    for k in range(of.shape[1]):
        energy = bounds[_ENERGY, k]
        amplitude[k] = min(abs(begin[0, k]) + abs(begin[1, k]) * tau, bounds[_CAP, k])
        speed[k] = energy
        if mixed and k >= loads:
            # Free energy does not grow, so it bounds the rates.
            amplitude[k] = min(amplitude[k], energy * tau)
            speed[k] = min(energy, (2.0 * of[DELTA, k] + of[FREQUENCY, k]) * energy * tau)
        amplitude[k] += bounds[_COUPLED, k] * abs(changed[0, k])
        speed[k] += bounds[_COUPLED, k] * abs(changed[1, k])
    for j in range(terms.start.size):
        size = terms.level[j]
        for k in range(of.shape[1]):
            size += sizes[j, 0, k] * amplitude[k]
        for k in range(terms.tail):
            size += sizes[j, 1, k] * speed[k]
        space.functions[_NOISE, j] = _ROUNDING * size + _LEAST


@plain_form(_fill_noise)
def _noise_at_once(tau: float, terms: EventFunctions, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    of, changed, bounds, loads = blocks.of, space.states[_CHANGE], space.bounds, terms.loads
    energy = bounds[_ENERGY]
    amplitude, speed = np.minimum(np.abs(begin[0]) + np.abs(begin[1]) * tau, bounds[_CAP]), energy.copy()
    if terms.tail > loads:
        amplitude[loads:] = np.minimum(amplitude, energy * tau)[loads:]
        speed[loads:] = np.minimum(energy, (2.0 * of[DELTA] + of[FREQUENCY]) * energy * tau)[loads:]
    amplitude += bounds[_COUPLED] * np.abs(changed[0])
    speed += bounds[_COUPLED] * np.abs(changed[1])
    count = terms.start.size
    size = terms.level + terms.sizes[:count, 0] @ amplitude + terms.sizes[:count, 1] @ speed
    space.functions[_NOISE, :count] = _ROUNDING * size + _LEAST


@jit
def _rate_is_rounding(j: int, rows: Array, terms: EventFunctions, space: SearchSpace, share: float) -> bool:
    """Return whether the rate of a function is below a share of its terms, by rows or their bounds, (k, 2, m)."""
    size, rate = 0.0, space.states[_RATE]
    for k in range(rate.shape[1]):
        size += abs(rows[j, 0, k] * rate[0, k]) + abs(rows[j, 1, k] * rate[1, k])
    return abs(space.functions[_SLOPE, j]) <= share * size


def safe_time(distance: float, rate: float, curvature: float) -> float:
    """Return how long a function with this rate and curvature bound stays below `distance`."""
    root = np.sqrt(rate * rate + 2.0 * curvature * distance)
    if root < _TINY:
        root = np.hypot(rate, np.sqrt(2.0 * curvature) * np.sqrt(distance))
    if rate > 0.0:
        return 2.0 * distance / (rate + root)
    if curvature > 0.0:
        return (root - rate) / curvature
    return np.inf


_safe_time = jit(safe_time)


@jit
def _longest_step(group: Group | None) -> float:
    """Return a step in which no group grows much."""
    if group is None or group.bounds[1] <= 0.0:
        return np.inf
    return 1.0 / group.bounds[1]


@jit
def _prepare(blocks: Blocks, begin: Array, duration: float, space: SearchSpace) -> float:
    """Fill in the bounds that hold for a whole segment; return the longest step that they allow."""
    of, pair, gain, bounds = blocks.of, blocks.pair, blocks.gain, space.bounds
    for k in range(of.shape[1]):
        for i in range(_IN_Z, _COUPLED + 1):
            bounds[i, k] = 0.0
        frequency = of[FREQUENCY, k]
        energy = np.sqrt(begin[1, k] ** 2 + of[SQUARE, k] * begin[0, k] ** 2)
        if energy < _TINY:
            energy = np.hypot(begin[1, k], frequency * begin[0, k])
        bounds[_ENERGY, k] = energy
        bounds[_CAP, k] = energy / frequency if frequency > 0.0 else np.inf
    longest = min(duration, _longest_step(blocks.group))
    for e in range(pair.shape[0]):
        k, j = pair[e, 0], pair[e, 1]
        size, rate, rise = bounds[_CAP, j], bounds[_ENERGY, j], of[FREQUENCY, j] * bounds[_ENERGY, j]
        if of[FREQUENCY, j] == 0.0:
            # What bends lines comes first among the pairs.
            rise = bounds[_IN_V, j]
            rate += rise * duration
            size = abs(begin[0, j]) + (abs(begin[1, j]) + 0.5 * rise * duration) * duration
        bounds[_IN_Z, k] += abs(gain[e, 0]) * size + abs(gain[e, 1]) * rate
        bounds[_IN_V, k] += abs(gain[e, 2]) * size + abs(gain[e, 3]) * rate
        bounds[_IN_Z_RATE, k] += abs(gain[e, 0]) * rate + abs(gain[e, 1]) * rise
        bounds[_IN_V_RATE, k] += abs(gain[e, 2]) * rate + abs(gain[e, 3]) * rise
        bounds[_COUPLED, k] = 1.0
        if of[FREQUENCY, k] > 0.0:
            longest = min(longest, 4.0 / of[FREQUENCY, k])
    _mark_group(blocks.group, bounds[_COUPLED])
    return longest


@jit
def _mark_group(group: Group | None, coupled: Array) -> None:
    if group is None:
        return
    for k in group.member:
        coupled[k] = 1.0


@jit
def _fill_bounds(step: float, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    """Fill in bounds on states of all blocks and on their second derivatives over a step.

    Free energy never grows; inputs make sqrt(2 E) grow at most in proportion to time.
    """
    of, state, bounds = blocks.of, space.states[_STATE], space.bounds
    speed, amplitude, push, jerk = bounds[_SPEED], bounds[_AMPLITUDE], bounds[_PUSH], bounds[_JERK]
    for k in range(of.shape[1]):
        z, v, delta, p, frequency = state[0, k], state[1, k], of[DELTA, k], of[SQUARE, k], of[FREQUENCY, k]
        g1, g2 = bounds[_IN_Z, k], bounds[_IN_V, k]
        energy = np.sqrt(v * v + p * z * z)
        if energy < _TINY:
            energy = np.hypot(v, frequency * z)
        speed[k] = energy + (g2 + frequency * g1) * step
        amplitude[k] = abs(z) + (speed[k] + g1) * step
        if frequency > 0.0:
            amplitude[k] = min(amplitude[k], speed[k] / frequency)
        push[k] = (2.0 * delta + frequency) * speed[k] + g2
        jerk[k] = 2.0 * delta * push[k] + p * (speed[k] + g1) + bounds[_IN_V_RATE, k]
        if delta > _OVERDAMPED * frequency:
            _bound_overdamped(k, step, of, begin, space)
        push[k] += bounds[_IN_Z_RATE, k]
    _bound_group(blocks.group, step, space)


@plain_form(_fill_bounds)
def _bounds_at_once(step: float, blocks: Blocks, begin: Array, space: SearchSpace) -> None:
    of, (z, v), bounds = blocks.of, space.states[_STATE], space.bounds
    delta, p, frequency, g1, g2 = of[DELTA], of[SQUARE], of[FREQUENCY], bounds[_IN_Z], bounds[_IN_V]
    speed = bounds[_SPEED] = np.hypot(v, frequency * z) + (g2 + frequency * g1) * step
    safe = np.where(frequency > 0.0, frequency, 1.0)
    cap = np.where(frequency > 0.0, speed / safe, np.inf)
    bounds[_AMPLITUDE] = np.minimum(np.abs(z) + (speed + g1) * step, cap)
    push = bounds[_PUSH] = (2.0 * delta + frequency) * speed + g2
    bounds[_JERK] = 2.0 * delta * push + p * (speed + g1) + bounds[_IN_V_RATE]
    for k in np.flatnonzero(delta > _OVERDAMPED * frequency).tolist():
        _bound_overdamped(k, step, of, begin, space)
    bounds[_PUSH] += bounds[_IN_Z_RATE]
    if blocks.group is not None:
        _bound_group(blocks.group, step, space)


@jit
def _bound_overdamped(k: int, step: float, of: Array, begin: Array, space: SearchSpace) -> None:
    """Lower the bounds of an overdamped block.

    With the decay rates ``r1 < r2`` of a block, ``z = A + B`` and ``v = -r1 A - r2 B``, where

        A' = -r1 A + (g2 + r2 g1) / (r2 - r1),    B' = -r2 B - (g2 + r1 g1) / (r2 - r1).

    B has soon decayed, and A changes slowly. Free energy does not distinguish them: its bounds on the derivatives of A
    are too large by a factor of at least ``r2 / r1``. Close to critical damping nothing would be gained.
    """
    bounds, delta, p = space.bounds, of[DELTA, k], of[SQUARE, k]
    z, v = space.states[_STATE, 0, k], space.states[_STATE, 1, k]
    g1, g2 = bounds[_IN_Z, k], bounds[_IN_V, k]
    apart = 2.0 * np.sqrt(delta * delta - p)
    r2 = delta + 0.5 * apart
    r1 = p / r2
    # A and B are differences, known to the rounding of the state and of the parts that it is summed of.
    z_error, v_error = _ROUNDING * (abs(begin[0, k]) + abs(z)), _ROUNDING * (abs(begin[1, k]) + abs(v))
    a = abs(v + r2 * z) + v_error + r2 * z_error + (g2 + r2 * g1) * step
    b = abs(v + r1 * z) + v_error + r1 * z_error + (g2 + r1 * g1) * min(step, 1.0 / r2)
    a, b = a / apart, b / apart
    bounds[_AMPLITUDE, k] = min(bounds[_AMPLITUDE, k], a + b)
    bounds[_SPEED, k] = min(bounds[_SPEED, k], r1 * a + r2 * b)
    bounds[_PUSH, k] = min(bounds[_PUSH, k], r1**2 * a + r2**2 * b + g2)
    bounds[_JERK, k] = min(
        bounds[_JERK, k], r1**3 * a + r2**3 * b + 2.0 * delta * g2 + p * g1 + bounds[_IN_V_RATE, k]
    )  # fmt: skip


@jit
def _bound_group(group: Group | None, step: float, space: SearchSpace) -> None:
    """Fill in the bounds of the blocks of a group, by the norm of its state."""
    if group is None:
        return
    bounds, state, e = space.bounds, space.states[_STATE], group.scale.size // 2
    rate, growth, norm, drive, rise = group.bounds[0], group.bounds[1], 0.0, 0.0, 0.0
    for j in range(e):
        first, second = group.bounds[2 + j], group.bounds[2 + e + j]
        drive += first * bounds[_AMPLITUDE, j] + second * bounds[_SPEED, j]
        rise += first * bounds[_SPEED, j] + second * bounds[_PUSH, j]
    for k in group.member:
        norm += state[0, k] ** 2 + state[1, k] ** 2
    norm = (np.sqrt(norm) + drive * step) * np.exp(growth * step)
    change = rate * (rate * norm + drive) + rise
    for k in group.member:
        bounds[_SPEED, k] = bounds[_AMPLITUDE, k] = norm
        bounds[_PUSH, k] = bounds[_JERK, k] = change


@jit
def _safe_step(j: int, terms: EventFunctions, levels: Integers, space: SearchSpace) -> float:
    """Return a time within which function j provably stays below its level of rounding.

    Blocks below a level enter by value, rate and bound of the curvature, those above by amplitude.
    """
    rows, bounds, state, rates = terms.rows[j], space.bounds, space.states[_STATE], space.states[_RATE]
    loads, tail, m = terms.loads, terms.tail, rows.shape[1]
    speed, amplitude, push, jerk = bounds[_SPEED], bounds[_AMPLITUDE], bounds[_PUSH], bounds[_JERK]
    value, rate, noise = space.functions[_VALUE, j], space.functions[_SLOPE, j], space.functions[_NOISE, j]
    distance = max(-value, 0.0) + 2.0 * noise
    whole = rate
    fast, curvature, safe = 0.0, 0.0, 0.0
    for k in range(loads, m):
        fast += abs(rows[0, k]) * amplitude[k]
        value -= rows[0, k] * state[0, k]
        rate -= rows[0, k] * rates[0, k]
    for k in range(loads, tail):
        fast += abs(rows[1, k]) * speed[k]
        value -= rows[1, k] * state[1, k]
        rate -= rows[1, k] * rates[1, k]
    for k in range(loads):
        curvature += abs(rows[0, k]) * push[k] + abs(rows[1, k]) * jerk[k]
    k = loads
    for level in range(levels.size - 1):
        while k < levels[level]:
            fast -= abs(rows[0, k]) * amplitude[k]
            value += rows[0, k] * state[0, k]
            rate += rows[0, k] * rates[0, k]
            curvature += abs(rows[0, k]) * push[k]
            if tail > loads:
                fast -= abs(rows[1, k]) * speed[k]
                value += rows[1, k] * state[1, k]
                rate += rows[1, k] * rates[1, k]
                curvature += abs(rows[1, k]) * jerk[k]
            k += 1
        if -value > fast:
            safe = max(safe, _safe_time(2.0 * noise - value - fast, rate, curvature))
    while k < m:
        curvature += abs(rows[0, k]) * push[k]
        if tail > loads:
            curvature += abs(rows[1, k]) * jerk[k]
        k += 1
    return max(safe, _safe_time(distance, whole, curvature))


@plain_form(_safe_step)
def _safe_step_at_once(j: int, terms: EventFunctions, levels: Integers, space: SearchSpace) -> float:
    rows, bounds, (z, v), (zdot, vdot) = terms.rows[j], space.bounds, space.states[_STATE], space.states[_RATE]
    value, rate, noise = space.functions[_VALUE, j], space.functions[_SLOPE, j], space.functions[_NOISE, j]
    (w, u), (w_size, u_size) = rows, np.abs(rows)
    curved = (w_size * bounds[_PUSH] + u_size * bounds[_JERK]).cumsum()
    safe = safe_time(max(-value, 0.0) + 2.0 * noise, rate, curved[-1])
    if levels.size > 1:
        last = levels[:-1] - 1
        fast = (w_size * bounds[_AMPLITUDE] + u_size * bounds[_SPEED])[::-1].cumsum()[::-1][levels[:-1]]
        above = (w * z + u * v)[::-1].cumsum()[::-1][levels[:-1]]
        faster = (w * zdot + u * vdot)[::-1].cumsum()[::-1][levels[:-1]]
        for i in np.flatnonzero(above - value > fast).tolist():
            safe = max(safe, safe_time(2.0 * noise - (value - above[i]) - fast[i], rate - faster[i], curved[last[i]]))
    return safe


@jit
def _safe_time_far(
    j: int, distance: float, step: float, terms: EventFunctions, blocks: Blocks, space: SearchSpace
) -> float:  # fmt: skip
    """Return a time within which function j provably rises by less than `distance`, from high derivatives.

    The bounds on all states hold until `step`, the upper bound of the returned time.
    """
    of, pair, gain, rows, sizes = blocks.of, blocks.pair, blocks.gain, terms.rows[j], terms.sizes[j]
    value, size, m = space.series[0], space.series[1], blocks.of.shape[1]
    state, following, largest, more = space.states[_STATE], space.states[3], space.states[4], space.states[5]
    for k in range(m):
        largest[0, k], largest[1, k] = space.bounds[_AMPLITUDE, k], space.bounds[_SPEED, k]
        more[0, k], more[1, k] = state[0, k], state[1, k]
    for i in range(1, _ORDER + 1):
        _rates(blocks, more, following)
        value[i] = size[i] = 0.0
        for k in range(m):
            more[0, k], more[1, k] = following[0, k], following[1, k]
            slow, quick = largest[0, k], largest[1, k]
            following[0, k] = quick
            following[1, k] = 2.0 * of[DELTA, k] * quick + of[SQUARE, k] * slow
        for e in range(pair.shape[0]):
            k, f, rate = pair[e, 0], largest[0, pair[e, 1]], largest[1, pair[e, 1]]
            following[0, k] += abs(gain[e, 0]) * f + abs(gain[e, 1]) * rate
            following[1, k] += abs(gain[e, 2]) * f + abs(gain[e, 3]) * rate
        _grow_group(blocks.group, largest, following)
        for k in range(m):
            largest[0, k], largest[1, k] = following[0, k], following[1, k]
            value[i] += rows[0, k] * more[0, k] + rows[1, k] * more[1, k]
            size[i] += sizes[0, k] * largest[0, k] + sizes[1, k] * largest[1, k]
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
def _grow_group(group: Group | None, size: Array, out: Array) -> None:
    """Write bounds on the next derivatives of the states of a group, from those on the states of all blocks."""
    if group is None:
        return
    e, norm = group.scale.size // 2, size[0, group.member[0]]
    push = group.bounds[0] * norm
    for j in range(e):
        push += group.bounds[2 + j] * size[0, j] + group.bounds[2 + e + j] * size[1, j]
    for k in group.member:
        out[0, k], out[1, k] = push, push


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
    terms: EventFunctions, blocks: Blocks, levels: Integers, begin: Array, duration: float, space: SearchSpace
) -> tuple[float, int]:
    """Return the first time at which a function becomes positive, and fill in `space.hits`.

    Parameters
    ----------
    terms : EventFunctions
        Event functions that are negative at tau = 0, or zero and falling.
    levels : ndarray of int
        See `Regime`.
    begin : ndarray, shape (2, m)
        States of all blocks at tau = 0.
    duration : float
        Time in s at which the search ends.

    Returns
    -------
    tau : float
        Time of the event in s. If there is no event, it is `duration`, or an earlier time after `SEARCH_WORK`.
    evaluations : int
        Number of evaluations of the functions.
    """
    of, hits, functions = blocks.of, space.hits, space.functions
    m, count = of.shape[1], terms.start.size
    mixed = terms.tail > terms.loads
    longest = _prepare(blocks, begin, duration, space)
    evaluations, most = 0, SEARCH_WORK // (m + EVALUATION_WORK)
    # The last time at which each function was at or below zero. If a function is above zero within rounding, its root
    # lies before `before`.
    for j in range(count):
        hits[j] = False
        functions[_BELOW, j] = 0.0
    quickest = 0.0
    for k in range(m):
        quickest = max(quickest, of[FREQUENCY, k], 2.0 * of[DELTA, k])
    short = 0.1 * _SHORT / quickest if quickest > 0.0 else np.inf
    tau, before = 0.0, 0.0
    while True:
        _evaluate(tau, terms, blocks, begin, space)
        _fill_noise(tau, terms, blocks, begin, space)
        evaluations += 1
        found, all_below = False, True
        for j in range(count):
            hits[j] = tau > 0.0 and functions[_VALUE, j] > functions[_NOISE, j]
            found = found or hits[j]
            if functions[_VALUE, j] > 0.0:
                all_below = False
        if found:
            break
        if tau >= duration:
            return duration, evaluations
        for j in range(count):
            if functions[_VALUE, j] <= 0.0:
                functions[_BELOW, j] = tau
        if evaluations >= most and (evaluations >= 2 * most or all_below):
            return tau, evaluations
        allowed, again = min(duration - tau, longest), False
        while True:
            _fill_bounds(allowed, blocks, begin, space)
            step = allowed
            for j in range(count):
                span = _safe_step(j, terms, levels, space)
                if span < short and span < step:
                    distance = max(-functions[_VALUE, j], 0.0) + 2.0 * functions[_NOISE, j]
                    span = max(span, _safe_time_far(j, distance, allowed, terms, blocks, space))
                step = min(step, span)
            if step >= _LITTLE * tau or allowed <= tau:
                break
            # A function leaves zero slowly, as where a load begins to grow on bodies at rest that touch. Bounds over
            # a time as long as that since the start allow steps that grow with it.
            allowed, again = tau, True
            _prepare(blocks, begin, tau + allowed, space)
        if again:
            _prepare(blocks, begin, duration, space)
        before = tau
        tau = duration if step >= duration - tau else tau + step
        if tau == before:
            # The step is below the resolution of time itself.
            tau = np.nextafter(before, np.inf)

    # The first root lies in (below, tau]: a bracketed Newton iteration for each candidate; the earliest wins.
    first, winner = tau, 0
    for j in range(count):
        if not hits[j]:
            continue
        low, high, x = functions[_BELOW, j], tau, tau
        for _ in range(100):
            _evaluate(x, terms, blocks, begin, space)
            evaluations += 1
            value, rate = functions[_VALUE, j], functions[_SLOPE, j]
            if value > 0.0:
                high = x
            else:
                low = x
            new = x - value / rate if rate != 0.0 else low
            if not low < new < high:
                new = 0.5 * (low + high)
            close = abs(new - x) <= 2.3e-16 * x or high - low <= 2.3e-16 * high
            x = new
            if close:
                break
        if x <= first:
            first, winner = x, j
    _evaluate(first, terms, blocks, begin, space)
    _fill_noise(first, terms, blocks, begin, space)
    evaluations += 1
    for j in range(count):
        # A function that only rounding moves away from zero, as for bodies at rest that touch, is left out of the
        # event of another. In complex modes the bounds on rounding are too wide to distinguish this from slow motion,
        # so the terms themselves are compared.
        compared, share = (terms.rows, _COMPLEX_ROUNDING) if mixed else (terms.sizes, _ROUNDING)
        at_rest = _rate_is_rounding(j, compared, terms, space, share)
        hits[j] = abs(functions[_VALUE, j]) <= functions[_NOISE, j] and functions[_SLOPE, j] > 0.0 and not at_rest
    hits[winner] = True
    return first, evaluations
