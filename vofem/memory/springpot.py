"""The law of a springpot as data: a force proportional to a fractional derivative of the elongation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError, VofemError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpringpotLaw:
    """``R = coefficient D^order u`` on a row; the force on the structure is ``-b R``.

    D is Caputo's derivative from t = 0: the system was at rest before, in
    whatever place. An order that varies is frozen at the present.

    Attributes
    ----------
    label : str
        Class and name, for messages.
    name : str
    coefficient : float
        In N s^order/m.
    order : float or callable
        In [0, 1]; a callable takes times in s, shape (n,), and returns orders.
    """

    label: str
    name: str
    coefficient: float
    order: float | Callable[[Array], Any]

    @property
    def varies(self) -> bool:
        """Whether the order is a function of time."""
        return callable(self.order)

    def orders(self, t: Array) -> Array:
        """Return the orders at times in s, shape (n,).

        Raises
        ------
        ArgumentError
            If a callable raises, or returns anything but numbers from 0 to 1.
        """
        from vofem.fractional.laws import orders_at

        try:
            return orders_at(self.order, t, highest=1.0)
        except ArgumentError as error:
            raise ArgumentError(f"{self.label}: {error}") from None
        except VofemError:
            raise
        except Exception as error:
            raise ArgumentError(
                f"{self.label}: order raised {type(error).__name__}: {error} at times from {t[0]:g} to {t[-1]:g} s; it "
                "must take an array of times in s and return as many numbers from 0 to 1"
            ) from error
