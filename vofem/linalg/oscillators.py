"""Many oscillators at one time: the functions of `exponential.oscillator_change`, several oscillators at once.

The loops have no branches and call no functions, so that compilers do several oscillators at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit, plain_form
from vofem.linalg.exponential import half_turns, oscillator_changes

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: The logarithm of 2 in two parts, of which the first has 32 bits, and its inverse.
_LOG2 = (0.6931471803691238, 1.9082149292705877e-10)
_LOG2S = 1.4426950408889634

#: Exponents below this one give -1 to the last bit.
_LEAST = -700.0

#: Bits of the fraction of a number, and the exponent of 1.0.
_FRACTION, _ONE = 52, 1023


class Oscillators(NamedTuple):
    """Oscillators ``z'' + 2 delta z' + p z = 0`` and work space, each of shape (n,).

    Attributes
    ----------
    delta, p, frequency : ndarray
        The frequency is that without damping, rad/s.
    root : ndarray
        Angular frequency of the damped motion, 0 where it does not oscillate, rad/s.
    decay, fast : ndarray
        Decay rate, or that of the slower of two exponentials, and by how much the faster one is faster, 1/s.
    divisor, critical : ndarray
        Of the response to a unit velocity: what sine or exponentials are divided by, and 1 where both roots are equal.
    turn, sine, slower, faster : ndarray
        Work space.
    bits, power : ndarray
        Work space: the same memory as whole numbers and as numbers.
    """

    delta: Array
    p: Array
    frequency: Array
    root: Array
    decay: Array
    fast: Array
    divisor: Array
    critical: Array
    turn: Array
    sine: Array
    slower: Array
    faster: Array
    bits: Integers
    power: Array


def oscillators(delta: Array, p: Array) -> Oscillators:
    """Return some oscillators with work space, from arrays of shape (n,)."""
    square = p - delta * delta
    size, over = np.sqrt(np.abs(square)), square < 0.0
    bits, (turn, sine, slower, faster) = np.zeros(p.size, dtype=np.int64), np.empty((4, p.size))
    return Oscillators(
        delta, p, np.sqrt(p), np.where(over, 0.0, size), np.where(over, p / np.where(over, delta + size, 1.0), delta),
        np.where(over, 2.0 * size, 0.0), np.where(over, 2.0 * size, np.where(size > 0.0, size, 1.0)),
        np.where(size > 0.0, 0.0, 1.0), turn, sine, slower, faster, bits, bits.view(np.float64),
    )  # fmt: skip


@jit
def decays(rate: Array, t: float, out: Array, bits: Integers, power: Array) -> None:
    """Compute ``exp(-rate t) - 1`` for many rates that are not negative, accurately also for very short t.

    The exponent is reduced to half of log 2, where the Taylor series of degree 13 is exact to rounding.
    """
    first, second = _LOG2
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
def _decays_of_all(rate: Array, t: float, out: Array, bits: Integers, power: Array) -> None:
    out[:] = np.expm1(-rate * t)


@jit
def oscillators_at(of: Oscillators, t: float, c: Array, s: Array) -> None:
    """Compute ``c - 1`` and ``s`` of `exponential.oscillator` at time t."""
    turn, sine, slower, faster = of.turn, of.sine, of.slower, of.faster
    half_turns(of.root, t, turn, sine)
    decays(of.decay, t, slower, of.bits, of.power)
    decays(of.fast, t, faster, of.bits, of.power)
    for k in range(c.size):
        left = 1.0 + slower[k]
        c[k] = slower[k] + left * (turn[k] + 0.5 * faster[k])
        s[k] = left * ((sine[k] - faster[k]) / of.divisor[k] + t * of.critical[k])


def free_rows(of: Oscillators, starts: Array, own: Integers, t: Array) -> Array:
    """Return by how much the free motions that begin in some states have changed, shape (n_times, 2n).

    Parameters
    ----------
    starts : ndarray, shape (k, 2n)
        Displacements and velocities at the start.
    own, t : ndarray, shape (n_times,)
        Row of `starts` for each time, and times from the start, s.
    """
    change = np.empty((t.size, starts.shape[1]))
    _fill_rows(of, np.ascontiguousarray(starts), own, t, change)
    return change


@jit
def _fill_rows(of: Oscillators, starts: Array, own: Integers, t: Array, change: Array) -> None:
    n = of.p.size
    c, s = np.empty((2, n))
    for i in range(t.size):
        start, row = starts[own[i]], change[i]
        oscillators_at(of, t[i], c, s)
        for k in range(n):
            z0, v0 = start[k], start[n + k]
            row[k] = c[k] * z0 + s[k] * (v0 + of.delta[k] * z0)
            row[n + k] = c[k] * v0 - s[k] * (of.p[k] * z0 + of.delta[k] * v0)


@plain_form(_fill_rows)
def _fill_rows_at_once(of: Oscillators, starts: Array, own: Integers, t: Array, change: Array) -> None:
    n = of.p.size
    c, s = (part.T for part in oscillator_changes(of.delta, of.p, t))
    z0, v0 = starts[own, :n], starts[own, n:]
    change[:, :n] = c * z0 + s * (v0 + of.delta * z0)
    change[:, n:] = c * v0 - s * (of.p * z0 + of.delta * v0)
