"""Real Fourier series of periodic motions: values, turning points, crossings.

A series of H harmonics is an array of 2H + 1 numbers, the mean first, then the
cosines, then the sines, over an angle that grows by 2 pi in a period.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array, Complex

#: Number of times in a period of the highest harmonic at which signs are compared.
_LOOKS = 8

#: Steps of the search for a root; bisection alone would need 52.
_STEPS = 80

#: Change of an angle, rad, at which the search for a root ends.
_CLOSE = 1e-14

#: Rounding of a value, as a share of the size of its terms.
_EPS = float(np.finfo(float).eps)

#: A rate below this fraction of the size of its terms counts as zero.
_STILL = 1e-13


def basis(angles: Array, harmonics: int) -> Array:
    """Return 1, the cosines and the sines at some angles, shape (n, 2H + 1)."""
    turns = np.outer(angles, np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((angles.size, 1)), np.cos(turns), np.sin(turns)], axis=1)


def rate(series: Array) -> Array:
    """Return the series of the derivative by the angle."""
    harmonics = series.shape[0] // 2
    order = np.arange(1, harmonics + 1).reshape(-1, *(1,) * (series.ndim - 1))
    cosines, sines = series[1 : harmonics + 1], series[harmonics + 1 :]
    return np.concatenate([np.zeros_like(series[:1]), order * sines, -order * cosines])


def to_complex(series: Array) -> Complex:
    """Return ``c`` with ``u = Re sum_k c_k exp(i k angle)``, shape (H + 1, ...)."""
    harmonics = series.shape[0] // 2
    found = series[: harmonics + 1].astype(complex)
    found[1:] -= 1j * series[harmonics + 1 :]
    return found


def to_real(coefficients: Complex) -> Array:
    """Return the series of ``u = Re sum_k c_k exp(i k angle)``."""
    return np.concatenate([coefficients.real, -coefficients[1:].imag])


def roots(series: Array, low: Array, high: Array, level: Array | float = 0.0) -> Array:
    """Return the angles at which a series reaches levels, between angles on different sides of them, shape (k,)."""
    harmonics, slope = series.size // 2, rate(series)
    low, high = low.copy(), high.copy()
    rising = basis(high, harmonics) @ series > basis(low, harmonics) @ series
    rounding = _EPS * (np.abs(series).sum() + np.abs(level))
    x = 0.5 * (low + high)
    for _ in range(_STEPS):
        functions = basis(x, harmonics)
        value, change = functions @ series - level, functions @ slope
        below = (value < 0.0) == rising
        low, high = np.where(below, x, low), np.where(below, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / change
        # A root that is met exactly is an end of its bracket.
        inside = (newton >= low) & (newton <= high)
        after = np.where(inside, newton, 0.5 * (low + high))
        done = (np.abs(after - x) <= _CLOSE) | (np.abs(value) <= rounding)
        x = after
        if np.all(done):
            break
    return x


def turning_points(series: Array) -> Array:
    """Return the angles in [0, 2 pi) at which a series turns, sorted; none where it does not move.

    Extremes closer to each other than an eighth of a period of the highest harmonic are taken for one motion.
    """
    slope = rate(series)
    harmonics = series.size // 2
    places = np.linspace(0.0, 2.0 * np.pi, _LOOKS * (harmonics + 1) + 1)
    values = basis(places, harmonics) @ slope
    values[-1] = values[0]
    size = float(np.abs(slope).sum())
    if size <= _STILL * float(np.abs(series).sum()) or size == 0.0:
        return np.zeros(0)
    values[values == 0.0] = np.finfo(float).tiny
    changes = np.flatnonzero((values[:-1] > 0.0) != (values[1:] > 0.0))
    found = roots(slope, places[changes], places[changes + 1])
    return np.unique(np.mod(found, 2.0 * np.pi))


def stretches(series: Array) -> tuple[Array, Array]:
    """Return the angles at which monotone stretches of a motion begin and end, the last one a turn after the first."""
    turns = turning_points(series)
    if not turns.size:
        turns = np.zeros(1)
    return turns, np.append(turns[1:], turns[0] + 2.0 * np.pi)


def crossings(series: Array, level: float) -> Array:
    """Return the angles at which monotone stretches of a motion cross a level, in their order."""
    begin, end = stretches(series)
    harmonics = series.size // 2
    before, after = basis(begin, harmonics) @ series > level, basis(end, harmonics) @ series > level
    crossed = before != after
    return roots(series, begin[crossed], end[crossed], level)
