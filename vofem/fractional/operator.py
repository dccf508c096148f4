"""The variable-order Riemann-Liouville operator on functions (Definition 1), given by samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, choice, flag
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.fractional.frozen import METHODS, check, frozen
from vofem.fractional.laws import OrderLaw, orders_at
from vofem.fractional.linear import piecewise_linear
from vofem.fractional.sampled import History, Sampled, Samples, before, sampled

Method = Literal["cq", "gl", "l1"]

#: Powers of time for which convolution quadrature is made exact where a caller names none. The square costs two orders
#: of accuracy where a function begins like a root, but without it the first values of orders near 2 do not converge.
LOW, HIGH = (0.0, 1.0), (0.0, 1.0, 2.0)


def rl_derivative(
    samples: Samples,
    t: ArrayLike,
    order: ArrayLike | OrderLaw,
    method: Method = "cq",
    *,
    reading: Literal["frozen", "outside"] = "frozen",
    history: History | None = None,
    start: Sequence[float] | None = None,
    fast: bool = True,
) -> Array:
    """Return the Riemann-Liouville derivative of g at the times t, from the lower limit ``t[0]``.

    Parameters
    ----------
    samples : array_like of shape (n,), number, or callable
        g at the times t; a number is a constant, a callable is called with t.
    t : array_like, shape (n,)
        Increasing times in s, equally spaced unless ``method="l1"``.
    order : number, array_like of shape (n,), or callable of t
        The order, within [0, 2]; at most 1 for ``method="l1"``. See `vofem.fractional.laws`.
    method : {"cq", "gl", "l1"}
        "cq": convolution quadrature of the second-order backward differences
        with starting weights; second order in the step. "gl": Grünwald and
        Letnikov; first order. "l1": g taken as linear between samples; order
        ``2 - order``, on any grid.
    reading : {"frozen", "outside"}
        The meaning of an order that varies in time. With "frozen" the operator
        at each time has the order of that time, as in Eq. 4. With "outside" the
        derivative in front of the integral acts on the order too, as Definition 1
        is printed. Both agree if the order is constant.
    history : (times, samples), optional
        Values of g on ``[a0, t[0]]``, on a grid of their own, linear between
        samples. They add the derivative of the initialisation function psi
        (Eq. 2), which moves the lower limit to a0.
    start : sequence of float, optional
        Exponents of the powers of ``t - t[0]`` with which g begins. "cq" is made
        exact for them. The default is (0, 1), and (0, 1, 2) for derivatives of an
        order above 1. For a function that begins like ``(t - a)^0.5`` use
        (0, 0.5, 1).
    fast : bool
        Whether sums are computed by Fourier transforms in ``O(n log n)``, with
        rounding relative to the largest sample, or directly in ``O(n^2)``.

    Returns
    -------
    ndarray, shape (n,)
        The derivative in the unit of g divided by s^order. The value at ``t[0]`` is the limit: infinite where g does
        not begin at zero and the order is not an integer; NaN where samples cannot decide (orders between 1 and 2,
        ``g[0] = 0``).

    Raises
    ------
    ArgumentError
        For samples or times that are not finite, do not match, are too few
        or not increasing, orders outside the range, or a grid that the
        method does not take.

    Notes
    -----
    Integer orders give derivatives by backward differences of the accuracy of
    the method. The last term of Eq. 1, ``psi(h, m, a0, a, t)``, has the factor
    ``1/Gamma(-m)`` and vanishes.

    References
    ----------
    .. [1] C. Lubich, Discretized fractional calculus, SIAM J. Math. Anal. 17
       (1986), doi:10.1137/0517050 (convolution quadrature, starting weights).
    .. [2] K. Oldham, J. Spanier, The Fractional Calculus (1974) (L1).
    """
    reading = choice("reading", reading, ("frozen", "outside"))  # type: ignore[assignment]
    operator = _Operator(samples, t, order, method, history, start, fast, derivative=True)
    orders = operator.orders
    derivative = operator.at(orders)
    if reading == "frozen" or np.all(orders == orders[0]):
        return derivative
    # The bracket of Definition 1 is F(t, b(t)), F(t, b) = (derivative of order b - m of g)(t), and its derivatives
    # in t at constant b are again such operators. What remains are differences in b at constant t.
    earlier, later, first, second = _neighbours(operator.function.t, orders)
    m = np.maximum(1, np.ceil(orders)).astype(int)
    operator.start = operator.start if start is not None else LOW
    extra = m[1:] * sum(w[1:] * operator.at(b - 1.0)[1:] for w, b in zip(first, (earlier, orders, later), strict=True))
    if np.any(m == 2):
        curved = sum(w[1:] * operator.at(b - 2.0)[1:] for w, b in zip(second, (earlier, orders, later), strict=True))
        extra = np.where(m[1:] == 2, extra + curved, extra)
    derivative[1:] += extra
    return derivative


def rl_integral(
    samples: Samples,
    t: ArrayLike,
    order: ArrayLike | OrderLaw,
    method: Method = "cq",
    *,
    history: History | None = None,
    start: Sequence[float] | None = None,
    fast: bool = True,
) -> Array:
    """Return the Riemann-Liouville integral of g at the times t, from the lower limit ``t[0]``.

    An order that varies in time is frozen at each time. Parameters are those
    of `rl_derivative`; "l1" is the product trapezoidal rule, of second order
    on any grid, for all orders.

    Returns
    -------
    ndarray, shape (n,)
        The integral in the unit of g times s^order. It is 0 at ``t[0]`` without history, and g itself if the order is
        0.

    Raises
    ------
    ArgumentError
        In the same cases as for `rl_derivative`.
    """
    operator = _Operator(samples, t, order, method, history, start, fast, derivative=False)
    return operator.at(-operator.orders)


class _Operator:
    """Checked arguments, and the operator at frozen orders, negative for integrals."""

    def __init__(
        self,
        samples: Samples,
        t: ArrayLike,
        order: ArrayLike | OrderLaw,
        method: str,
        history: History | None,
        start: Sequence[float] | None,
        fast: bool,
        *,
        derivative: bool,
    ) -> None:
        self.method = choice("method", method, METHODS)
        self.fast = flag("fast", fast)
        self.function = sampled(samples, t)
        highest = 1.0 if derivative and self.method == "l1" else 2.0
        self.orders = orders_at(order, self.function.t, highest=highest)
        if start is None:
            start = HIGH if derivative and np.max(self.orders) > 1.0 else LOW
        exponents = array("start", start)
        if exponents.ndim != 1 or np.any(exponents < 0.0) or len(set(exponents)) < len(exponents):
            raise ArgumentError(f"start is {start!r}, expected different exponents, none negative")
        self.start: Sequence[float] = exponents.tolist()
        self.history = before(history, float(self.function.t[0]))
        check(self.function, self.method, self.start)
        if self.history is not None:
            check(self.history, self.method, self.start, "history samples")

    def at(self, orders: Array) -> Array:
        """Return the derivative of order ``orders[n]`` at ``t[n]``, history included."""
        result = frozen(self.function, orders, self.method, self.start, self.fast)
        if self.history is not None:
            t, past = self.function.t, self.history
            result[1:] += piecewise_linear(past.t, past.values, t[1:], orders[1:], ends=True)
            result[0] = self._joint(past, float(orders[0]))
        return result

    def _joint(self, past: Sampled, order: float) -> float:
        """Return the value at the lower limit: that of the history at its end, or infinite where g jumps there."""
        jump = float(self.function.values[0] - past.values[-1])
        if order > 0.0 and abs(jump) > 1e-12 * np.max(np.abs(past.values)):
            return float(np.copysign(np.inf, jump if order <= 1.0 else -jump))
        return float(frozen(past, np.full(past.t.shape, order), self.method, self.start, self.fast)[-1])


def _neighbours(t: Array, orders: Array) -> tuple[Array, Array, tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """Return orders one sample earlier and later, and the weights of first and second differences over the three.

    Beyond the last time the order continues on the polynomial through the last four, not further than it ranges
    within; what is said of the first time is not used.
    """
    after = 2.0 * t[-1] - t[-2]
    x, y = t[-4:], orders[-4:]
    share = [np.prod([(after - x[j]) / (x[k] - x[j]) for j in range(len(x)) if j != k]) for k in range(len(x))]
    lowest, highest = float(np.min(orders)), float(np.max(orders))
    last = np.clip(np.dot(share, y), 2.0 * lowest - highest, min(2.0 * highest - lowest, 2.0))
    steps = np.diff(t, prepend=2.0 * t[0] - t[1], append=after)
    back, ahead = steps[:-1], steps[1:]
    span = back + ahead
    first = (-ahead / (back * span), (ahead - back) / (back * ahead), back / (ahead * span))
    second = (2.0 / (back * span), -2.0 / (back * ahead), 2.0 / (ahead * span))
    return np.append(orders[0], orders[:-1]), np.append(orders[1:], last), first, second
