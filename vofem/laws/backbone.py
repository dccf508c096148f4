"""Backbones of cyclic laws in compiled form: force, slope, and the mean force between two elongations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.laws.kinds import HYPERBOLIC
from vofem.laws.table import Laws

Array = NDArray[np.float64]

_SQRT = 1.0 / math.sqrt(3.0)


@jit
def _knot(laws: Laws, j: int, w: float) -> tuple[int, int, int]:
    """Return first parameter, number of knots and the interval of a tabulated backbone that holds w."""
    law = laws.table[j]
    a = law["first"]
    n = (law["last"] - a) // 4
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if laws.parameters[a + middle] <= w:
            low = middle
        else:
            high = middle
    return a, n, low


@jit
def _cubic(laws: Laws, a: int, n: int, k: int, w: float) -> tuple[float, float]:
    """Return force and slope of the backbone at w in interval k; beyond the last knot it is straight."""
    p = laws.parameters
    if w >= p[a + n - 1]:
        slope = p[a + 3 * n - 1]
        return p[a + 2 * n - 1] + slope * (w - p[a + n - 1]), slope
    h = p[a + k + 1] - p[a + k]
    x = (w - p[a + k]) / h
    rise = p[a + n + k + 1] - p[a + n + k]
    s0, s1 = h * p[a + 2 * n + k], h * p[a + 2 * n + k + 1]
    c, d = 3.0 * rise - 2.0 * s0 - s1, s0 + s1 - 2.0 * rise
    return p[a + n + k] + x * (s0 + x * (c + x * d)), (s0 + x * (2.0 * c + 3.0 * x * d)) / h


@jit
def backbone(laws: Laws, j: int, w: float) -> tuple[float, float]:
    """Return force and slope of the backbone at an elongation w, counted from the start of the backbone."""
    law = laws.table[j]
    if law["kind"] == HYPERBOLIC:
        k, limit, span = (
            law["stiffness"],
            law["limit"],
            laws.parameters[law["first"]],
        )
        total = span + k * w
        return limit * (k * w / total), limit * k * (span / total) / total
    a, n, at = _knot(laws, j, w)
    return _cubic(laws, a, n, at, w)


@jit
def backbone_mean(laws: Laws, j: int, w0: float, w1: float) -> float:
    """Return the mean force of the backbone between w0 < w1, without cancellation."""
    law = laws.table[j]
    if law["kind"] == HYPERBOLIC:
        k, limit, span = (
            law["stiffness"],
            law["limit"],
            laws.parameters[law["first"]],
        )
        total = span + k * w0
        x = k * (w1 - w0) / total
        # 1 - log(1 + x)/x.
        if x < 0.1:
            bend = 0.0
            for n in range(16, 0, -1):
                bend = x * (1.0 / (n + 1) - bend)
        else:
            bend = 1.0 - math.log1p(x) / x
        return limit * (bend + (k * w0 / total) * (1.0 - bend))
    p = laws.parameters
    a, n, first = _knot(laws, j, w0)
    last = _knot(laws, j, w1)[2]
    if first == last and not (w0 < p[a + n - 1] < w1):
        return _inside(laws, a, n, first, w0, w1)
    work = _inside(laws, a, n, first, w0, p[a + first + 1]) * (p[a + first + 1] - w0)
    if last > first:
        work += p[a + 3 * n + last] - p[a + 3 * n + first + 1]
        middle = min(w1, p[a + n - 1])
        work += _inside(laws, a, n, last, p[a + last], middle) * (middle - p[a + last])
    if w1 > p[a + n - 1]:
        work += _inside(laws, a, n, last, p[a + n - 1], w1) * (w1 - p[a + n - 1])
    return work / (w1 - w0)


@jit
def _inside(laws: Laws, a: int, n: int, k: int, w0: float, w1: float) -> float:
    """Return the mean of one cubic: Gauss's rule of two points is exact."""
    middle, half = 0.5 * (w0 + w1), 0.5 * (w1 - w0) * _SQRT
    return 0.5 * (_cubic(laws, a, n, k, middle - half)[0] + _cubic(laws, a, n, k, middle + half)[0])
