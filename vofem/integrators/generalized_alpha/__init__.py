"""The generalized-alpha method with contact solved inside the step.

Order 2 in dt for smooth systems and for contacts that act on the penetration,
order 1 where a force jumps within a step. Unconditionally stable for linear
systems; rho_infinity in [0, 1] is the spectral radius at infinite frequency:
1 has no numerical dissipation and is the trapezoidal rule (Newmark's average
acceleration), 0 takes out in one step what the step does not resolve. With
contacts stability is not guaranteed: near ``rho_infinity = 1`` and at
``omega dt >= 1`` of a closed contact energy grows, and the run stops with an error.

    alpha_m = (2 rho - 1)/(rho + 1),  alpha_f = rho/(rho + 1),
    gamma = 1/2 - alpha_m + alpha_f,  beta = (1 - alpha_m + alpha_f)^2/4,
    M a_{1-am} + C v_{1-af} + K q_{1-af} + sum_j b_j R_j,{1-af} = f_{1-af},

every subscript a mean of both ends, ``x_{1-a} = (1 - a) x_1 + a x_0``. Newmark's
method is alpha_m = alpha_f = 0 and Hilber, Hughes and Taylor's is alpha_m = 0:
give ``alpha_m``, ``alpha_f``, ``gamma`` and ``newmark_beta`` to reach them.
The accelerations ``a`` of the method lag by ``(alpha_f - alpha_m) dt``; those in results are corrected for this lag.
Under the jump law the reaction may lie anywhere in [0, K0 gap] at the gap. A
contact damper and a springpot act by their mean over the step, extrapolated to
the time of balance; where a springpot of an order below some 0.02 is ten
thousand times stiffer than the structure, that may make energy too.

J. Chung, G. M. Hulbert, A time integration algorithm for structural dynamics with improved numerical dissipation:
the generalized-alpha method, J. Appl. Mech. 60 (1993) 371-375, https://doi.org/10.1115/1.2900803.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows
from vofem.integrators.generalized_alpha.adaptive import AdaptiveSteps
from vofem.integrators.generalized_alpha.fixed import FixedSteps
from vofem.integrators.generalized_alpha.parameters import parameters
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.observer import Observer, Snapshot
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.implicit import Asked, Doubled, implicit_run
from vofem.system import Counters, State, System

__all__ = ["parameters", "run"]

Array = NDArray[np.float64]

#: Energy that no load has supplied, over the largest energy, that ends a run.
_BLOW_UP = 1.0


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    observer: Observer | None = None,
    resume: Snapshot | None = None,
    probes: ProbeRows | None = None,
    tol: float | None = None,
    nearby: bool | None = None,
    **options: float,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end; `Method` describes the arguments.

    Parameters
    ----------
    **options
        As `parameters` takes them.

    Raises
    ------
    InstabilityError
        If energy grows beyond what the loads can have done.
    ConvergenceError
        If a nonlinear spring that softens leaves a step without a solution.
    """
    chosen = parameters(**options)

    def equal(counters: Counters, begin: State, dt: float, steps: int) -> FixedSteps:
        kernel = FixedSteps(system, begin, counters, t_end, chosen)
        kernel.plan(dt, steps)
        return kernel

    made = Doubled(equal, lambda counters: AdaptiveSteps(system, start, counters, t_end, chosen))
    asked = Asked(system, start, t_end, times, dt, tol, observer, resume, probes, nearby)
    return implicit_run(GENERALIZED_ALPHA, made, asked, _BLOW_UP)
