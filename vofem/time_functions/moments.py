"""Exact moments of functions of time over intervals, put together from parts without breakpoints.

Of an interval of length h about the time m the moments are means over the fraction ``x = (t - m)/h`` in [-1/2, 1/2]:

    m0 = mean of f,    m1 = mean of x f,    m2 = mean of (x^2 - 1/12) f.

The impulse of the interval is ``h m0`` and the first moment about its middle ``h^2 m1``. A constant has m1 = m2 = 0
and a straight line m2 = 0, so nothing cancels where a function is smooth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vofem.arrays import Array

#: Nodes and weights of Gauss and Legendre on [-1/2, 1/2].
_NODES, _WEIGHTS = (0.5 * part for part in np.polynomial.legendre.leggauss(5))

#: Half angles below which series stand for the closed forms of a sine's moments, which lose digits there.
_SMALL = 0.7


def gather(left: Array, right: Array, corners: Array, smooth: Callable[[Array, Array], Array]) -> Array:
    """Return the moments over intervals from those of their parts between corners.

    `left`, `right` (shape (n,)): ends of the intervals in s.
    `corners` (shape (k,)): times at which the function or its slope may jump, sorted.
    `smooth`: returns the moments over intervals without corners inside, shape (3, n).
    Returns `moments` (shape (3, n)).
    """
    if not corners.size:
        return smooth(left, right)
    first, last = np.searchsorted(corners, left, side="right"), np.searchsorted(corners, right, side="left")
    count = np.maximum(last - first, 0)
    whole = count == 0
    if np.all(whole):
        return smooth(left, right)
    moments = np.empty((3, left.size))
    moments[:, whole] = smooth(left[whole], right[whole])
    cut = np.flatnonzero(~whole)
    parts = count[cut] + 1
    owner = np.repeat(np.arange(cut.size), parts)
    starts = np.concatenate([[0], np.cumsum(parts)[:-1]])
    place = np.arange(owner.size) - starts[owner]
    a, b = left[cut][owner], right[cut][owner]
    low = np.where(place > 0, corners[np.maximum(first[cut][owner] + place - 1, 0)], a)
    high = np.where(place < parts[owner] - 1, corners[np.minimum(first[cut][owner] + place, corners.size - 1)], b)
    share, place_of_middle = (high - low) / (b - a), ((low - a) - (b - high)) / (2.0 * (b - a))
    moments[:, cut] = np.add.reduceat(carried(smooth(low, high), share, place_of_middle), starts, axis=1)
    return moments


def carried(part: Array, share: Array, middle: Array) -> Array:
    """Return what parts contribute to the moments of an interval, shape (3, n).

    `part` (shape (3, n)): moments of parts about their own middles.
    `share`, `middle` (shape (n,)): lengths of the parts, and places of their middles from that of the interval, as
    fractions of its length.
    """
    m0, m1, m2 = part
    second = (middle**2 + (share**2 - 1.0) / 12.0) * m0 + 2.0 * middle * share * m1 + share**2 * m2
    return np.stack([share * m0, share * (middle * m0 + share * m1), share * second])


def straight(middle: Array, slope: Array, length: Array) -> Array:
    """Return the moments of straight lines with a value at the middle and a slope, shape (3, n)."""
    return np.stack([middle, slope * length / 12.0, np.zeros(length.shape)])


def wave(half: Array) -> tuple[Array, Array, Array]:
    """Return the moments of cos, sin and cos of ``2 y x`` for half angles y: m0 and m2 of the cosine, m1 of the sine.

    ``sin y/y``, ``(sin y - y cos y)/(2 y^2)`` and ``((y^2 - 3) sin y + 3 y cos y)/(6 y^3)``.
    """
    y = np.asarray(half, dtype=float)
    small = np.abs(y) < _SMALL
    if np.all(small):
        return _near(y)
    near, far = _near(np.where(small, y, 0.0)), np.where(small, 1.0, y)
    sine, cosine = np.sin(far), np.cos(far)
    m0 = np.where(small, near[0], sine / far)
    m1 = np.where(small, near[1], (sine - far * cosine) / (2.0 * far**2))
    m2 = np.where(small, near[2], ((far**2 - 3.0) * sine + 3.0 * far * cosine) / (6.0 * far**3))
    return m0, m1, m2


def _near(y: Array) -> tuple[Array, Array, Array]:
    """Return the moments of a wave by series."""
    minus = -y * y
    series = np.zeros((3, *y.shape))
    for coefficients in _SERIES.reshape(_SERIES.shape + (1,) * y.ndim):
        series *= minus
        series += coefficients
    return series[0], y * series[1], (2.0 / 3.0) * minus * series[2]


#: 1/n!
_INVERSE = 1.0 / np.cumprod(np.concatenate([[1.0], np.arange(1.0, 31.0)]))

#: Coefficients of the powers of -y^2 in `_near`, the highest first: 1/(2k+1)!, (k+1)/(2k+3)! and (k+1)(k+2)/(2k+5)!,
#: shape (10, 3).
_SERIES = np.array(
    [_INVERSE[2 * k + 1 : 2 * k + 6 : 2] * (1.0, k + 1.0, (k + 1.0) * (k + 2.0)) for k in range(9, -1, -1)]
)


def sampled(function: Callable[[Array], Array], left: Array, right: Array, width: float) -> Array:
    """Return the moments of a function known by its values only, at points not farther apart than a width.

    Panels of five points of Gauss and Legendre are exact for polynomials of degree seven and less. Their number is
    odd: so the middles are among the points, and the function is asked for its values there first.
    """
    length = right - left
    if not length.size:
        return np.empty((3, 0))
    panels = max(1, int(np.ceil(float(np.max(length)) / (_NODES.size * width) - 1e-6))) | 1
    x = ((np.arange(panels)[:, None] + 0.5 + _NODES) / panels - 0.5).ravel()
    weight = np.tile(_WEIGHTS, panels) / panels
    centre, at = 0.5 * (left + right), x.size // 2
    base = function(centre)[:, None]
    rest = np.zeros((length.size, x.size))
    others = np.arange(x.size) != at
    rest[:, others] = function(centre[:, None] + length[:, None] * x[others]) - base
    # Sums of rows, whose digits do not depend on how many intervals are asked for at once.
    moments = np.stack([np.sum(rest * w, axis=1) for w in (weight, weight * x, weight * (x**2 - 1.0 / 12.0))])
    moments[0] += base[:, 0]
    return moments
