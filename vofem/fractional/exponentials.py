"""The kernel ``t^-order / Gamma(1 - order)`` as a sum of exponentials that are the same for all orders in [0, 1].

``t^-a / Gamma(1 - a)`` is ``sin(pi a)/pi`` times the integral of
``exp(a x - t e^x)`` over all x. The trapezoidal rule in x converges
exponentially, and its nodes ``e^x`` do not depend on the order. Infinitely many
nodes lie far below ``1/t_end``, where the exponentials are nearly straight lines.
They are replaced by a few nodes with the same moments; otherwise a small order
would need very many nodes. All weights are positive. The sum therefore describes
springs and dashpots in series, and creates no energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number
from vofem.arrays import Array
from vofem.errors import ArgumentError

#: Smallest error that rounding lets one ask for.
_FLOOR = 1e-12

#: Number of rates that stand for all slow ones, by the largest spacing at which their weights are positive (as a scan
#: over spacings and orders shows): Lobatto's points of Chebyshev's polynomials, zero among them.
_FEW = ((0.62, 5), (0.96, 4), (math.inf, 3))


@dataclass(frozen=True, eq=False)
class Exponentials:
    """Sum of exponentials for t in [dt, t_end].

    Attributes
    ----------
    rates : ndarray, shape (k,)
        Exponents in 1/s; the first ``len(moments)`` stand for all slow ones.
    spacing : float
        Distance of the logarithms of the other rates.
    moments : ndarray, shape (m, m)
        From moments of the slow part to weights at its rates.
    slowest : float
        Lower end of the other rates, in 1/s.
    error : float
        Largest relative error of the kernel, measured over times and orders.
    """

    rates: Array
    spacing: float
    moments: Array
    slowest: float
    error: float = math.nan

    def weights(self, order: ArrayLike) -> Array:
        """Return the weights such that ``weights @ exp(-rates t)`` is the kernel of an order in [0, 1].

        Parameters
        ----------
        order : float or array_like, shape (n,)

        Returns
        -------
        ndarray, shape (k,) or (n, k)
            Not negative.
        """
        a = np.asarray(order, dtype=float)[..., None]
        share, h = _share(a), self.spacing
        # Moments of the slow part about zero; the one that counts its rates has a limit at order 0.
        zero = a == 0.0
        safe = np.where(zero, 0.5, a)
        count = np.where(zero, 1.0, _share(safe) / safe * (safe * h / np.expm1(safe * h)))
        power = np.arange(1.0, len(self.moments))
        rest = share * h * np.exp(power * h) / np.expm1((a + power) * h)
        slow = self.slowest**a * np.maximum(np.concatenate([count, rest], axis=-1) @ self.moments.T, 0.0)
        fast = share * h * self.rates[len(self.moments) :] ** a
        return np.concatenate([slow, fast], axis=-1)

    def faster(self, order: ArrayLike) -> Array:
        """Return sums of weight over rate and over its square, of all rates above `rates`, which go on without end.

        In a time that is long for them their part of the derivative of u is
        ``first u' - second u''``.

        Parameters
        ----------
        order : float or array_like, shape (n,)

        Returns
        -------
        ndarray, shape (2,) or (n, 2)
            In s^(1 - order) and s^(2 - order).
        """
        a, h = np.asarray(order, dtype=float), self.spacing
        next_rate = float(self.rates[-1]) * math.exp(h)
        left = (1.0 - a) * h
        one = left == 0.0
        safe = np.where(one, 1.0, left)
        first = np.where(one, 1.0, np.sinc(1.0 - a) * safe / -np.expm1(-safe)) * next_rate ** (a - 1.0)
        second = _share(a) * h * next_rate ** (a - 2.0) / -np.expm1((a - 2.0) * h)
        return np.stack([first, second], axis=-1)


def _share(a: Array) -> Array:
    """Return ``sin(pi a)/pi``, accurate at both ends."""
    return np.where(a < 0.5, a * np.sinc(a), (1.0 - a) * np.sinc(1.0 - a))


def exponentials(dt: float, t_end: float, tolerance: float = 1e-10) -> Exponentials:
    """Build a sum of exponentials for times from dt to t_end and orders from 0 to 1.

    Parameters
    ----------
    dt, t_end : float
        Shortest and longest time in s.
    tolerance : float
        Largest relative error of the kernel, from 1e-12 to 1e-2.

    Returns
    -------
    Exponentials
        Of ``O(log(t_end/dt) log(1/tolerance))`` terms.

    Raises
    ------
    ArgumentError
        For a tolerance out of reach, or times not positive or not in order.
    """
    dt, t_end = number("dt", dt, positive=True), number("t_end", t_end, positive=True)
    tolerance = number("tolerance", tolerance)
    if not _FLOOR <= tolerance <= 1e-2:
        raise ArgumentError(f"tolerance is {tolerance:g}, expected a number from {_FLOOR:g} to 0.01")
    if not t_end >= dt:
        raise ArgumentError(f"t_end is {t_end:g} s and dt {dt:g} s, expected t_end not below dt")
    aim = tolerance
    while True:
        kernel = _built(dt, t_end, aim)
        error = _measured(kernel, dt, t_end)
        if error <= tolerance:
            return Exponentials(kernel.rates, kernel.spacing, kernel.moments, kernel.slowest, error)
        if aim < 1e-3 * _FLOOR:
            raise ArgumentError(
                f"tolerance {tolerance:g} is out of reach of rounding, the error is {error:g}: ask for more"
            )
        aim *= 0.5


def _built(dt: float, t_end: float, aim: float) -> Exponentials:
    spacing = math.pi**2 / math.log(4.0 / aim)
    few = next(count for largest, count in _FEW if spacing <= largest)
    # exp(-y) by interpolation between 0 and the largest slow rate.
    slowest = 4.0 * (0.025 * aim * math.factorial(few)) ** (1.0 / few) / t_end
    largest_exponent = math.log(1.0 / aim) + 2.0
    count = math.ceil(math.log(largest_exponent / (slowest * dt)) / spacing) + 1
    fast = slowest * np.exp(spacing * np.arange(count))
    points: Array = 0.5 - 0.5 * np.cos(np.arange(few) * np.pi / (few - 1.0))
    moments = np.asarray(np.linalg.inv(np.vander(points, increasing=True).T), dtype=np.float64)
    return Exponentials(np.append(slowest * math.exp(-spacing) * points, fast), spacing, moments, slowest)


def _measured(kernel: Exponentials, dt: float, t_end: float) -> float:
    """Return the largest relative error over orders and times."""
    times = np.geomspace(dt, t_end, 8 * math.ceil(math.log2(t_end / dt) + 1.0))
    table = np.exp(-times[:, None] * kernel.rates)
    worst = 0.0
    for order in (1e-3, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.999):
        exact = times**-order / math.gamma(1.0 - order)
        worst = max(worst, float(np.max(np.abs(table @ kernel.weights(order) / exact - 1.0))))
    return worst
