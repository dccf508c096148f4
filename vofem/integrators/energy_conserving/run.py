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

from vofem.errors import ArgumentError, ConvergenceError
from vofem.integrators.base import ProbeRows
from vofem.integrators.energy_conserving.adaptive import AdaptiveSteps
from vofem.integrators.energy_conserving.fixed import FixedSteps
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.registry import advice
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.checks import check_times
from vofem.integrators.stepping.march import march, note_chatter, stored_energy
from vofem.integrators.stepping.record import Output
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.integrators.watching import Snapshot, Watch
from vofem.laws.evaluate import may_jump
from vofem.system import CLOSED, Counters, State, System

Array = NDArray[np.float64]

#: Energy out of nowhere, over the energies at work, that ends a run: rounding cannot make so much.
_BLOW_UP = 1e-3

#: Tolerance of the coarser run with which a run is compared, over that of the run.
_COARSER = 4.0

#: Difference between both, over the tolerance, above which it is told.
_APART = 5.0

#: Largest displacement over the one that errors were related to, below which that was wrong.
_OVERSIZED = 0.5

#: Default number of steps in a run.
_STEPS = 1000


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    watch: Watch | None = None,
    resume: Snapshot | None = None,
    probes: ProbeRows | None = None,
    tol: float | None = None,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end.

    Parameters
    ----------
    system : System
    start : State
    t_end : float
        In s.
    times : ndarray, optional
        Where to store; every step where not given, 1001 uniform times with `tol`.
    dt : float, optional
        In s; a thousandth of t_end where neither it nor `tol` is given.
    watch : callable, optional
        Told the time reached.
    resume : dict, optional
        A snapshot of the same run, from which to go on.
    probes : ProbeRows, optional
        Points to be recorded at every step.
    tol : float, optional
        Chooses the steps: the errors of all steps together, estimated, stay
        below this fraction of the largest displacement, which a rough run of
        a thousand steps tells beforehand. Impacts are resolved. Velocities and
        contact forces are not bounded by it.

    Raises
    ------
    ConvergenceError
        If a nonlinear spring that softens leaves a step without a solution.
    """
    counters, notes = Counters(), []
    kernel: FixedSteps | AdaptiveSteps
    if tol is not None:
        if dt is not None:
            raise ArgumentError("simulate: dt and tol were both given; tol chooses the steps, leave out dt")
        kernel = AdaptiveSteps(system, start, counters, t_end)
        kernel.plan(t_end, tol)
        # A run that goes on knows the size already.
        if resume is None:
            kernel.measure(_pilot(system, start, t_end, counters).q)
            _compare(kernel, system, start, tol)
        else:
            kernel.measure(start.q[:, None])
        stored, step = np.linspace(0.0, t_end, 1001) if times is None else times, t_end
    else:
        step, why = followed(system, t_end / _STEPS, t_end) if dt is None else (dt, "")
        if dt is None:
            notes.append(
                f"step: dt = {step:.6g} s was chosen{why or ', a thousandth of the run'}; any dt is stable, "
                "tol= chooses by error"
            )
        steps = step_count(t_end, step)
        stored = storage_times(times, t_end, step, steps, system.size, notes)
        kernel = FixedSteps(system, start, counters, t_end)
        kernel.plan(step, steps)
    initial = kernel.state.status.copy()
    note_chatter(system, notes)
    note_loads(system, None if tol is not None else step, t_end, notes)
    out = kernel.output(stored, probes, t_end)
    solution = march(
        kernel, ENERGY_CONSERVING, start, initial, t_end, step, out, notes,
        first_energy=stored_energy(system, start.q, start.v), blow_up=_BLOW_UP, watch=watch, resume=resume,
        probes=probes,
    )  # fmt: skip
    if isinstance(kernel, AdaptiveSteps):
        solution.dt = kernel.coarsest
        _tell(kernel, out, tol or 0.0, notes)
    return solution


def _tell(kernel: AdaptiveSteps, out: Output, tol: float, notes: list[str]) -> None:
    """Tell where the tolerance may not be kept."""
    if kernel.forced:
        notes.append(
            f"tol: {kernel.forced} steps of the smallest size, {kernel.tick:.3g} s, exceeded their share of the "
            "tolerance and were taken all the same: a force jumps there"
        )
    if kernel.coarser.size:
        checks = check_times(kernel.t_end, None, kernel.state.q.size)
        # The first column of each, as a time may be asked for twice.
        columns = np.searchsorted(out.times, checks)
        off = kernel.largest_of(np.nan_to_num(out.q[:, columns] - kernel.coarser))
        if off > _APART * tol * kernel.size:
            notes.append(
                f"tol: displacements may be wrong by {off:.2g} m, {off / (tol * kernel.size):.2g} times what tol = "
                f"{tol:g} allows: by so much the run differs from one whose tolerance is {_COARSER:g} times as large; "
                f"impacts magnify errors. Choose a smaller tol, or {advice(exact=True)} where it applies"
            )
    if kernel.farthest < _OVERSIZED * kernel.size:
        notes.append(
            f"tol: errors are held below tol = {tol:g} of {kernel.size:.3g} m, which a rough run of {_STEPS} steps "
            f"told, but nothing moves farther than {kernel.farthest:.3g} m; choose a tol smaller by their ratio"
        )


def _compare(kernel: AdaptiveSteps, system: System, start: State, tol: float) -> None:
    """Run a scene with impacts at a coarser tolerance first, and leave what it finds for `_tell`.

    The errors of steps bound that of the run where it is smooth. What an impact does depends on velocities, and on
    fast motion that displacements do not show, so two runs are compared. The coarser one takes about half the steps.
    """
    if not may_jump(kernel.laws):
        return
    trial = AdaptiveSteps(system, start, Counters(), kernel.t_end)
    trial.plan(kernel.t_end, _COARSER * tol, 0.5)
    trial.size = kernel.size
    out, hit = _trial(trial)
    if hit:
        # This run knows better than the pilot how far things move.
        kernel.size = min(kernel.size, trial.largest_of(out.q))
        kernel.coarser = out.q


def _trial(kernel: AdaptiveSteps) -> tuple[Output, bool]:
    """Run to the end; return what is found at the times at which a run looks at itself, and whether a law jumped."""
    out = kernel.output(check_times(kernel.t_end, None, kernel.state.q.size), None)
    hit = kernel.state.status.size < kernel.laws.table.size or bool(np.any(kernel.state.status == CLOSED))
    out.q[:] = 0.0
    cursor = 0
    try:
        while not kernel.finished:
            cursor, events = kernel.advance(out, cursor)
            hit = hit or events.size > 0
    except ConvergenceError:
        # The run itself will say so, or take other steps.
        hit = True
    return out, hit


def _pilot(system: System, start: State, t_end: float, counters: Counters) -> Output:
    """Return a rough run of equal steps, which tells how far things move."""
    kernel = FixedSteps(system, start, counters, t_end)
    kernel.plan(t_end / _STEPS, _STEPS)
    out = kernel.output(np.linspace(0.0, t_end, _STEPS + 1), None)
    out.q[:] = 0.0
    cursor = 0
    try:
        while not kernel.finished:
            cursor, _ = kernel.advance(out, cursor)
    except ConvergenceError:
        # At such large steps a stiff law may leave no solution in double precision: what came before has a size too.
        pass
    return out
