"""The methods that step in time: their numbers, and runs of them.

energy_conserving: the midpoint rule with a discrete gradient for every scalar law
----------------------------------------------------------------------------------
Order 2 in dt for smooth systems and for contacts that act on the penetration;
where a force jumps within a step its work is exact and its moment is not: order
2 on masses, 1 where the jump rings in a beam. Stable for every dt and every
stiffness: no energy is made or lost, whatever the step, and with damping it
falls by exactly what the dampers take. No numerical dissipation, so fast
motion that the step does not resolve stays, with its frequency lowered to
less than ``pi/dt``. With the mean velocity ``p = (v_0 + v_1)/2`` of a step,

    (M + dt C/2 + dt^2 K/4) p = M v_0 + dt/2 (f_m - K q_0 - sum_j b_j R_j),
    q_1 = q_0 + dt p,    v_1 = 2p - v_0,    R_j = (V_j(u_1) - V_j(u_0)) / (u_1 - u_0),

u the law's coordinate and f_m the load at mid-step.

O. Gonzalez, Exact energy and momentum conserving algorithms for general models in nonlinear elasticity,
Comput. Methods Appl. Mech. Eng. 190 (2000) 1763-1783, https://doi.org/10.1016/S0045-7825(00)00189-4.

generalized_alpha: with contact solved inside the step
------------------------------------------------------
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

central_difference: Eq. 21 of the paper in velocity form
--------------------------------------------------------
Order 2 in dt for smooth systems and for contacts that act on the penetration;
order 1, or worse, where a force jumps within a step: that of a contact that
acts on the displacement, of a pulse. Stable for ``dt < 2/omega_max``,
damped or not; no numerical dissipation. With ``v`` at half steps,

    (M + dt C/2) a_n = f_n - K q_n - C v_{n-1/2} - sum_j b_j R_j,
    v_{n+1/2} = v_{n-1/2} + dt a_n,    q_{n+1} = q_n + dt v_{n+1/2},

which is Eq. 21 with C = 0 but loses far fewer digits than its two-step form.
Contact dampers are implicit, through the compliance of the contact rows, and act
in the part of the time from n - 1/2 to n + 1/2 in which the contact is closed,
known from ``v_{n-1/2}``. Implicit are also springpots, by the mean of their forces over the steps on both sides: both
only take energy, and leave the critical step as it is. The
kinetic energy reported is ``v_{n-1/2}' M v_{n+1/2} / 2``: with it the scheme
conserves energy to rounding between switches.

N. M. Newmark's family at beta = 0, gamma = 1/2; R. W. Clough, J. Penzien, Dynamics of Structures, 1993.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem._validate import number
from vofem.arrays import Array
from vofem.errors import ArgumentError, StepSizeError
from vofem.integrators.base import ProbeRows
from vofem.integrators.critical_step import critical_step
from vofem.integrators.method import Method
from vofem.integrators.methods import CENTRAL_DIFFERENCE, ENERGY_CONSERVING, GENERALIZED_ALPHA
from vofem.integrators.observer import Observer, Snapshot
from vofem.integrators.registry import advice
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.energies import stored_energy
from vofem.integrators.stepping.equal import EqualSteps
from vofem.integrators.stepping.march import march
from vofem.integrators.stepping.nearby import check_nearby, note_errors, note_growth
from vofem.integrators.stepping.scheme import Scheme
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.integrators.stepping.structure import Structure
from vofem.integrators.stepping.tolerance import note_tolerance, under_tolerance
from vofem.system import Counters, State, System

#: The midpoint rule, and Newmark's explicit method.
MIDPOINT, CENTRAL = Scheme(0.5, 0.5, 0.5, 0.25, mean=True), Scheme(0.0, 0.0, 0.5, 0.0)

#: Energy that no load has supplied, over the largest energy, that ends a run. Where energy is conserved, rounding
#: cannot make so much.
_CONSERVING, _IMPLICIT, _EXPLICIT = 1e-3, 1.0, 1e3

#: Steps of a run by default.
_STEPS = 1000

#: Default explicit step as a fraction of the critical one.
_DEFAULT_FRACTION = 0.5

#: How notes begin that report errors of steps already.
_OF_STEPS = ("step: steps", "step: impacts", "step: the errors", "energy:", "chaos:", "load:")

#: Steps beyond which a run whose step was not given is refused; it would take minutes or hours.
_MOST_STEPS = 1e9


@dataclass(frozen=True)
class Asked:
    """The arguments of a run; the fields are the arguments of `Method.run`."""

    system: System
    start: State
    t_end: float
    times: Array | None
    dt: float | None = None
    observer: Observer | None = None
    resume: Snapshot | None = None
    probes: ProbeRows | None = None
    tol: float | None = None
    nearby: bool | None = None


def energy_conserving(
    system: System, start: State, t_end: float, times: Array | None, dt: float | None = None,
    observer: Observer | None = None, resume: Snapshot | None = None, probes: ProbeRows | None = None,
    tol: float | None = None, nearby: bool | None = None,
) -> SteppedSolution:  # fmt: skip
    """Simulate from the start state at t = 0 to t_end; `Method` describes the arguments.

    Raises `ConvergenceError` if a nonlinear spring that softens leaves a step without a solution.
    """
    asked = Asked(system, start, t_end, times, dt, observer, resume, probes, tol, nearby)
    return _implicit(ENERGY_CONSERVING, MIDPOINT, asked, _CONSERVING, "; any dt is stable, tol= chooses by error")


def generalized_alpha(
    system: System, start: State, t_end: float, times: Array | None, dt: float | None = None,
    observer: Observer | None = None, resume: Snapshot | None = None, probes: ProbeRows | None = None,
    tol: float | None = None, nearby: bool | None = None, **options: float,
) -> SteppedSolution:  # fmt: skip
    """Simulate from the start state at t = 0 to t_end; `Method` describes the arguments.

    `**options`: as `parameters` takes them.
    Raises `InstabilityError` if energy grows beyond what the loads can have done.
    Raises `ConvergenceError` if a nonlinear spring that softens leaves a step without a solution.
    """
    asked = Asked(system, start, t_end, times, dt, observer, resume, probes, tol, nearby)
    return _implicit(GENERALIZED_ALPHA, parameters(**options), asked, _IMPLICIT, "")


def central_difference(
    system: System, start: State, t_end: float, times: Array | None, dt: float | None = None,
    observer: Observer | None = None, resume: Snapshot | None = None, probes: ProbeRows | None = None,
    nearby: bool | None = None,
) -> SteppedSolution:  # fmt: skip
    """Simulate from the start state at t = 0 to t_end.

    `dt`: in s; half the critical step where not given. The other arguments are described in `Method`.
    Raises `StepSizeError` if dt is not below the critical step.
    Raises `InstabilityError` if energy grows beyond what the loads can have done.
    """
    check_nearby(nearby)
    counters, notes = Counters(), list[str]()
    limit = critical_step(system, start, counters)
    if not all(group.bounded for group in system.laws):
        notes.append(
            f"step: the critical step of {limit:.6g} s counts nonlinear springs with their tangent at the start; "
            "where they stiffen it is smaller, and a run beyond it stops with an error"
        )
    if dt is None:
        dt, why = followed(system, min(_DEFAULT_FRACTION * limit, t_end / _STEPS), t_end)
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
    asked = Asked(system, start, t_end, times, dt, observer, resume, probes, None, nearby)
    return _equal(CENTRAL_DIFFERENCE, CENTRAL, asked, dt, counters, notes, _EXPLICIT, limit)


def parameters(
    rho_infinity: float = 0.8,
    alpha_m: float | None = None,
    alpha_f: float | None = None,
    gamma: float | None = None,
    newmark_beta: float | None = None,
) -> Scheme:
    """Return the numbers of the generalized-alpha method, those given in place of Chung and Hulbert's.

    Raises `ArgumentError` outside [0, 1] for rho_infinity, or where linear systems would not be stable.
    """
    rho = number("simulate: rho_infinity", rho_infinity, minimum=0)
    if rho > 1.0:
        raise ArgumentError(
            f"simulate: rho_infinity is {rho:g}, expected a number in [0, 1]: 1 without numerical dissipation, "
            "0 with most"
        )
    am = (2.0 * rho - 1.0) / (rho + 1.0) if alpha_m is None else number("simulate: alpha_m", alpha_m)
    af = rho / (rho + 1.0) if alpha_f is None else number("simulate: alpha_f", alpha_f)
    g = 0.5 - am + af if gamma is None else number("simulate: gamma", gamma)
    b = 0.25 * (1.0 - am + af) ** 2 if newmark_beta is None else number("simulate: newmark_beta", newmark_beta)
    slack = 1e-12
    if not (am <= af + slack and af <= 0.5 + slack and g >= 0.5 - am + af - slack and b >= 0.5 * g - slack and b > 0):
        raise ArgumentError(
            f"simulate: alpha_m = {am:g}, alpha_f = {af:g}, gamma = {g:g}, newmark_beta = {b:g} are not "
            "unconditionally stable, expected alpha_m <= alpha_f <= 1/2, gamma >= 1/2 - alpha_m + alpha_f and "
            "newmark_beta >= gamma/2; rho_infinity alone chooses all four"
        )
    return Scheme(am, af, g, b)


def _implicit(method: Method, scheme: Scheme, asked: Asked, blow_up: float, advised: str) -> SteppedSolution:
    """Run a method that is stable at any step; `advised` is what the note on a step that was chosen says further."""
    system, start, t_end, dt = asked.system, asked.start, asked.t_end, asked.dt
    check_nearby(asked.nearby)
    counters, notes = Counters(), list[str]()
    if asked.tol is None:
        if dt is None:
            dt, why = followed(system, t_end / _STEPS, t_end)
            notes.append(f"step: dt = {dt:.6g} s was chosen{why or ', a thousandth of the run'}{advised}")
        return _equal(method, scheme, asked, dt, counters, notes, blow_up)
    if dt is not None:
        raise ArgumentError("simulate: dt and tol were both given; tol chooses the steps, leave out dt")
    structure = Structure(system, method, scheme, counters)
    run = under_tolerance(structure, start, t_end, asked.tol, counters, asked.resume is not None, asked.observer)
    _note_chatter(system, notes)
    note_loads(system, None, t_end, notes)
    stored = np.linspace(0.0, t_end, _STEPS + 1) if asked.times is None else asked.times
    out = run.record(stored, asked.probes, t_end)
    solution = march(
        run, out, notes, t_end, first_energy=stored_energy(system, run.start.q, run.start.v), blow_up=blow_up,
        observer=asked.observer, resume=asked.resume, probes=asked.probes,
    )  # fmt: skip
    solution.dt = run.coarsest
    note_tolerance(run, out, notes)
    return solution


def _equal(
    method: Method, scheme: Scheme, asked: Asked, dt: float, counters: Counters, notes: list[str], blow_up: float,
    critical: float | None = None,
) -> SteppedSolution:  # fmt: skip
    """Run equal steps, where there is a critical step below it."""
    system, start, t_end = asked.system, asked.start, asked.t_end
    steps = step_count(t_end, dt)
    stored = storage_times(asked.times, t_end, dt, steps, system.size, notes)
    _note_chatter(system, notes)
    note_loads(system, dt, t_end, notes)
    structure = Structure(system, method, scheme, counters)
    run = EqualSteps(structure, start, counters, t_end, dt, steps)
    first = stored_energy(system, run.start.q, run.start.v)
    if scheme.explicit:
        a = run.path.chunk.a[0][run.back]
        first -= 0.125 * dt**2 * float(a @ (system.mass @ a))
    out = run.record(stored, asked.probes, t_end)
    solution = march(
        run, out, notes, dt, first_energy=first, blow_up=blow_up, observer=asked.observer, resume=asked.resume,
        probes=asked.probes,
    )  # fmt: skip

    def again(beside: State, dt: float = dt) -> EqualSteps:
        return EqualSteps(structure, beside, Counters(), t_end, dt, step_count(t_end, dt))

    notes += note_growth(asked.nearby, run, out, again)
    if not any(note.startswith(_OF_STEPS) for note in notes):
        notes += note_errors(asked.nearby, run, out, critical, lambda other: again(start, other))
    return solution


def _note_chatter(system: System, notes: list[str]) -> None:
    """Add a note where contacts that should rest at their gap chatter from step to step."""
    if system.contacts is not None and bool(np.any(system.contacts.jump & (system.contacts.gap > 0))):
        notes.append(
            "chatter: under acts_on='displacement' a contact that should rest at its gap chatters with the amplitude "
            f"of a step; {advice(exact=True)} pins it"
        )


def _without_limit() -> str:
    """Return what a message recommends where the critical step is too small."""
    return f"{advice(exact=True)}, which has no step, or {advice(conserves=True)}, which is stable at any"
