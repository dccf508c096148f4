"""Divided differences of the exponential: every response of a linear oscillator, without division by zero.

The response of ``z'' + 2 delta z' + p z`` to ``exp(b t)`` from rest is the divided difference of ``x -> exp(x t)`` over
its two roots and b. In this form resonance, repeated roots and rigid-body motion are not special cases.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.kernels.jit import jit, plain_form

#: pi/2 in three parts, of which the first two have 33 bits, and its inverse. Products with whole numbers below 2^20 are
#: exact.
_QUARTER = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_QUARTERS = 0.6366197723675814

#: Largest angle in rad that is reduced by these.
_LARGEST_ANGLE = 1e5


@jit
def half_turns(frequency: Array, t: float, turn: Array, sine: Array) -> None:
    """Compute ``cos(w t) - 1`` and ``sin(w t)`` for many frequencies, shape (n,), accurately also for very short t.

    The loop has no branches and calls no functions, so that compilers do several frequencies at once. Angles are
    reduced to a quarter of pi, where the Taylor series of degree 17 is exact to rounding.
    """
    first, second, third = _QUARTER
    for k in range(frequency.size):
        x = 0.5 * frequency[k] * t
        n = np.rint(x * _QUARTERS)
        y = x - n * first
        rest = y - n * second
        tail = (y - rest) - n * second - n * third
        z = rest + tail
        low = (rest - z) + tail
        q = z * z
        s = -7.647163731819816e-13 + q * 2.8114572543455206e-15
        s = 1.6059043836821613e-10 + q * s
        s = -2.505210838544172e-08 + q * s
        s = 2.7557319223985893e-06 + q * s
        s = -0.0001984126984126984 + q * s
        s = 0.008333333333333333 + q * s
        s = -0.16666666666666666 + q * s
        s = z + (z * q * s + low)
        c = 4.779477332387385e-14 + q * -1.5619206968586225e-16
        c = -1.1470745597729725e-11 + q * c
        c = 2.08767569878681e-09 + q * c
        c = -2.755731922398589e-07 + q * c
        c = 2.48015873015873e-05 + q * c
        c = -0.001388888888888889 + q * c
        c = 0.041666666666666664 + q * c
        c = 1.0 - (0.5 * q - (c * q * q - z * low))
        odd = n - 2.0 * np.floor(0.5 * n)
        turn[k] = -2.0 * (odd * (c * c) + (1.0 - odd) * (s * s))
        sine[k] = (2.0 - 4.0 * odd) * s * c
    for k in range(frequency.size):
        if 0.5 * frequency[k] * t > _LARGEST_ANGLE:
            half = 0.5 * frequency[k] * t
            s, c = np.sin(half), np.cos(half)
            turn[k], sine[k] = -2.0 * s * s, 2.0 * s * c


@plain_form(half_turns)
def _half_turns_of_all(frequency: Array, t: float, turn: Array, sine: Array) -> None:
    """Do what `half_turns` does, for all frequencies at once."""
    half = 0.5 * frequency * t
    s, c = np.sin(half), np.cos(half)
    turn[:] = -2.0 * s * s
    sine[:] = 2.0 * s * c


@jit
def oscillator_change(delta: float, p: float, t: float) -> tuple[float, float]:
    """Return ``c - 1, s`` for ``z'' + 2 delta z' + p z = 0``, accurate to all digits also for very short t.

    ``s`` is the response to a unit velocity and ``c = s' + delta s``, so that
    ``z = c z0 + s (v0 + delta z0)`` and ``v = c v0 - s (p z0 + delta v0)``.
    This holds for underdamped, overdamped, critically damped and free motion.
    """
    square = p - delta * delta
    if square > 0.0:
        w = np.sqrt(square)
        sine, cosine = np.sin(0.5 * w * t), np.cos(0.5 * w * t)
        turn = -2.0 * sine * sine
        if delta == 0.0:
            return turn, 2.0 * sine * cosine / w
        decay = np.expm1(-delta * t)
        return decay + turn + decay * turn, (1.0 + decay) * 2.0 * sine * cosine / w
    if square == 0.0:
        decay = np.expm1(-delta * t)
        return decay, (1.0 + decay) * t
    kappa = np.sqrt(-square)
    # The slow root -delta + kappa, without cancellation.
    slow = np.expm1(-p / (delta + kappa) * t)
    fast = (1.0 + slow) * np.expm1(-2.0 * kappa * t)
    return slow + 0.5 * fast, -fast / (2.0 * kappa)


@jit
def matrix_change(generator: Array, t: float) -> Array:
    """Return ``exp(A t) - I`` of a small matrix A, shape (n, n), by Taylor's series and squaring.

    Squaring the difference from I keeps the digits of slow motion beside fast decay.
    """
    n = generator.shape[0]
    size = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(generator[i, j])
        size = max(size, row)
    halvings = 0
    h = t
    while size * h > 0.5:
        h *= 0.5
        halvings += 1
    x = generator * h
    change = x.copy()
    term = x.copy()
    for k in range(2, 19):
        term = (term @ x) / k
        change += term
    for _ in range(halvings):
        change = change @ change + 2.0 * change
    return change


@jit
def _taylor(a: complex, b: complex, c: complex, d: complex, count: int) -> complex:
    """Return the divided difference of exp over the first `count` of some points that lie close together."""
    mean = a / count + b / count
    if count > 2:
        mean += c / count
    if count > 3:
        mean += d / count
    a, b, c, d = a - mean, b - mean, c - mean, d - mean
    # Complete homogeneous symmetric polynomials of the first, the first two and more points, one degree at a time.
    one, two, three, four = 1.0 + 0.0j, 1.0 + 0.0j, 1.0 + 0.0j, 1.0 + 0.0j
    factor = 1.0 if count == 2 else (0.5 if count == 3 else 1.0 / 6.0)
    total = 0.0j
    for m in range(40):
        total += factor * (two if count == 2 else (three if count == 3 else four))
        one = one * a
        two = one + b * two
        three = two + c * three
        four = three + d * four
        factor /= m + count
    return np.exp(mean) * total


@jit
def _apart(a: complex, b: complex) -> float:
    """Return the squared distance of two points."""
    return (a.real - b.real) ** 2 + (a.imag - b.imag) ** 2


@jit
def _difference2(a: complex, b: complex) -> complex:
    """Return the divided difference of exp over two points."""
    if _apart(a, b) < 1.0:
        return _taylor(a, b, 0j, 0j, 2)
    return (np.exp(b) - np.exp(a)) / (b - a)


@jit
def _difference3(a: complex, b: complex, c: complex) -> complex:
    """Return the divided difference of exp over three points."""
    # The first two are to be those farthest apart.
    ab, ac, bc = _apart(a, b), _apart(a, c), _apart(b, c)
    if ac > ab and ac >= bc:
        b, c = c, b
    elif bc > ab:
        a, c = c, a
    if max(ab, ac, bc) < 1.0:
        return _taylor(a, b, c, 0j, 3)
    return (_difference2(b, c) - _difference2(a, c)) / (b - a)


@jit
def _ramp_difference(a: complex, b: complex) -> complex:
    """Return the divided difference of exp over two points and twice over 0."""
    ab, a0, b0 = _apart(a, b), _apart(a, 0j), _apart(b, 0j)
    if max(ab, a0, b0) < 1.0:
        return _taylor(a, b, 0j, 0j, 4)
    if ab >= max(a0, b0):
        return (_difference3(b, 0j, 0j) - _difference3(a, 0j, 0j)) / (b - a)
    # The point that is farthest from 0 is left out in the first difference, one of the zeros in the second one.
    far, near = (a, b) if a0 >= b0 else (b, a)
    return (_difference3(far, near, 0j) - _difference3(near, 0j, 0j)) / far


@jit
def roots(delta: float, p: float) -> tuple[complex, complex]:
    """Return the two roots of ``x^2 + 2 delta x + p``."""
    square = p - delta * delta
    if square >= 0.0:
        w = np.sqrt(square)
        return complex(-delta, w), complex(-delta, -w)
    kappa = np.sqrt(-square)
    return complex(-p / (delta + kappa), 0.0), complex(-delta - kappa, 0.0)


@jit
def exponential_response(delta: float, p: float, b: complex, t: float) -> complex:
    """Return the response from rest of ``z'' + 2 delta z' + p z = exp(b t)``."""
    first, second = roots(delta, p)
    return t * t * _difference3(first * t, second * t, b * t)


