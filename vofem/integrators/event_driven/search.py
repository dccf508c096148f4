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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.blocks import add_from_rest, moved_at_once
from vofem.integrators.event_driven.clusters import Group, group_change, group_rate
from vofem.kernels.addresses import floats, integers, shaped
from vofem.kernels.jit import borrowed, jit, plain_form
from vofem.linalg.exponential import half_turns
from vofem.linalg.oscillators import CRITICAL, DECAY, DELTA, DIVISOR, FAST, FREQUENCY, ROOT, SQUARE, decays

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


#: Rows of the array of a search, shape (ROWS, m), with numbers of each block: the description of `oscillators`; the
#: state at the beginning; changes, states and their rates at a time; three pairs without fixed use; bounds over a step
#: on velocities and displacements and on their second derivatives; those on inputs to coupled blocks and on the rates
#: of these; free energy as sqrt(2 E) and the amplitude that it allows; 1 for coupled blocks; and the work space of
#: `oscillators_at`. Kernels take this one array, because numba needs much time for each argument.
START, _START_V, _DZ, _DV, _Z, _V, _Z_RATE, _V_RATE, _NEXT_Z, _NEXT_V, _MOST_Z, _MOST_V, _MORE_Z, _MORE_V = range(8, 22)
_SPEED, _AMPLITUDE, _PUSH, _JERK, _IN_Z, _IN_V, _IN_Z_RATE, _IN_V_RATE, _ENERGY, _CAP, _COUPLED = range(22, 33)
_TURN, _SINE, _SLOWER, _FASTER, _POWER, _COSINE, _RESPONSE, ROWS = range(33, 41)
MOVED = _DZ

#: Rows of the array of event functions, shape (FUNCTION_ROWS, k): values at the beginning, sizes of the constants from
#: which these were computed; values, rates and levels of rounding at a time, the last times at or below zero; and 1 for
#: those that reach zero at the event.
BEGINNING, CONSTANTS, _VALUE, _SLOPE, _NOISE, _BELOW, HIT, FUNCTION_ROWS = range(8)

#: Numbers of other work space. The search leaves the number of its evaluations in the first.
SPARE = 2 * (_ORDER + 1)

#: What searches take of a linear piece: numbers of event functions, coupled pairs, levels, blocks, blocks of the
#: structure, and blocks whose velocities enter (all, or those of the loads); the address of `respond`, see `Response`;
#: and places of arrays, see `Blocks` and `Regime`: rows of the event functions over the blocks, and bounds on the terms
#: that these are summed of (k, 2, m); work space; and those of `Group`, or 0.
FUNCTIONS, PAIRS, LEVELS, BLOCKS, OWN, TAIL, RESPOND = range(7)
PAIR, GAIN, ENDS, FUNCTION_OF, SIZES, WORK, MEMBER, MATRIX, SCALE, BOUNDS, TAKES = range(7, 18)


@jit
def _add_inputs(pair: Integers, gain: Array, state: Array, out: Array) -> None:
    """Add what loads do to the rates of coupled blocks."""
    for e in range(pair.shape[0]):
        k, j = pair[e, 0], pair[e, 1]
        out[0, k] += gain[e, 0] * state[0, j] + gain[e, 1] * state[1, j]
        out[1, k] += gain[e, 2] * state[0, j] + gain[e, 3] * state[1, j]


