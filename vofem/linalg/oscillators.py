"""Many oscillators at one time: the functions of `exponential.oscillator_change`, several oscillators at once.

The loops have no branches and call no functions, so that compilers do several oscillators at a time.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.kernels.jit import borrowed, jit, plain_form
from vofem.linalg.exponential import half_turns

#: Rows of the array that describes oscillators ``z'' + 2 delta z' + p z = 0``: delta in 1/s, p in 1/s^2, the frequency
#: without damping and the one of the damped motion in rad/s (0 where it does not oscillate), the decay rate (of the
#: slower of two exponentials), by how much the faster one is faster in 1/s, what sine or exponentials are divided by,
#: and 1 where both roots are equal.
DELTA, SQUARE, FREQUENCY, ROOT, DECAY, FAST, DIVISOR, CRITICAL = range(8)

#: The logarithm of 2 in two parts, of which the first has 32 bits, and its inverse.
_LOG2 = (0.6931471803691238, 1.9082149292705877e-10)
_LOG2S = 1.4426950408889634

#: Exponents below this one give -1 to the last bit.
_LEAST = -700.0

#: Bits of the fraction of a number, and the exponent of 1.0.
_FRACTION, _ONE = 52, 1023


def oscillators(delta: Array, p: Array) -> Array:
    """Return the description of some oscillators, shape (8, n), from arrays of shape (n,)."""
    square, found = p - delta * delta, np.zeros((8, p.size))
    size, over = np.sqrt(np.abs(square)), square < 0.0
    found[DELTA], found[SQUARE], found[FREQUENCY], found[ROOT], found[DECAY] = delta, p, np.sqrt(p), size, delta
    found[DIVISOR], found[CRITICAL] = np.where(size > 0.0, size, 1.0), ~(size > 0.0)
    if over.any():
        found[ROOT, over], found[DECAY, over] = 0.0, p[over] / (delta[over] + size[over])
        found[FAST, over] = found[DIVISOR, over] = 2.0 * size[over]
    return found


@jit
def decays(rate: Array, t: float, out: Array, power: Array) -> None:
    """Compute ``exp(-rate t) - 1`` for many rates that are not negative, accurately also for very short t.

    The exponent is reduced to half of log 2, where the Taylor series of degree 13 is exact to rounding. `power` is work
    space: powers of 2, which are set by their bits.
    """
    first, second = _LOG2
    bits = power.view(np.int64)
    for k in range(rate.size):
        x = max(-rate[k] * t, _LEAST)
        n = np.rint(x * _LOG2S)
        bits[k] = (np.int64(n) + _ONE) << _FRACTION
        r = (x - n * first) - n * second
        e = 2.08767569878681e-09 + r * 1.6059043836821613e-10
        e = 2.505210838544172e-08 + r * e
        e = 2.755731922398589e-07 + r * e
        e = 2.7557319223985893e-06 + r * e
        e = 2.48015873015873e-05 + r * e
        e = 0.0001984126984126984 + r * e
        e = 0.001388888888888889 + r * e
        e = 0.008333333333333333 + r * e
        e = 0.041666666666666664 + r * e
        e = 0.16666666666666666 + r * e
        e = 0.5 + r * e
        out[k] = r + r * r * e
    for k in range(rate.size):
        out[k] = power[k] * out[k] + (power[k] - 1.0)


@plain_form(decays)
def _decays_of_all(rate: Array, t: float, out: Array, power: Array) -> None:
    out[:] = np.expm1(-rate * t)


@jit
def oscillators_at(of: Array, t: float, out: Array, work: Array) -> None:
    """Compute ``c - 1`` and ``s`` of `exponential.oscillator_change` at time t.

    `of` (shape (8, n)): see `oscillators`.
    `out` (shape (2, n)): filled.
    `work` (shape (5, n)): work space.
    """
    of, out, work = borrowed((of, out, work))
    c, s, divisor, critical = out[0], out[1], of[DIVISOR], of[CRITICAL]
    turn, sine, slower, faster, power = work[0], work[1], work[2], work[3], work[4]
    half_turns(of[ROOT], t, turn, sine)
    damped = False
    for k in range(c.size):
        if of[DELTA, k] != 0.0:
            damped = True
            break
    if not damped:
        for k in range(c.size):
            c[k] = turn[k]
            s[k] = sine[k] / divisor[k] + t * critical[k]
        return
    decays(of[DECAY], t, slower, power)
    decays(of[FAST], t, faster, power)
    for k in range(c.size):
        left = 1.0 + slower[k]
        c[k] = slower[k] + left * (turn[k] + 0.5 * faster[k])
        s[k] = left * ((sine[k] - faster[k]) / divisor[k] + t * critical[k])


@plain_form(oscillators_at)
def oscillators_at_once(of: Array, t: float, out: Array, work: Array) -> None:
    """Do what `oscillators_at` does, for all oscillators at once."""
    c, s = out
    half = (0.5 * t) * of[ROOT]
    sine, cosine = np.sin(half), np.cos(half)
    np.multiply(-2.0 * sine, sine, out=c)
    np.add(2.0 * sine * cosine / of[DIVISOR], t * of[CRITICAL], out=s)
    if of[DELTA].any():
        slower, faster = np.expm1(-t * of[DECAY]), np.expm1(-t * of[FAST])
        s -= faster / of[DIVISOR]
        s *= 1.0 + slower
        c[:] = slower + (1.0 + slower) * (c + 0.5 * faster)


def oscillator_times(of: Array, t: Array) -> tuple[Array, Array]:
    """Return ``c - 1`` and ``s`` at many times (n_times,), each of shape (n_times, n)."""
    half = np.multiply.outer(0.5 * t, of[ROOT])
    sine, cosine = np.sin(half), np.cos(half)
    c, s = -2.0 * sine * sine, 2.0 * sine * cosine / of[DIVISOR] + np.multiply.outer(t, of[CRITICAL])
    if of[DELTA].any():
        slower, faster = np.expm1(np.multiply.outer(-t, of[DECAY])), np.expm1(np.multiply.outer(-t, of[FAST]))
        s = (1.0 + slower) * (s - faster / of[DIVISOR])
        c = slower + (1.0 + slower) * (c + 0.5 * faster)
    return c, s
