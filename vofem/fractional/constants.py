"""The operator applied to a constant (Eqs. 4-8), as three named laws.

The order of the operator is frozen at the present time. Definition 1 of the paper
has a time derivative in front of the integral. With an order that varies, this
derivative would add an impulse whenever a contact closes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, number
from vofem.arrays import Array
from vofem.errors import ArgumentError

#: Beyond this order neighbouring doubles are integers apart, and the sign of the literal formula is lost.
_UNRESOLVED = 2.0**52


def gap_function(what: str, s: ArrayLike) -> Array:
    """Return values of a gap function, which may be infinite; raise `ArgumentError` for a NaN or another type."""
    try:
        values = np.asarray(s, dtype=float)
    except (TypeError, ValueError):
        raise ArgumentError(f"{what} is {s!r}, expected an array of numbers") from None
    if np.any(np.isnan(values)):
        # `nan > 0` is False, so a NaN would silently open a contact.
        number(what, float("nan"))
    return values


def ideal(C0: ArrayLike, s: ArrayLike) -> Array:
    """Return C0 where ``s > 0``, else 0 (Eq. 8: the limit along integer orders).

    Parameters
    ----------
    C0 : array_like
        The constant, finite.
    s : array_like
        Gap function in m, of a shape that broadcasts with C0; infinity is allowed.

    Raises
    ------
    ArgumentError
        For a NaN, or a constant that is not finite.
    """
    return np.where(gap_function("the gap function s", s) > 0.0, array("C0", C0), 0.0)


def resolved(C0: ArrayLike, s: ArrayLike, s0: float, tau: float = 1.0) -> Array:
    """Return ``C0 tau^-beta / Gamma(1 - beta)``, ``beta = exp(-s0 s)``, for s > 0; exactly 0 elsewhere.

    The result is smooth and monotone in s, and lies within [0, C0] at the default ``tau = 1``.

    Parameters
    ----------
    C0 : array_like
        The constant, finite.
    s : array_like
        Gap function in m, of a shape that broadcasts with C0; infinity is allowed.
    s0 : float
        Scaling factor in 1/m.
    tau : float
        Time divided by a reference time. At the default of 1 the law has a potential.

    Raises
    ------
    ArgumentError
        For a NaN, a constant that is not finite, or s0 or tau not positive.
    """
    from scipy.special import rgamma

    s0 = number("s0", s0, positive=True)
    tau = number("tau", tau, positive=True)
    s, C0 = gap_function("the gap function s", s), array("C0", C0)
    with np.errstate(over="ignore", under="ignore"):
        x = s0 * np.maximum(s, 0.0)
        # 1 - beta as -expm1: the naive difference loses all digits near closing.
        value = rgamma(-np.expm1(-x)) * tau ** -np.exp(-x)
        return np.where(s > 0.0, C0 * value, 0.0)


def literal(C0: ArrayLike, s: ArrayLike, s0: float, t: ArrayLike) -> tuple[Array, Array]:
    """Return sign and natural logarithm of the magnitude of Eq. 4 as printed, at order ``exp(-s0 s)``.

    For s < 0 it alternates in sign and grows without bound, far beyond the range
    of double precision. It serves to study the equation, and is not suitable for simulations.

    Parameters
    ----------
    C0 : array_like
        The constant, finite.
    s : array_like
        Gap function in m; infinity is allowed.
    s0 : float
        Scaling factor in 1/m.
    t : array_like
        Time in s since the lower limit, positive. C0, s and t broadcast.

    Returns
    -------
    sign, log_magnitude : ndarray
        They are never NaN. Where the value is exactly zero (integer orders) the
        sign is 0 and the logarithm is -inf. Where the order is above 2**52 the
        sign cannot be computed in double precision. It is then 0, and the
        logarithm is that of the envelope ``C0 Gamma(beta) t^-beta / pi``, or inf
        if that overflows.

    Raises
    ------
    ArgumentError
        For a NaN, a constant that is not finite, or s0 or t not positive.
    """
    s0 = number("s0", s0, positive=True)
    C0, t, s = array("C0", C0), array("t", t), gap_function("the gap function s", s)
    if not np.all(t > 0.0):
        raise ArgumentError(f"t holds {np.min(t):g}, expected positive times since the lower limit")
    with np.errstate(over="ignore", under="ignore", divide="ignore"):
        sign, log = _unit(-s0 * s, np.log(t))
        log = log + np.log(np.where(C0 == 0.0, 1.0, np.abs(C0)))
    return np.sign(C0) * sign + 0.0, np.where(C0 == 0.0, -np.inf, log)


def _unit(y: Array, log_t: Array) -> tuple[Array, Array]:
    """Return sign and logarithm of ``t^-beta / Gamma(1 - beta)``, ``beta = exp(y)``."""
    from scipy.special import gammaln

    y, log_t = np.broadcast_arrays(y, log_t)
    beta, rise = np.exp(y), -np.expm1(y)
    known = np.minimum(beta, _UNRESOLVED)
    # Reflection: 1/Gamma(1 - beta) = Gamma(beta) sin(pi beta) / pi, with the distance to the next integer exact.
    whole = np.rint(known)
    near_one = np.abs(rise) <= 0.5
    distance = np.where(near_one, rise, known - whole)
    odd = ~near_one & (np.mod(whole, 2.0) == 1.0)
    wave = np.where(odd, -1.0, 1.0) * np.sin(np.pi * distance)
    small, lost = beta < 0.5, beta >= _UNRESOLVED
    inner = gammaln(np.where(small, 1.0, known)) + np.log(np.abs(wave) / np.pi) - known * log_t
    # Stirling with the factor beta in front: the terms overflow where their difference does not.
    far = np.where(lost, np.minimum(y, 1e300), 1.0)
    outer = np.where(lost, beta, 1.0) * (far - 1.0 - log_t) + 0.5 * (np.log(2.0 / np.pi) - far)
    log = np.where(small, -gammaln(np.where(small, rise, 1.0)) - known * log_t, np.where(lost, outer, inner))
    sign = np.where(small, 1.0, np.where(lost, 0.0, np.sign(wave)))
    return sign, log