@jit
def _evaluate(
    tau: float, x: Array, f: Array, rows: Array, tail: int, damped: float, pair: Integers, gain: Array, address: int,
    group: Group | None, spare: Array,
) -> None:  # fmt: skip
    """Fill in changes, states and rates of all blocks, and values and rates of the event functions, at tau."""
    x, f, rows = borrowed(x), borrowed(f), borrowed(rows)
    m = x.shape[1]
    half_turns(x[ROOT], tau, x[_TURN], x[_SINE])
    if damped != 0.0:
        decays(x[DECAY], tau, x[_SLOWER], x[_POWER])
        decays(x[FAST], tau, x[_FASTER], x[_POWER])
    for k in range(m):
        # As in `oscillators_at` and `change`.
        z, v, delta, left = x[START, k], x[_START_V, k], x[DELTA, k], 1.0 + x[_SLOWER, k]
        c = x[_SLOWER, k] + left * (x[_TURN, k] + 0.5 * x[_FASTER, k])
        s = left * ((x[_SINE, k] - x[_FASTER, k]) / x[DIVISOR, k] + tau * x[CRITICAL, k])
        x[_DZ, k], x[_DV, k] = c * z + s * (v + delta * z), c * v - s * (x[SQUARE, k] * z + delta * v)
    if pair.shape[0] > 0:
        add_from_rest(x, pair, gain, address, spare, x[START:], tau, x[_DZ:])
    group_change(group, x[START:], tau, x[_DZ:])
    for k in range(m):
        z, v = x[START, k] + x[_DZ, k], x[_START_V, k] + x[_DV, k]
        x[_Z, k], x[_V, k] = z, v
        x[_Z_RATE, k], x[_V_RATE, k] = v, -2.0 * x[DELTA, k] * v - x[SQUARE, k] * z
    if pair.shape[0] > 0:
        _add_inputs(pair, gain, x[_Z:], x[_Z_RATE:])
    group_rate(group, x[_Z:], x[_Z_RATE:])
    for j in range(f.shape[1]):
        value, slope = f[BEGINNING, j], 0.0
        for k in range(m):
            value += rows[j, 0, k] * x[_DZ, k]
            slope += rows[j, 0, k] * x[_Z_RATE, k]
        for k in range(tail):
            value += rows[j, 1, k] * x[_DV, k]
            slope += rows[j, 1, k] * x[_V_RATE, k]
        f[_VALUE, j], f[_SLOPE, j] = value, slope


@plain_form(_evaluate)
def _evaluate_at_once(
    tau: float, x: Array, f: Array, rows: Array, tail: int, damped: float, pair: Integers, gain: Array, address: int,
    group: Group | None, spare: Array,
) -> None:  # fmt: skip
    begin, moved, state, rate = x[START:_DZ], x[_DZ:_Z], x[_Z:_Z_RATE], x[_Z_RATE:_NEXT_Z]
    moved_at_once(x, begin, tau, x[_TURN:ROWS], moved)
    if pair.size:
        add_from_rest(x, pair, gain, address, spare, begin, tau, moved)
    if group is not None:
        group_change(group, begin, tau, moved)
    np.add(begin, moved, out=state)
    rate[0] = state[1]
    rate[1] = -2.0 * x[DELTA] * state[1] - x[SQUARE] * state[0]
    if pair.size:
        _add_inputs(pair, gain, state, rate)
    if group is not None:
        group_rate(group, state, rate)
    flat = rows.reshape(len(rows), moved.size)
    f[_VALUE] = f[BEGINNING] + flat @ moved.ravel()
    f[_SLOPE] = flat @ rate.ravel()


@jit
def _fill_noise(tau: float, x: Array, f: Array, sizes: Array, loads: int, tail: int) -> None:
    """Fill in the level below which each function is rounding of its terms up to tau.

    Complex modes are summed of the velocities of blocks too. For a slow block the velocity divided by the frequency is
    large compared with all displacements, so only the change of a block within tau is counted. What loads add to a
    coupled block is at most its change and that of its free motion.
    """
    x, f, sizes = borrowed(x), borrowed(f), borrowed(sizes)
    m = x.shape[1]
    for k in range(m):
        energy = x[_ENERGY, k]
        amplitude, speed = min(abs(x[START, k]) + abs(x[_START_V, k]) * tau, x[_CAP, k]), energy
        if tail > loads and k >= loads:
            # Free energy does not grow, so it bounds the rates.
            amplitude = min(amplitude, energy * tau)
            speed = min(energy, (2.0 * x[DELTA, k] + x[FREQUENCY, k]) * energy * tau)
        x[_NEXT_Z, k] = amplitude + x[_COUPLED, k] * abs(x[_DZ, k])
        x[_NEXT_V, k] = speed + x[_COUPLED, k] * abs(x[_DV, k])
    for j in range(f.shape[1]):
        size = f[CONSTANTS, j]
        for k in range(m):
            size += sizes[j, 0, k] * x[_NEXT_Z, k]
        for k in range(tail):
            size += sizes[j, 1, k] * x[_NEXT_V, k]
        f[_NOISE, j] = _ROUNDING * size + _LEAST


