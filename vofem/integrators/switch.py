"""The variable-order switch in compiled form: from gap function to order to contact stiffness."""

from __future__ import annotations

import math

import numpy as np

from vofem.linalg.jit import jit


@jit
def contact_order(s: float, s0: float) -> float:
    """Return the order beta of the operator (Eqs. 5, 6): 0 closed and inf open for the ideal switch."""
    if s0 == np.inf:
        return 0.0 if s > 0.0 else np.inf
    return np.exp(-s0 * s)


@jit
def contact_stiffness(stiffness: float, s: float, s0: float) -> float:
    """Return K_eq, the operator of order beta applied to the constant K0 (Eqs. 8, 12a, 17)."""
    if s0 == np.inf:
        return stiffness if contact_order(s, s0) == 0.0 else 0.0
    if s <= 0.0:
        return 0.0
    rise = -np.expm1(-s0 * s)
    # 1/Gamma(x) is x where the gamma function itself would overflow.
    return stiffness / math.gamma(rise) if rise > 1e-150 else stiffness * rise


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