@jit
def ramp_response(delta: float, p: float, t: float) -> float:
    """Return the response from rest of ``z'' + 2 delta z' + p z = t``."""
    first, second = roots(delta, p)
    return t * t * t * _ramp_difference(first * t, second * t).real


@jit
def power_response(delta: float, p: float, k: int, t: float) -> float:
    """Return the response from rest of ``z'' + 2 delta z' + p z = t^k/k!`` while ``p t^2 < 1``."""
    if 2.0 * delta * t < 4.0:
        # Complete homogeneous symmetric polynomials of both roots, over factorials.
        factor = 1.0
        for i in range(k + 2):
            factor *= t / (i + 1.0)
        last, now, total = 0.0, 1.0, 0.0
        for m in range(60):
            total += factor * now
            factor /= k + 3.0 + m
            last, now = now, -2.0 * delta * t * now - p * t * t * last
        return total
    kappa = np.sqrt(max(delta * delta - p, 0.0))
    slow, fast = -p / (delta + kappa), -(delta + kappa)
    return (_first_order(slow, k, t) - _first_order(fast, k, t)) / (slow - fast)


@jit
def _first_order(root: float, k: int, t: float) -> float:
    """Return the response from rest of ``z' = root z + t^k/k!`` for a root that is not positive."""
    if -root * t > 1.0:
        found, term = np.expm1(root * t) / root, 1.0
        for i in range(1, k + 1):
            term *= t / i
            found = (found - term) / root
        return found
    factor, total = t, 0.0
    for i in range(1, k + 1):
        factor *= t / (i + 1.0)
    for m in range(30):
        total += factor
        factor *= root * t / (k + 2.0 + m)
    return total
