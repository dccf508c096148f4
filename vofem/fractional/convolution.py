"""Discrete convolutions whose weights depend on an order, the same at all times or frozen at each.

The weights are entire functions of the order. A convolution with an order
that differs from row to row therefore follows from convolutions at a few
Chebyshev orders, interpolated row by row: ``O(n log n)`` operations and
``O(n)`` memory where the direct sum takes ``O(n^2)`` operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array

#: Weights of a method: order and count to weights, shape (count,), at unit step.
Weights = Callable[[float, int], Array]

#: Below this many samples a direct sum is faster.
_SHORT = 64

#: Widest range of orders within one interpolation. Sums at orders that differ by d differ in size by up to n^d,
#: and so many digits are lost at the smaller end.
_RANGE = 0.25

#: (1 - z/3)^order is cut off where its coefficients fall below rounding.
_TERMS = 40


def binomial(order: float, count: int) -> Array:
    """Return the coefficients of ``(1 - z)^order``: the weights of Grünwald and Letnikov."""
    j = np.arange(1.0, count)
    return np.concatenate([[1.0], np.cumprod((j - 1.0 - order) / j)])


def bdf2(order: float, count: int) -> Array:
    """Return the coefficients of ``(3/2 - 2 z + z^2/2)^order = (1 - z)^order (1 - z/3)^order 1.5^order``."""
    short = binomial(order, min(count, _TERMS))
    short *= 1.5**order * 3.0 ** -np.arange(len(short))
    return np.convolve(binomial(order, count), short)[:count]


def linear(order: float, count: int) -> Array:
    """Return ``(x^p - (x - 1)^p) / Gamma(1 + p)``, ``p = 1 - order``, x = 1, 2, ...: the weights of differences in L1.

    They integrate the kernel exactly over each step of a piecewise linear
    function. The order is at most 1.
    """
    p = 1.0 - order
    x = np.arange(2.0, count + 1)
    # The difference of neighbouring powers without cancellation.
    rest = x**p * -np.expm1(p * np.log1p(-1.0 / x))
    return np.concatenate([[1.0], rest]) / math.gamma(1.0 + p)


def convolve(weights: Weights, stack: Array, orders: Array, *, fast: bool) -> Array:
    """Return ``sum_j w_j(orders[n]) stack[:, n - j]`` for every n.

    `stack` has shape (m, n).
    `orders` has shape (n,).
    `fast`: Fourier transforms, whose rounding is relative to the largest values of a row, instead of direct sums.
    Returns an array of shape (m, n).
    """
    count = stack.shape[1]
    if not fast or count <= _SHORT:
        return _direct(weights, stack, orders)
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * count - 1, real=True)
    transformed = rfft(stack, size)

    def at(order: float) -> Array:
        return irfft(transformed * rfft(weights(order, count), size), size)[:, :count]

    lowest, highest = float(np.min(orders)), float(np.max(orders))
    if lowest == highest:
        return at(lowest)
    result = np.empty_like(stack)
    pieces = max(1, math.ceil((highest - lowest) / _RANGE))
    piece = np.minimum((orders - lowest) / (highest - lowest) * pieces, pieces - 1).astype(int)
    for k in range(pieces):
        rows = np.flatnonzero(piece == k)
        if len(rows):
            result[:, rows] = _interpolated(at, orders[rows], rows)
    return result


def _direct(weights: Weights, stack: Array, orders: Array) -> Array:
    count = stack.shape[1]
    if np.all(orders == orders[0]):
        same = weights(float(orders[0]), count)
        return np.stack([np.convolve(row, same)[:count] for row in stack])
    result = np.empty_like(stack)
    for n, order in enumerate(orders):
        result[:, n] = stack[:, : n + 1] @ weights(float(order), n + 1)[::-1]
    return result


def _interpolated(at: Callable[[float], Array], orders: Array, rows: NDArray[np.int_]) -> Array:
    """Return the rows of convolutions at their orders, by the barycentric formula at Chebyshev points."""
    distinct = np.unique(orders)
    middle, half = 0.5 * (distinct[0] + distinct[-1]), 0.5 * (distinct[-1] - distinct[0])
    count = _points(half * (math.log(rows[-1] + 1.0) + 2.0))
    if len(distinct) <= count:
        nodes, weight = distinct, None
    else:
        angle = (np.arange(count) + 0.5) * np.pi / count
        nodes, weight = middle + half * np.cos(angle), np.where(np.arange(count) % 2, -1.0, 1.0) * np.sin(angle)
    exact, above, below = np.zeros(len(rows), dtype=bool), 0.0, 0.0
    result = None
    for k, node in enumerate(nodes):
        values = at(float(node))[:, rows]
        result = np.zeros_like(values) if result is None else result
        hit = orders == node
        result[:, hit] = values[:, hit]
        exact |= hit
        if weight is not None:
            share = weight[k] / np.where(hit, 1.0, orders - node)
            above, below = above + share * values, below + share
    assert result is not None
    return result if weight is None else np.where(exact, result, above / below)


def _points(growth: float) -> int:
    """Return how many Chebyshev points resolve ``exp(growth x)`` on [-1, 1] to rounding."""
    count, growth = 2, max(growth, 0.1)
    while count * math.log(math.e * growth / (2.0 * count)) > -39.0:
        count += 1
    return count
