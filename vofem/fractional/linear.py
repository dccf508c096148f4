"""Operators on piecewise linear functions in closed form, on any grid: L1, the product trapezoid, and histories."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array

#: Entries of the tables that are held at a time.
_CHUNK = 2_000_000


def power(x: Array, k: float, order: Array) -> Array:
    """Return the derivative of given orders (integral where negative) of ``x^k``, x > 0, from the lower limit 0."""
    from scipy.special import gamma, rgamma

    return gamma(k + 1.0) * rgamma(k + 1.0 - order) * x ** (k - order)


def piecewise_linear(grid: Array, values: Array, t: Array, orders: Array, *, ends: bool = False) -> Array:
    """Return the derivative of given orders of the piecewise linear function through `values`.

    `grid`, `values` (shape (n,)): the first entry of `grid` is the lower limit.
    `t`, `orders` (shape (k,)): times above the lower limit, and the order at each: negative for an integral, at most 1
    unless ``t > grid[-1]`` throughout.
    `ends`: the function drops to zero at the end of its grid. Otherwise all t lie on the grid.
    Returns an array of shape (k,).
    """
    from scipy.special import rgamma

    result = values[0] * power(t - grid[0], 0.0, orders)
    if ends:
        result = result - values[-1] * power(t - grid[-1], 0.0, orders)
    steps, slopes = np.diff(grid), np.diff(values) / np.diff(grid)
    rows = max(1, _CHUNK // len(grid))
    for first in range(0, len(t), rows):
        part = slice(first, first + rows)
        p = 1.0 - orders[part, None]
        x = np.maximum(t[part, None] - grid[:-1], 0.0)
        seen = x > 0.0
        x = np.where(seen, x, 1.0)
        inner = np.maximum(t[part, None] - grid[1:], 0.0)
        # x^p - inner^p without cancellation; inner = 0 ends the sum, also for p = 0.
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = inner / x
            log = np.where(ratio < 0.5, np.log(ratio), np.log1p(-np.minimum(steps / x, 0.75)))
            share = np.where(inner > 0.0, -np.expm1(p * log), 1.0)
        result[part] += np.where(seen, x**p * share, 0.0) @ slopes * rgamma(1.0 + p[:, 0])
    return result