@plain_form(_fill_noise)
def _noise_at_once(tau: float, x: Array, f: Array, sizes: Array, loads: int, tail: int) -> None:
    energy = x[_ENERGY]
    amplitude, speed = np.minimum(np.abs(x[START]) + np.abs(x[_START_V]) * tau, x[_CAP]), energy.copy()
    if tail > loads:
        amplitude[loads:] = np.minimum(amplitude, energy * tau)[loads:]
        speed[loads:] = np.minimum(energy, (2.0 * x[DELTA] + x[FREQUENCY]) * energy * tau)[loads:]
    amplitude += x[_COUPLED] * np.abs(x[_DZ])
    speed += x[_COUPLED] * np.abs(x[_DV])
    f[_NOISE] = _ROUNDING * (f[CONSTANTS] + sizes[:, 0] @ amplitude + sizes[:, 1] @ speed) + _LEAST


@jit
def _rate_is_rounding(j: int, rows: Array, x: Array, f: Array, share: float) -> bool:
    """Return whether the rate of a function is below a share of its terms, by rows or their bounds, (k, 2, m)."""
    size = 0.0
    for k in range(x.shape[1]):
        size += abs(rows[j, 0, k] * x[_Z_RATE, k]) + abs(rows[j, 1, k] * x[_V_RATE, k])
    return bool(abs(f[_SLOPE, j]) <= share * size)


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
def _prepare(duration: float, x: Array, pair: Integers, gain: Array, group: Group | None) -> float:
    """Fill in the bounds that hold for a whole segment; return the longest step that they allow."""
    x, gain = borrowed(x), borrowed(gain)
    for k in range(x.shape[1]):
        for i in range(_IN_Z, _COUPLED + 1):
            x[i, k] = 0.0
        x[_SLOWER, k] = x[_FASTER, k] = 0.0
        z, v, frequency = x[START, k], x[_START_V, k], x[FREQUENCY, k]
        energy = np.sqrt(v * v + x[SQUARE, k] * (z * z))
        if energy < _TINY:
            energy = np.hypot(v, frequency * z)
        x[_ENERGY, k] = energy
        x[_CAP, k] = energy / frequency if frequency > 0.0 else np.inf
    longest = min(duration, _longest_step(group))
    for e in range(pair.shape[0]):
        k, j = pair[e, 0], pair[e, 1]
        size, rate, rise = x[_CAP, j], x[_ENERGY, j], x[FREQUENCY, j] * x[_ENERGY, j]
        if x[FREQUENCY, j] == 0.0:
            # What bends lines comes first among the pairs.
            rise = x[_IN_V, j]
            rate += rise * duration
            size = abs(x[START, j]) + (abs(x[_START_V, j]) + 0.5 * rise * duration) * duration
        a1, b1, a2, b2 = abs(gain[e, 0]), abs(gain[e, 1]), abs(gain[e, 2]), abs(gain[e, 3])
        x[_IN_Z, k] += a1 * size + b1 * rate
        x[_IN_V, k] += a2 * size + b2 * rate
        x[_IN_Z_RATE, k] += a1 * rate + b1 * rise
        x[_IN_V_RATE, k] += a2 * rate + b2 * rise
        x[_COUPLED, k] = 1.0
        if x[FREQUENCY, k] > 0.0:
            longest = min(longest, 4.0 / x[FREQUENCY, k])
    _mark_group(group, x)
    return longest


@jit
def _mark_group(group: Group | None, x: Array) -> None:
    if group is None:
        return
    for k in group.member:
        x[_COUPLED, k] = 1.0


@jit
def _fill_bounds(step: float, x: Array, group: Group | None) -> None:
    """Fill in bounds on states of all blocks and on their second derivatives over a step.

    Free energy never grows; inputs make sqrt(2 E) grow at most in proportion to time.
    """
    x = borrowed(x)
    for k in range(x.shape[1]):
        z, v, delta, p, frequency = x[_Z, k], x[_V, k], x[DELTA, k], x[SQUARE, k], x[FREQUENCY, k]
        g1, g2 = x[_IN_Z, k], x[_IN_V, k]
        energy = np.sqrt(v * v + p * z * z)
        if energy < _TINY:
            energy = np.hypot(v, frequency * z)
        speed = energy + (g2 + frequency * g1) * step
        amplitude = abs(z) + (speed + g1) * step
        if frequency > 0.0:
            amplitude = min(amplitude, speed / frequency)
        push = (2.0 * delta + frequency) * speed + g2
        x[_SPEED, k], x[_AMPLITUDE, k], x[_PUSH, k] = speed, amplitude, push
        x[_JERK, k] = 2.0 * delta * push + p * (speed + g1) + x[_IN_V_RATE, k]
        if delta > _OVERDAMPED * frequency:
            _bound_overdamped(k, step, x)
        x[_PUSH, k] += x[_IN_Z_RATE, k]
    _bound_group(group, step, x)


