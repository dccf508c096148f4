"""The order of the operator as a function of the gap function, and its scaling factor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number
from vofem.arrays import Array
from vofem.errors import ArgumentError


def exponential_order(s: ArrayLike, s0: float) -> Array:
    """Return the order ``beta = exp(-s0 s)`` of Eq. 5, which tends to 0 for s > 0 and to infinity for s < 0.

    Parameters
    ----------
    s : array_like
        Gap function in m.
    s0 : float
        Scaling factor in 1/m, positive; inf gives the limit: 0, 1 or inf.
    """
    s0 = number("s0", s0, positive=True, finite=False)
    s = np.asarray(s, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        exponent = np.where(s == 0.0, 0.0, -s0 * s)
        return np.exp(exponent)


def scaling_factor(gap: float, resolution: float = 0.01, delta: float = 1e-3) -> float:
    """Return the smallest scaling factor s0 of section 4.1: ``ln(1/delta) / (resolution * gap)``.

    Parameters
    ----------
    gap : float
        The gap in m, positive.
    resolution : float
        P0, the fraction of the gap within which the switch takes place.
    delta : float
        The order at the end of this range, below 1.

    Returns
    -------
    float
        The scaling factor in 1/m. The paper's masses (gap 5 m) give 138.2, which it rounds up to 1e3.
    """
    gap = number("gap", gap, positive=True)
    resolution = number("resolution", resolution, positive=True)
    delta = number("delta", delta, positive=True)
    if not delta < 1.0:
        raise ArgumentError(f"delta is {delta:g}, expected a number between 0 and 1")
    return float(np.log(1.0 / delta) / (resolution * gap))
