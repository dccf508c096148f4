"""The operator with the order frozen at each time: three discretisations of one definition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.fractional.convolution import bdf2, binomial, convolve, linear
from vofem.fractional.linear import piecewise_linear, power
from vofem.fractional.sampled import Sampled

METHODS = ("cq", "gl", "l1")


def check(function: Sampled, method: str, start: Sequence[float], what: str = "samples") -> None:
    """Raise `ArgumentError` if a method cannot treat these samples."""
    if method == "l1":
        return
    if function.step is None:
        steps = np.diff(function.t)
        raise ArgumentError(
            f"the times of the {what} have steps from {np.min(steps):g} to {np.max(steps):g} s, and method={method!r}"
            ' needs equal ones: use method="l1" (orders up to 1), or resample with np.interp on an np.linspace'
        )
    if method == "cq" and len(function.t) < len(start) + 1:
        raise ArgumentError(
            f'there are {len(function.t)} {what}, and method="cq" with start={tuple(map(float, start))} needs at least'
            f' {len(start) + 1}: give more, fewer exponents in start, or use method="gl"'
        )


def frozen(function: Sampled, orders: Array, method: str, start: Sequence[float], fast: bool) -> Array:
    """Return the derivative of order ``orders[n]`` at ``t[n]``, an integral where negative, from the lower limit t[0].

    `function`: passed by `check`.
    `orders` (shape (n,)): orders of the derivative, at most 2; for the scheme L1 at most 1.
    `method`: one of `METHODS`.
    `start`: exponents of powers of ``t - t[0]`` for which "cq" is made exact.
    `fast`: see `convolve`.
    Returns at the lower limit itself what `at_lower_limit` says.
    """
    t, values = function.t - function.t[0], function.values
    if function.step is None:
        later = piecewise_linear(t, values, t[1:], orders[1:])
    else:
        count = np.arange(1.0, len(t))
        if method == "l1":
            later = convolve(linear, np.diff(values)[None], orders[1:], fast=fast)[0]
            later += values[0] * power(count, 0.0, orders[1:])
        elif method == "gl":
            later = convolve(binomial, values[None], orders, fast=fast)[0, 1:]
        else:
            later = _corrected(values, orders, start, fast)[1:]
        later = later * function.step ** -orders[1:]
    return np.append(at_lower_limit(function, float(orders[0]), method), later)


def _corrected(values: Array, orders: Array, start: Sequence[float], fast: bool) -> Array:
    """Convolution quadrature at unit step with starting weights.

    Adding to the quadrature its error for the combination of powers that runs
    through the first samples is the same as weights that make it exact for
    these powers.
    """
    n = np.arange(float(len(values)))
    powers = np.stack([n**k for k in start]) if len(start) else np.empty((0, len(n)))
    sums = convolve(bdf2, np.vstack([values, powers]), orders, fast=fast)
    result = sums[0]
    if len(start):
        first = np.arange(float(len(start)))
        matrix = np.stack([first**k for k in start], axis=1)
        shares = np.linalg.solve(matrix, values[: len(start)])
        for share, k, approximate in zip(shares, start, sums[1:], strict=True):
            result[1:] += share * (power(n[1:], k, orders[1:]) - approximate[1:])
    return result


def at_lower_limit(function: Sampled, order: float, method: str) -> float:
    """Return the limit towards the lower limit.

    For integrals it is 0, and for integer orders the one-sided derivative. For
    other orders it is infinite if g is not zero there, with the sign of the
    singular term. It is NaN where samples cannot tell: for an order between 1 and
    2 of a function that begins at zero with an unknown slope.
    """
    t, g = function.t, function.values
    if order < 0.0:
        return 0.0
    if order in (0.0, 1.0, 2.0):
        # Through three points at most, two where the method is of first order.
        points = min(len(g), 3 if order == 2.0 or method == "cq" else 2)
        if order == 2.0 and points < 3:
            return np.nan
        scale = t[1] - t[0]
        fit = np.polynomial.polynomial.polyfit((t[:points] - t[0]) / scale, g[:points], points - 1)
        return float(fit[int(order)] * (1.0, 1.0, 2.0)[int(order)] / scale**order)
    if g[0] != 0.0:
        return float(np.copysign(np.inf, g[0] if order < 1.0 else -g[0]))
    return 0.0 if order < 1.0 else np.nan
