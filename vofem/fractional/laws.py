"""Order laws: the order of an operator as a function of time or of a state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number, wrong
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.fractional.constants import gap_function
from vofem.fractional.orders import exponential_order
from vofem.parameters import Numbers, declared, rule


class OrderLaw(Protocol):
    """A callable that returns orders, shape (n,), at times or states x, shape (n,). Any such callable will do."""

    def __call__(self, x: Array, /) -> ArrayLike:
        """Return the orders at x."""


@dataclass(frozen=True)
class ConstantOrder:
    """A constant order.

    Parameters
    ----------
    value : float
        The order or orders, not negative.
    """

    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", number("ConstantOrder: value", self.value, minimum=0.0))

    def __call__(self, x: ArrayLike) -> Array:
        """Return the order at x, of the shape of x."""
        return np.full(np.shape(x), self.value)


@dataclass(frozen=True)
class ExponentialOrder:
    """The order ``exp(-s0 s)`` of Eq. 5. It tends to 0 for s > 0, is 1 at s = 0, and tends to infinity for s < 0.

    Parameters
    ----------
    s0 : float
        Scaling factor in 1/m, positive; `scaling_factor` computes one.
    gap : callable, optional
        The gap function s in m, as a function of time or of a state, of arrays.
        Without it the law is called with s itself.
    """

    s0: float
    gap: Callable[[Array], ArrayLike] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "s0", number("ExponentialOrder: s0", self.s0, positive=True, finite=False))
        if self.gap is not None and not callable(self.gap):
            raise ArgumentError(f"ExponentialOrder: gap is {self.gap!r}, expected a function of time or state")

    def __call__(self, x: ArrayLike) -> Array:
        """Return the order at x, of the shape of x; inf where it is beyond the range of doubles."""
        s = gap_function("ExponentialOrder: x", x)
        if self.gap is not None:
            s = gap_function("ExponentialOrder: the gap function", self.gap(s))
        return exponential_order(s, self.s0)


@declared(frozen=True, eq=False)
class TabulatedOrder:
    """A table of orders over time or state, linear between its points and constant beyond its ends."""

    x: Annotated[Array, Numbers("", "Times or states, increasing.")] = field(repr=False)
    orders: Annotated[Array, Numbers("", "The order or orders, not negative.")] = field(repr=False)

    @rule("x", "orders")
    def _in_order(self) -> None:
        x, orders = self.x, self.orders
        if x.ndim != 1 or not len(x) or orders.shape != x.shape:
            raise ArgumentError(
                f"TabulatedOrder: x has shape {x.shape} and orders {orders.shape}, expected one dimension of one length"
            )
        if np.any(np.diff(x) <= 0.0):
            k = int(np.argmax(np.diff(x) <= 0.0))
            raise wrong("TabulatedOrder: x", f"{x[k]:g} and then {x[k + 1]:g}", "increasing values")
        if np.any(orders < 0.0):
            raise ArgumentError(f"TabulatedOrder: orders hold {np.min(orders):g}, expected none below 0")

    def __call__(self, x: ArrayLike) -> Array:
        """Return the order at x, of the shape of x."""
        return np.interp(gap_function("TabulatedOrder: x", x), self.x, self.orders)


def orders_at(order: ArrayLike | OrderLaw, t: Array, *, highest: float = 2.0) -> Array:
    """Return the orders at times t, shape (n,); raise `ArgumentError` unless they lie in [0, highest].

    `order` has shape (n,).
    `t` has shape (n,).
    `highest`: 2 for the operators on functions, 1 for histories of springpots.
    """
    given = order(t) if callable(order) else order
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(f"order is {given!r}, expected a number, one per time, or a function of time") from None
    if values.ndim and values.shape != t.shape:
        raise ArgumentError(f"order has shape {values.shape}, expected a number or one per time, {t.shape}")
    bad = ~((values >= 0.0) & (values <= highest))
    if np.any(bad):
        k = int(np.argmax(bad))
        at = f" at t = {t[k]:g}" if values.ndim else ""
        raise ArgumentError(
            f"order is {values.flat[k]:g}{at}, expected a number from 0 to {highest:g}"
            " (exp(-s0 s) exceeds any bound for s < 0: use resolved or ideal for constants, or limit the order)"
        )
    return np.broadcast_to(values, t.shape)