@plain_form(_fill_bounds)
def _bounds_at_once(step: float, x: Array, group: Group | None) -> None:
    z, v = x[_Z], x[_V]
    delta, p, frequency, g1, g2 = x[DELTA], x[SQUARE], x[FREQUENCY], x[_IN_Z], x[_IN_V]
    speed = x[_SPEED] = np.hypot(v, frequency * z) + (g2 + frequency * g1) * step
    safe = np.where(frequency > 0.0, frequency, 1.0)
    cap = np.where(frequency > 0.0, speed / safe, np.inf)
    x[_AMPLITUDE] = np.minimum(np.abs(z) + (speed + g1) * step, cap)
    push = x[_PUSH] = (2.0 * delta + frequency) * speed + g2
    x[_JERK] = 2.0 * delta * push + p * (speed + g1) + x[_IN_V_RATE]
    for k in np.flatnonzero(delta > _OVERDAMPED * frequency).tolist():
        _bound_overdamped(k, step, x)
    x[_PUSH] += x[_IN_Z_RATE]
    if group is not None:
        _bound_group(group, step, x)


@jit
def _bound_overdamped(k: int, step: float, x: Array) -> None:
    """Lower the bounds of an overdamped block.

    With the decay rates ``r1 < r2`` of a block, ``z = A + B`` and ``v = -r1 A - r2 B``, where

        A' = -r1 A + (g2 + r2 g1) / (r2 - r1),    B' = -r2 B - (g2 + r1 g1) / (r2 - r1).

    B has soon decayed, and A changes slowly. Free energy does not distinguish them: its bounds on the derivatives of A
    are too large by a factor of at least ``r2 / r1``. Close to critical damping nothing would be gained.
    """
    delta, p, z, v = x[DELTA, k], x[SQUARE, k], x[_Z, k], x[_V, k]
    g1, g2 = x[_IN_Z, k], x[_IN_V, k]
    apart = 2.0 * np.sqrt(delta * delta - p)
    r2 = delta + 0.5 * apart
    r1 = p / r2
    # A and B are differences, known to the rounding of the state and of the parts that it is summed of.
    z_error, v_error = _ROUNDING * (abs(x[START, k]) + abs(z)), _ROUNDING * (abs(x[_START_V, k]) + abs(v))
    a = abs(v + r2 * z) + v_error + r2 * z_error + (g2 + r2 * g1) * step
    b = abs(v + r1 * z) + v_error + r1 * z_error + (g2 + r1 * g1) * min(step, 1.0 / r2)
    a, b = a / apart, b / apart
    x[_AMPLITUDE, k] = min(x[_AMPLITUDE, k], a + b)
    x[_SPEED, k] = min(x[_SPEED, k], r1 * a + r2 * b)
    x[_PUSH, k] = min(x[_PUSH, k], r1**2 * a + r2**2 * b + g2)
    x[_JERK, k] = min(
        x[_JERK, k], r1**3 * a + r2**3 * b + 2.0 * delta * g2 + p * g1 + x[_IN_V_RATE, k]
    )  # fmt: skip


@jit
def _bound_group(group: Group | None, step: float, x: Array) -> None:
    """Fill in the bounds of the blocks of a group, by the norm of its state."""
    if group is None:
        return
    e = group.scale.size // 2
    rate, growth, norm, drive, rise = group.bounds[0], group.bounds[1], 0.0, 0.0, 0.0
    for j in range(e):
        first, second = group.bounds[2 + j], group.bounds[2 + e + j]
        drive += first * x[_AMPLITUDE, j] + second * x[_SPEED, j]
        rise += first * x[_SPEED, j] + second * x[_PUSH, j]
    for k in group.member:
        norm += x[_Z, k] ** 2 + x[_V, k] ** 2
    norm = (np.sqrt(norm) + drive * step) * np.exp(growth * step)
    change = rate * (rate * norm + drive) + rise
    for k in group.member:
        x[_SPEED, k] = x[_AMPLITUDE, k] = norm
        x[_PUSH, k] = x[_JERK, k] = change


