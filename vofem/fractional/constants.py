"""The operator applied to a constant (Eqs. 4-8), as three named laws.

The operator is the one with the order frozen at the present time. Definition
1 of the paper keeps a time derivative outside the integral; with an order
that varies it would add an impulse at every closing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import number

Array = NDArray[np.float64]


def _finite(s: ArrayLike) -> Array:
    s = np.asarray(s, dtype=float)
    if np.any(np.isnan(s)):
        # `nan > 0` is False, so a NaN would silently open a contact.
        number("the gap function s", float("nan"))
    return s


def ideal(C0: ArrayLike, s: ArrayLike) -> Array:
    """Return C0 where ``s > 0``, else 0 (Eq. 8: the limit along integer orders)."""
    return np.where(_finite(s) > 0.0, np.asarray(C0, dtype=float), 0.0)


def resolved(C0: ArrayLike, s: ArrayLike, s0: float, tau: float = 1.0) -> Array:
    """Return ``C0 tau^-beta / Gamma(1 - beta)``, ``beta = exp(-s0 s)``, for s > 0; exactly 0 elsewhere.

    Smooth and monotone in s, and within [0, C0] at the default ``tau = 1``.

    Parameters
    ----------
    C0 : array_like
        The constant.
    s : array_like
        Gap function in m.
    s0 : float
        Scaling factor in 1/m.
    tau : float
        Time over reference time; frozen at 1, where the law has a potential.
    """
    from scipy.special import rgamma

    s0 = number("s0", s0, positive=True)
    tau = number("tau", tau, positive=True)
    s = _finite(s)
    x = s0 * np.maximum(s, 0.0)
    # 1 - beta as -expm1: the naive difference loses all digits near closing.
    value = rgamma(-np.expm1(-x)) * tau ** -np.exp(-x)
    return np.where(s > 0.0, np.asarray(C0, dtype=float) * value, 0.0)


def literal(C0: float, s: ArrayLike, s0: float, t: float) -> tuple[Array, Array]:
    """Return sign and natural logarithm of the magnitude of Eq. 4 as printed, at order ``exp(-s0 s)``.

    For s < 0 it alternates in sign and grows without bound, far beyond the
    range of double precision: to look at, never to simulate with.

    Returns
    -------
    sign, log_magnitude : ndarray
        sign 0 and -inf where the value is exactly zero; NaN in both where the
        order itself overflows.
    """
    from scipy.special import gammaln

    C0 = number("C0", C0)
    s0 = number("s0", s0, positive=True)
    t = number("t", t, positive=True)
    s = _finite(s)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        beta = np.exp(-s0 * s)
        # Reflection: 1/Gamma(1 - beta) = Gamma(beta) sin(pi beta) / pi.
        wave = np.sin(np.pi * np.mod(beta, 2.0))
        wave = np.where(np.mod(beta, 1.0) == 0.0, 0.0, wave)
        small = beta < 0.5
        upper = -np.expm1(-s0 * s)
        log = np.where(small, -gammaln(np.where(small, upper, 1.0)), gammaln(beta) + np.log(np.abs(wave) / np.pi))
        log = log - beta * np.log(t) + np.log(abs(C0))
        sign = np.sign(C0) * np.where(small, 1.0, np.sign(wave))
        lost = ~np.isfinite(beta) | (beta > 2.0**52)
    return np.where(lost, np.nan, sign), np.where(lost, np.nan, np.where(sign == 0.0, -np.inf, log))
