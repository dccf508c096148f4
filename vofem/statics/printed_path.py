"""Eq. 25 of the paper along a path of loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import LimitLoadError
from vofem.laws import PrintedLaw

Array = NDArray[np.float64]


def limit_reached(law: PrintedLaw, load: float, time: float, when: str) -> LimitLoadError:
    """Return the error for a load at or beyond the limit load."""
    return LimitLoadError(
        f"{law.label}: the load reaches {load:.6g} N at {when}, and the spring carries less than {law.limit:.6g} N: "
        "there its secant stiffness falls to zero, and no equilibrium exists. Load it less, or change its softening",
        load, time, law.limit,
    )  # fmt: skip


def printed_path(law: PrintedLaw, forces: Array, factors: Array) -> Array:
    """Return the elongations of Eq. 25 under applied forces in N, shape (n_factors,), from the unloaded state on.

    While the force is held, the sign of its rate stays what it was before. The
    supremum in Eq. 25 is taken over the path since the unloaded state.

    Raises
    ------
    LimitLoadError
        Where the secant stiffness is not positive.
    """
    elongation = np.empty(forces.size)
    before, rising, top, force_at_top = 0.0, True, 0.0, 0.0
    for n, force in enumerate(forces.tolist()):
        if force != before:
            rising = force > before
        linear = force / law.stiffness
        if not rising:
            # Operator 3 acts: the residual elongation.
            xi = linear + (top - force_at_top / law.stiffness)
        elif abs(linear) <= law.linear_limit:
            xi = linear
        else:
            secant = 1.0 - law.level(abs(force))
            if not (secant > 0.0 and abs(force) < law.limit):
                raise limit_reached(law, force, float(factors[n]), f"load factor {factors[n]:g}")
            xi = linear / secant
        if xi > top:
            top, force_at_top = xi, force
        elongation[n], before = xi, force
    return elongation