@jit
def _safe_step(j: int, rows: Array, loads: int, tail: int, levels: Integers, x: Array, f: Array) -> float:
    """Return a time within which function j provably stays below its level of rounding.

    Blocks below a level enter by value, rate and bound of the curvature, those above by amplitude.
    """
    rows, levels, x, f = borrowed(rows), borrowed(levels), borrowed(x), borrowed(f)
    m, value, rate, noise = x.shape[1], f[_VALUE, j], f[_SLOPE, j], f[_NOISE, j]
    distance = max(-value, 0.0) + 2.0 * noise
    whole = rate
    fast, curvature, safe = 0.0, 0.0, 0.0
    for k in range(loads, m):
        fast += abs(rows[j, 0, k]) * x[_AMPLITUDE, k]
        value -= rows[j, 0, k] * x[_Z, k]
        rate -= rows[j, 0, k] * x[_Z_RATE, k]
    for k in range(loads, tail):
        fast += abs(rows[j, 1, k]) * x[_SPEED, k]
        value -= rows[j, 1, k] * x[_V, k]
        rate -= rows[j, 1, k] * x[_V_RATE, k]
    for k in range(loads):
        curvature += abs(rows[j, 0, k]) * x[_PUSH, k] + abs(rows[j, 1, k]) * x[_JERK, k]
    k = loads
    for level in range(levels.size - 1):
        while k < levels[level]:
            fast -= abs(rows[j, 0, k]) * x[_AMPLITUDE, k]
            value += rows[j, 0, k] * x[_Z, k]
            rate += rows[j, 0, k] * x[_Z_RATE, k]
            curvature += abs(rows[j, 0, k]) * x[_PUSH, k]
            if tail > loads:
                fast -= abs(rows[j, 1, k]) * x[_SPEED, k]
                value += rows[j, 1, k] * x[_V, k]
                rate += rows[j, 1, k] * x[_V_RATE, k]
                curvature += abs(rows[j, 1, k]) * x[_JERK, k]
            k += 1
        if -value > fast:
            safe = max(safe, _safe_time(2.0 * noise - value - fast, rate, curvature))
    while k < m:
        curvature += abs(rows[j, 0, k]) * x[_PUSH, k]
        if tail > loads:
            curvature += abs(rows[j, 1, k]) * x[_JERK, k]
        k += 1
    return max(safe, _safe_time(distance, whole, curvature))


@plain_form(_safe_step)
def _safe_step_at_once(j: int, rows: Array, loads: int, tail: int, levels: Integers, x: Array, f: Array) -> float:
    z, v, zdot, vdot = x[_Z:_NEXT_Z]
    value, rate, noise = f[_VALUE, j], f[_SLOPE, j], f[_NOISE, j]
    (w, u), (w_size, u_size) = rows[j], np.abs(rows[j])
    curved = (w_size * x[_PUSH] + u_size * x[_JERK]).cumsum()
    safe = safe_time(max(-value, 0.0) + 2.0 * noise, rate, curved[-1])
    if levels.size > 1:
        last = levels[:-1] - 1
        fast = (w_size * x[_AMPLITUDE] + u_size * x[_SPEED])[::-1].cumsum()[::-1][levels[:-1]]
        above = (w * z + u * v)[::-1].cumsum()[::-1][levels[:-1]]
        faster = (w * zdot + u * vdot)[::-1].cumsum()[::-1][levels[:-1]]
        for i in np.flatnonzero(above - value > fast).tolist():
            safe = max(safe, safe_time(2.0 * noise - (value - above[i]) - fast[i], rate - faster[i], curved[last[i]]))
    return safe


