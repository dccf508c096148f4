"""The midpoint rule with a discrete gradient for every scalar law.

Order 2 in dt for smooth systems and for contacts that act on the penetration;
where a force jumps within a step its work is exact and its moment is not: order
2 on masses, 1 where the jump rings in a beam. Stable for every dt and every
stiffness: no energy is made or lost, whatever the step, and with damping it
falls by exactly what the dampers take. No numerical dissipation, so fast
motion that the step does not resolve stays, with its frequency lowered to
less than ``pi/dt``. With the mean velocity ``p = (v_0 + v_1)/2`` of a step,

    (M + dt C/2 + dt^2 K/4) p = M v_0 + dt/2 (f_m - K q_0 - sum_j b_j R_j),
    q_1 = q_0 + dt p,    v_1 = 2p - v_0,    R_j = (V_j(u_1) - V_j(u_0)) / (u_1 - u_0),

u the law's coordinate and f_m the load at mid-step. Reactions are found in
the contact coordinates, always (`stepping.contact_solve`); the matrix is factored once.
The equation is solved for the correction of an extrapolated p, twice where that is
large: errors of the factored matrix would work in one direction for ever.

O. Gonzalez, Exact energy and momentum conserving algorithms for general models in nonlinear elasticity,
Comput. Methods Appl. Mech. Eng. 190 (2000) 1763-1783, https://doi.org/10.1016/S0045-7825(00)00189-4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows
from vofem.integrators.energy_conserving.adaptive import AdaptiveSteps
from vofem.integrators.energy_conserving.fixed import FixedSteps
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.observer import Observer, Snapshot
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.implicit import Asked, Doubled, implicit_run
from vofem.system import Counters, State, System

Array = NDArray[np.float64]

#: Energy that no load has supplied, over the largest energy, that ends a run: rounding cannot make so much.
_BLOW_UP = 1e-3


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
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end; `Method` describes the arguments.

    Raises
    ------
    ConvergenceError
        If a nonlinear spring that softens leaves a step without a solution.
    """

    def equal(counters: Counters, begin: State, dt: float, steps: int) -> FixedSteps:
        kernel = FixedSteps(system, begin, counters, t_end)
        kernel.plan(dt, steps)
        return kernel

    made = Doubled(equal, lambda counters: AdaptiveSteps(system, start, counters, t_end))
    asked = Asked(system, start, t_end, times, dt, tol, observer, resume, probes, nearby)
    return implicit_run(ENERGY_CONSERVING, made, asked, _BLOW_UP, "; any dt is stable, tol= chooses by error")
