"""Polynomials in x, for coefficients and initial fields. Unlike other callables they can be written to scene files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array
from vofem.errors import ArgumentError
from vofem.parameters import Numbers, declared


@dataclass(frozen=True)
class Coefficients(Numbers):
    """The coefficients of a polynomial, as a tuple."""

    def check(self, what: str, value: Any) -> Any:
        """Return a tuple of floats."""
        values = array(what, value)
        if values.ndim != 1 or not values.size:
            raise ArgumentError(f"{what} has shape {values.shape}, expected (n,) with n at least 1")
        return tuple(values.tolist())


@declared(frozen=True, bare=True)
class Polynomial:
    """``a0 + a1 x + a2 x^2 + ...``, a callable of x.

    Raises
    ------
    ArgumentError
        If a coefficient is not a finite number, or there is none.
    """

    coefficients: Annotated[
        tuple[float, ...],
        Coefficients("", "a0, a1, ...; at least one. The unit of a0 is that of the quantity, x is in m."),
    ]

    def __call__(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return the values at x, in the shape of x."""
        x = np.asarray(x, dtype=float)
        result = np.full(x.shape, self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            result = result * x + coefficient
        return result