@jit
def _safe_time_far(
    distance: float, step: float, rows: Array, sizes: Array, x: Array, pair: Integers, gain: Array,
    group: Group | None, spare: Array,
) -> float:  # fmt: skip
    """Return a time within which a function, shape (2, m), provably rises by less than `distance`, from derivatives.

    The bounds on all states hold until `step`, the upper bound of the returned time.
    """
    x, rows, sizes, gain, spare = borrowed(x), borrowed(rows), borrowed(sizes), borrowed(gain), borrowed(spare)
    m = x.shape[1]
    for k in range(m):
        x[_MOST_Z, k], x[_MOST_V, k] = x[_AMPLITUDE, k], x[_SPEED, k]
        x[_MORE_Z, k], x[_MORE_V, k] = x[_Z, k], x[_V, k]
    for i in range(1, _ORDER + 1):
        for k in range(m):
            v, quick, decay, p = x[_MORE_V, k], x[_MOST_V, k], 2.0 * x[DELTA, k], x[SQUARE, k]
            x[_NEXT_Z, k], x[_NEXT_V, k] = v, -decay * v - p * x[_MORE_Z, k]
            x[_TURN, k], x[_SINE, k] = quick, decay * quick + p * x[_MOST_Z, k]
        for e in range(pair.shape[0]):
            k, j = pair[e, 0], pair[e, 1]
            for row in range(2):
                a, b = gain[e, 2 * row], gain[e, 2 * row + 1]
                x[_NEXT_Z + row, k] += a * x[_MORE_Z, j] + b * x[_MORE_V, j]
                x[_TURN + row, k] += abs(a) * x[_MOST_Z, j] + abs(b) * x[_MOST_V, j]
        _grow_group(group, x)
        value, size = 0.0, 0.0
        for k in range(m):
            for row in range(2):
                more = x[_MORE_Z + row, k] = x[_NEXT_Z + row, k]
                most = x[_MOST_Z + row, k] = x[_TURN + row, k]
                value += rows[row, k] * more
                size += sizes[row, k] * most
        spare[2 * i], spare[2 * i + 1] = value, size
    safe_time = step
    for _ in range(200):
        rise, term = 0.0, 1.0
        for i in range(1, _ORDER + 1):
            term *= safe_time / i
            size = spare[2 * i + 1]
            slope = size if i == _ORDER else max(spare[2 * i], 0.0) + _ROUNDING * size
            rise += slope * term
        if rise <= distance:
            return safe_time
        safe_time *= 0.5
    return safe_time


@jit
def _grow_group(group: Group | None, x: Array) -> None:
    """Write the next derivatives of the states of a group, and bounds on them."""
    if group is None:
        return
    group_rate(group, x[_MORE_Z:], x[_NEXT_Z:])
    e, norm = group.scale.size // 2, x[_MOST_Z, group.member[0]]
    push = group.bounds[0] * norm
    for j in range(e):
        push += group.bounds[2 + j] * x[_MOST_Z, j] + group.bounds[2 + e + j] * x[_MOST_V, j]
    for k in group.member:
        x[_TURN, k] = x[_SINE, k] = push


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
def _group_of(piece: Integers) -> Group | None:
    """Return the group of a linear piece; pieces with groups are followed in plain Python only."""
    return None


@plain_form(_group_of)
def _plain_group_of(piece: Integers) -> Group | None:
    return Group(*(floats(place) for place in piece[MEMBER:TAKES].tolist())) if piece[MEMBER] else None


