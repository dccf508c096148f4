# mypy: disable-error-code="no-any-return"
"""The resolved switch of the variable-order operator: its stiffness, and integrals that are exact to rounding.

With ``x = s0 s`` the contact stiffness over K0 is ``1/Gamma(1 - exp(-x))``,
an entire function of x that is 1 to rounding beyond x = 40. Its integrals
over panels of unit length are tabulated once. Within a panel they are computed
by Gauss's rule, so that differences of the potential over short steps keep all digits.
`vofem.fractional.resolved` is the operator on arrays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.kernels.jit import jit
from vofem.laws.law import DAMPING, FORCE, JUMP, KINK, MEAN, STORED, TANGENT

#: Argument of the resolved switch, in units of 1/s0, from which on it is 1 to rounding; nodes of its table per unit.
_END = 40
_PER_UNIT = 2
#: Places at which the rise of the switch is divided for quadrature, in units of 1/s0.
_RISE = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0])
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@jit
def switch(x: float) -> float:
    """Return ``1/Gamma(1 - exp(-x))`` for x > 0, else 0."""
    if x <= 0.0:
        return 0.0
    if x >= _END:
        return 1.0
    rise = -math.expm1(-x)
    # 1/Gamma(r) is r where the gamma function itself would overflow.
    return 1.0 / math.gamma(rise) if rise > 1e-150 else rise


def _table() -> Array:
    """Return the integrals of 1 and x times the switch from 0 to every panel's edge, shape (2, n_edges)."""
    width = 1.0 / _PER_UNIT
    left = np.arange(_END * _PER_UNIT) * width
    x = left[:, None] + 0.5 * width * (1.0 + _NODES)
    plain = switch.py_func  # type: ignore[attr-defined]
    value = 0.5 * width * np.array([plain(one) for one in x.ravel().tolist()]).reshape(x.shape)
    parts = np.stack([value @ _WEIGHTS, (value * x) @ _WEIGHTS])
    return np.concatenate([np.zeros((2, 1)), np.cumsum(parts, axis=1)], axis=1)


_TABLE = _table()


@jit
def resolved_force(s: float, s0: float, lever: float) -> tuple[float, float]:
    """Return ``k(s) (s + lever)`` of unit stiffness and its derivative by s, for s > 0."""
    x = s0 * s
    level = switch(x)
    if x >= _END:
        return s + lever, 1.0
    # The slope is only used in an iteration, so a difference quotient is accurate enough.
    width = 1e-6 * max(x, 1e-6)
    slope = s0 * (switch(x + width) - switch(max(x - width, 0.0))) / (x + width - max(x - width, 0.0))
    return level * (s + lever), level + slope * (s + lever)


@jit
def _within(a: float, b: float) -> tuple[float, float]:
    """Integrate over part of a panel by Gauss's rule."""
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    plain, lever = 0.0, 0.0
    for i in range(_NODES.size):
        x = middle + half * _NODES[i]
        value = _WEIGHTS[i] * switch(x)
        plain += value
        lever += value * x
    return half * plain, half * lever


@jit
def _rising(a: float, b: float) -> tuple[float, float]:
    """Integrate 1 and x times the switch from a to b, 0 <= a <= b."""
    if a >= _END:
        return b - a, 0.5 * (b - a) * (a + b)
    extra, extra_lever = 0.0, 0.0
    if b > _END:
        extra, extra_lever = b - _END, 0.5 * (b - _END) * (b + _END)
        b = float(_END)
    first, last = int(a * _PER_UNIT), int(b * _PER_UNIT)
    if first == last or (last - first == 1 and b * _PER_UNIT == last):
        plain, lever = _within(a, b)
        return plain + extra, lever + extra_lever
    head = _within(a, (first + 1) / _PER_UNIT)
    tail = _within(last / _PER_UNIT, b)
    plain = head[0] + (_TABLE[0, last] - _TABLE[0, first + 1]) + tail[0]
    lever = head[1] + (_TABLE[1, last] - _TABLE[1, first + 1]) + tail[1]
    return plain + extra, lever + extra_lever


@jit
def resolved_contact(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for a contact of p = (gap, offset, K0, C0, s0); see `law`."""
    gap, lever, k, resolution = p[0], p[0] - p[1], p[2], p[4]
    s = u1 - gap
    if what == KINK:
        number = int(u1)
        return gap + _RISE[number] / resolution if number < _RISE.size else np.nan
    if what == JUMP:
        return 0.0
    x0, x = resolution * (u0 - gap), resolution * s
    if what in (MEAN, DAMPING) and x0 != x:
        if x0 <= 0.0 and x <= 0.0:
            return 0.0
        # Divided by the length in s, a path of a few roundings would have a mean far from the force on it.
        low, high = min(x0, x), max(x0, x)
        plain, weighted = _rising(max(low, 0.0), high)
        if what == DAMPING:
            return p[3] * (plain / (high - low))
        return k * ((weighted / resolution + lever * plain) / (high - low))
    if s <= 0.0:
        return 0.0
    if what == DAMPING:
        return p[3] * switch(x)
    if what == STORED:
        plain, weighted = _rising(0.0, x)
        return k * (weighted / resolution + lever * plain) / resolution
    if what in (FORCE, MEAN):
        return k * resolved_force(s, resolution, lever)[0]
    if what == TANGENT:
        return k * resolved_force(s, resolution, lever)[1]
    return 0.0


def steepest(gap: float, jump: bool, s0: float) -> float:
    """Return a bound of the slope of ``R/K0`` over penetration of a closed contact."""
    if np.isinf(s0):
        return 1.0
    from scipy.special import digamma, gamma

    x = np.logspace(-8, 2, 4001)
    rise = -np.expm1(-x)
    level = 1.0 / gamma(rise)
    slope = -digamma(rise) / gamma(rise) * np.exp(-x)
    lever = x + (s0 * gap if jump else 0.0)
    return 1.01 * float(np.max(level + lever * slope))
