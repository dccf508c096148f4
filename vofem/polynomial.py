"""Polynomials in x, for coefficients and initial fields. Unlike other callables they can be written to scene files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, public
from vofem.errors import ArgumentError


@dataclass(frozen=True)
class Polynomial:
    """``a0 + a1 x + a2 x^2 + ...``, a callable of x.

    Parameters
    ----------
    coefficients : sequence of float
        a0, a1, ...; at least one. The unit of a0 is that of the quantity, x is in m.

    Raises
    ------
    ArgumentError
        If a coefficient is not a finite number, or there is none.
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        values = array("Polynomial: coefficients", self.coefficients)
        if values.ndim != 1 or not values.size:
            raise ArgumentError(f"Polynomial: coefficients has shape {values.shape}, expected (n,) with n at least 1")
        object.__setattr__(self, "coefficients", tuple(values.tolist()))

    def __call__(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return the values at x, in the shape of x."""
        x = np.asarray(x, dtype=float)
        result = np.full(x.shape, self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            result = result * x + coefficient
        return result


public(Polynomial)