@jit
def march(place: int, p: Any, z: Any, t: float, duration: float) -> float:
    """Return the first time at which an event function becomes positive, and write changes and hits at this time.

    Kernels call it by its address: so it is compiled once, and not again as a part of each of them.

    `place`: of what is taken of the linear piece, see `FUNCTIONS`.
    `p`: the array of the blocks, shape (ROWS, m); their description and their states at tau = 0 are given.
    `z`: that of the event functions, shape (FUNCTION_ROWS, k), which are negative at tau = 0, or zero and falling.
    Values and constants at tau = 0 are given, and which functions may begin above zero, as reactions do where forces
    jump. Such a function is an event at tau = 0.
    `t`, `duration`: time of the run at tau = 0, and time from there at which the search ends, s.
    Returns `tau`: time of the event in s. If there is no event, it is `duration`, or an earlier time after
    `SEARCH_WORK`, at which t + tau is exact. The number of evaluations of the functions is left in the work space;
    without functions it is 0, and the changes are those after `duration`.
    """
    piece = shaped(integers(place), (TAKES,))
    m, count, pairs, tail, address = piece[BLOCKS], piece[FUNCTIONS], piece[PAIRS], piece[TAIL], piece[RESPOND]
    loads, group, damped = m - piece[OWN], _group_of(piece), 0.0
    x, f = shaped(p, (ROWS, m)), shaped(z, (FUNCTION_ROWS, count))
    rows, sizes = shaped(floats(piece[FUNCTION_OF]), (count, 2, m)), shaped(floats(piece[SIZES]), (count, 2, m))
    pair, gain = shaped(integers(piece[PAIR]), (pairs, 3)), shaped(floats(piece[GAIN]), (pairs, 4))
    levels, spare = shaped(integers(piece[ENDS]), (piece[LEVELS],)), shaped(floats(piece[WORK]), (SPARE,))
    # The last time at which each function was at or below zero. If a function is above zero within rounding, its root
    # lies before `before`.
    for j in range(count):
        f[_BELOW, j] = 0.0
    quickest = 0.0
    for k in range(m):
        quickest = max(quickest, x[FREQUENCY, k], 2.0 * x[DELTA, k])
        damped = max(damped, abs(x[DELTA, k]))
    longest = _prepare(duration, x, pair, gain, group)
    if count == 0:
        _evaluate(duration, x, f, rows, tail, damped, pair, gain, address, group, spare)
        spare[0] = 0.0
        return duration
    evaluations, most = 0, SEARCH_WORK // (m + EVALUATION_WORK)
    short = 0.1 * _SHORT / quickest if quickest > 0.0 else np.inf
    tau, before = 0.0, 0.0
    while True:
        _evaluate(tau, x, f, rows, tail, damped, pair, gain, address, group, spare)
        _fill_noise(tau, x, f, sizes, loads, tail)
        evaluations += 1
        found, all_below = False, True
        for j in range(count):
            f[HIT, j] = 1.0 if (tau > 0.0 or f[HIT, j] != 0.0) and f[_VALUE, j] > f[_NOISE, j] else 0.0
            found = found or f[HIT, j] != 0.0
            if f[_VALUE, j] > 0.0:
                all_below = False
        if found:
            break
        if tau >= duration:
            spare[0] = evaluations
            return duration
        for j in range(count):
            if f[_VALUE, j] <= 0.0:
                f[_BELOW, j] = tau
        if evaluations >= most and (evaluations >= 2 * most or all_below):
            cut = exact_cut(t, tau)
            if cut != tau:
                _evaluate(cut, x, f, rows, tail, damped, pair, gain, address, group, spare)
            spare[0] = evaluations
            return cut
        allowed, again = min(duration - tau, longest), False
        while True:
            _fill_bounds(allowed, x, group)
            step = allowed
            for j in range(count):
                span = _safe_step(j, rows, loads, tail, levels, x, f)
                if span < short and span < step:
                    distance = max(-f[_VALUE, j], 0.0) + 2.0 * f[_NOISE, j]
                    far = _safe_time_far(distance, allowed, rows[j], sizes[j], x, pair, gain, group, spare)
                    span = max(span, far)
                step = min(step, span)
            if step >= _LITTLE * tau or allowed <= tau:
                break
            # A function leaves zero slowly, as where a load begins to grow on bodies at rest that touch. Bounds over
            # a time as long as that since the start allow steps that grow with it.
            allowed, again = tau, True
            _prepare(tau + allowed, x, pair, gain, group)
        if again:
            _prepare(duration, x, pair, gain, group)
        before = tau
        tau = duration if step >= duration - tau else tau + step
        if tau == before:
            # The step is below the resolution of time itself.
            tau = np.nextafter(before, np.inf)

    # The first root lies in (below, tau]: a bracketed Newton iteration for each candidate; the earliest wins.
    first, winner = tau, 0
    for j in range(count):
        if f[HIT, j] == 0.0:
            continue
        low, high, now = f[_BELOW, j], tau, tau
        for _ in range(100):
            _evaluate(now, x, f, rows, tail, damped, pair, gain, address, group, spare)
            evaluations += 1
            value, rate = f[_VALUE, j], f[_SLOPE, j]
            if value > 0.0:
                high = now
            else:
                low = now
            new = now - value / rate if rate != 0.0 else low
            if not low < new < high:
                new = 0.5 * (low + high)
            close = abs(new - now) <= 2.3e-16 * now or high - low <= 2.3e-16 * high
            now = new
            if close:
                break
        if now <= first:
            first, winner = now, j
    _evaluate(first, x, f, rows, tail, damped, pair, gain, address, group, spare)
    _fill_noise(first, x, f, sizes, loads, tail)
    evaluations += 1
    for j in range(count):
        # A function that only rounding moves away from zero, as for bodies at rest that touch, is left out of the
        # event of another. In complex modes the bounds on rounding are too wide to distinguish this from slow motion,
        # so the terms themselves are compared.
        compared, share = (rows, _COMPLEX_ROUNDING) if tail > loads else (sizes, _ROUNDING)
        at_rest = _rate_is_rounding(j, compared, x, f, share)
        hit = abs(f[_VALUE, j]) <= f[_NOISE, j] and f[_SLOPE, j] > 0.0 and not at_rest
        f[HIT, j] = 1.0 if hit or j == winner else 0.0
    spare[0] = evaluations
    return first
