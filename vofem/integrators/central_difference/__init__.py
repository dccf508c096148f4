"""Central differences: Eq. 21 of the paper in velocity form.

Order 2 in dt for smooth systems and for contacts that act on the penetration;
order 1, or worse, where a force jumps within a step: that of a contact that
acts on the displacement, of a contact damper at closing, of a pulse. Stable for ``dt < 2/omega_max``,
damped or not; no numerical dissipation. With ``v`` at half steps,

    (M + dt C/2) a_n = f_n - K q_n - C v_{n-1/2} - sum_j b_j R_j,
    v_{n+1/2} = v_{n-1/2} + dt a_n,    q_{n+1} = q_n + dt v_{n+1/2},

which is Eq. 21 with C = 0 but loses far fewer digits than its two-step form.
Contact dampers are implicit, through the compliance of the contact rows, and so
are springpots, by the mean of their forces over the steps on both sides: both
only take energy, and leave the critical step as it is. The
kinetic energy reported is ``v_{n-1/2}' M v_{n+1/2} / 2``: with it the scheme
conserves energy to rounding between switches.

N. M. Newmark's family at beta = 0, gamma = 1/2; R. W. Clough, J. Penzien, Dynamics of Structures, 1993.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import StepSizeError
from vofem.integrators.base import ProbeRows
from vofem.integrators.central_difference.setting import CentralDifference
from vofem.integrators.critical_step import critical_step
from vofem.integrators.methods import CENTRAL_DIFFERENCE
from vofem.integrators.observer import Observer, Snapshot
from vofem.integrators.registry import advice
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.energies import stored_energy
from vofem.integrators.stepping.march import march, note_chatter
from vofem.integrators.stepping.nearby import check_nearby, note_growth
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.system import Counters, State, System

__all__ = ["run"]

Array = NDArray[np.float64]

#: Default step as a fraction of the critical one.
_DEFAULT_FRACTION = 0.5

#: Steps beyond which a run whose step was not given is refused; it would take minutes or hours.
_MOST_STEPS = 1e9

#: Growth of the energy balance over the energies at work that counts as a blow-up.
_BLOW_UP = 1e3


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    observer: Observer | None = None,
    resume: Snapshot | None = None,
    probes: ProbeRows | None = None,
    nearby: bool | None = None,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end.

    Parameters
    ----------
    dt : float, optional
        In s; half the critical step where not given. The other arguments are described in `Method`.

    Raises
    ------
    StepSizeError
        If dt is not below the critical step.
    InstabilityError
        If energy grows beyond what the loads can have done.
    """
    check_nearby(nearby)
    counters, notes = Counters(), []
    limit = critical_step(system, start, counters)
    if not all(group.bounded for group in system.laws):
        notes.append(
            f"step: the critical step of {limit:.6g} s counts nonlinear springs with their tangent at the start; "
            "where they stiffen it is smaller, and a run beyond it stops with an error"
        )
    if dt is None:
        dt, why = followed(system, min(_DEFAULT_FRACTION * limit, t_end / 1000.0), t_end)
        if t_end / dt > _MOST_STEPS:
            mass = system.mass.diagonal() / system.scale**2
            raise StepSizeError(
                f"central differences would take {t_end / dt:.2g} steps: the critical step is {limit:.4g} s for masses "
                f"of {mass.min():.3g} to {mass.max():.3g} kg at their degrees of freedom and all contacts closed. Give "
                f"light or massless parts more mass, or choose {_without_limit()}"
            )
        notes.append(f"step: dt = {dt:.6g} s was chosen{why}; the critical step is {limit:.6g} s")
    elif not dt < limit:
        raise StepSizeError(
            f"dt is {dt:g} s, beyond the critical step {limit:.4g} s of central differences with all contacts "
            f"closed (2/omega_max, omega_max = {2.0 / limit:.6g} rad/s); choose dt below it, or {_without_limit()}"
        )
    steps = step_count(t_end, dt)
    stored = storage_times(times, t_end, dt, steps, system.size, notes)
    note_chatter(system, notes)
    note_loads(system, dt, t_end, notes)
    kernel = CentralDifference(system, start, counters, t_end)
    kernel.plan(dt, steps)
    initial, acceleration = kernel.state.status.copy(), kernel.start_acceleration
    first = stored_energy(system, start.q, start.v) - 0.125 * dt**2 * float(acceleration @ (system.mass @ acceleration))
    out = kernel.record(stored, probes, t_end)
    solution = march(
        kernel, CENTRAL_DIFFERENCE, start, initial, t_end, dt, out, notes, first_energy=first, blow_up=_BLOW_UP,
        observer=observer, resume=resume, probes=probes,
    )  # fmt: skip

    def again(beside: State) -> CentralDifference:
        other = CentralDifference(system, beside, Counters(), t_end)
        other.plan(dt, steps)
        return other

    notes += note_growth(nearby, system, start, kernel, out, again)
    return solution


def _without_limit() -> str:
    """Return what a message recommends where the critical step is too small."""
    return f"{advice(exact=True)}, which has no step, or {advice(conserves=True)}, which is stable at any"
