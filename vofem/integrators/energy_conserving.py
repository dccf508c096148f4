"""The midpoint rule with a discrete gradient for every scalar law.

Order 2 in dt for smooth systems and for contacts that act on the penetration;
order 1 where a force jumps within a step. Stable for every dt and every
stiffness: no energy is made or lost, whatever the step, and with damping it
falls by exactly what the dampers take. No numerical dissipation, so fast
motion that the step does not resolve stays, with its frequency lowered to
less than ``pi/dt``. With ``w = q_1 - q_0``,

    (2M/dt^2 + C/dt + K/2) w = f_m - K q_0 + 2M v_0/dt - sum_j b_j R_j,
    v_1 = 2w/dt - v_0,    R_j = (V_j(u_1) - V_j(u_0)) / (u_1 - u_0),

u the law's coordinate and f_m the load at mid-step. Reactions are found in
the contact coordinates, always (`stepping.contact_solve`); the matrix is factored once.

O. Gonzalez, Exact energy and momentum conserving algorithms for general models in nonlinear elasticity,
Comput. Methods Appl. Mech. Eng. 190 (2000) 1763-1783, https://doi.org/10.1016/S0045-7825(00)00189-4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.base import Samples, initial_status
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.stepped import SteppedSolution, storage_times
from vofem.integrators.stepping.callbacks import Callbacks
from vofem.integrators.stepping.contact_solve import compliance, solve_reactions
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.laws import Laws, build_laws, closed_share
from vofem.integrators.stepping.march import Banded, Progress, chunk, march, stored_energy
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, output, store, switched, trail
from vofem.integrators.stepping.rows import Rows, all_rows, compressed, dot, subtract_row
from vofem.linalg.banded import factor, solve, subtract_product, to_band, widen
from vofem.linalg.jit import jit
from vofem.system import Counters, State, System

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Energy out of nowhere, over the energies at work, that ends a run: rounding cannot make so much.
_BLOW_UP = 1e-3

#: Default number of steps in a run.
_STEPS = 1000


class _Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped), the factored ``2M/dt^2 + C/dt + K/2``, and its compliance."""

    mass: Array
    stiffness: Array
    damping: Array
    factored: Array
    compliance: Array


class _State(NamedTuple):
    """Displacement, velocity, mean acceleration of the step before, reactions, and status of the contacts."""

    q: Array
    v: Array
    a: Array
    reaction: Array
    status: IntArray


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    progress: Progress | None = None,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end.

    Parameters
    ----------
    system : System
    start : State
    t_end : float
        In s.
    times : ndarray, optional
        Where to store; every step where not given.
    dt : float, optional
        In s; a thousandth of t_end where not given.
    progress : callable, optional
        Told the time reached.

    Raises
    ------
    ConvergenceError
        If a nonlinear spring that softens leaves a step without a solution.
    """
    counters, notes = Counters(), []
    if dt is None:
        dt = t_end / _STEPS
        notes.append(
            f"step: dt = {dt:.6g} s was chosen, a thousandth of the run; any dt is stable, a smaller one more accurate"
        )
    steps = max(1, int(np.ceil(t_end / dt - 1e-9)))
    stored = storage_times(times, t_end, dt, steps, system.size, notes)
    kernel = _Midpoint(system, start, dt, steps, counters)
    initial = kernel.state.status.copy()
    if system.contacts is not None and bool(np.any(system.contacts.jump & (system.contacts.gap > 0))):
        notes.append(
            "chatter: under acts_on='displacement' a contact that should rest at its gap chatters with the amplitude "
            "of a step; method='event_driven' pins it"
        )
    return march(
        kernel, "energy_conserving", start, initial, t_end, dt, output(stored, system.size), notes,
        first_energy=stored_energy(system, start.q, start.v), blow_up=_BLOW_UP, progress=progress,
    )  # fmt: skip


class _Midpoint:
    """One run at a fixed step."""

    def __init__(self, system: System, start: State, dt: float, steps: int, counters: Counters) -> None:
        self.dt, self.steps, self.done = dt, steps, 0
        damping = damping_matrix(system, counters)
        self.bands = Banded(system, counters, system.mass, system.stiffness, damping)
        order = self.bands.order
        self.callbacks = None if system.nonlinear is None else Callbacks(system.nonlinear.laws)
        self.laws = build_laws(system, self.callbacks)
        self.rows = compressed(all_rows(system), order)
        mass, stiffness = to_band(system.mass, order), to_band(system.stiffness, order)
        c = np.empty((0, system.size)) if damping is None else to_band(damping, order)
        width = max(mass.shape[0], stiffness.shape[0], c.shape[0]) - 1
        a = (2.0 / dt**2) * widen(mass, width) + 0.5 * widen(stiffness, width)
        if damping is not None:
            a += widen(c, width) / dt
        factored = factor(a, "the matrix of a step")
        counters.factorizations += 1
        self.matrices = _Matrices(mass, stiffness, c, factored, compliance(self.rows, factored))
        n, laws = system.size, system.contacts
        status = np.empty(0, dtype=np.int64)
        if laws is not None:
            u, rate = np.asarray(laws.rows @ start.q), np.asarray(laws.rows @ start.v)
            status = initial_status(laws, u, rate, np.asarray(abs(laws.rows) @ np.abs(start.q)))
        self.state = _State(
            start.q[order].copy(), start.v[order].copy(), np.zeros(n), np.zeros(self.laws.kind.size), status
        )
        self.trail = trail(n)
        leave(self.trail, self.state.q, self.state.v, self.state.a)

    @property
    def finished(self) -> bool:
        """Whether all times asked for are stored: a step's acceleration is known when the next one is done."""
        return self.done > self.steps

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""
        return max(self.done - 1, 0) * self.dt

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        counters, first = self.bands.counters, self.done
        count = min(chunk(self.state.q.size), self.steps + 1 - first)
        values = self.bands.load_values((np.arange(first, first + count, dtype=float) + 0.5) * self.dt)
        cursor, events, solves, failed = _advance(
            self.matrices, self.rows, self.laws, self.bands.loads, values, self.dt, first, count, self.state,
            self.trail, out, cursor,
        )  # fmt: skip
        if self.callbacks is not None:
            self.callbacks.complain(self.dt)
            counters.law_evaluations = self.callbacks.calls
        if failed >= 0:
            raise ConvergenceError(
                f"energy_conserving found no solution of the step from t = {failed * self.dt:g} s at dt = "
                f"{self.dt:g} s; a nonlinear spring that softens may leave none: reduce dt"
            )
        self.done += count
        counters.steps = min(self.done, self.steps)
        counters.contact_solves += solves
        counters.gap_evaluations = self.state.status.size * counters.steps
        if self.matrices.damping.size:
            counters.damping_evaluations = counters.steps
        return cursor, events


@jit
def _advance(
    matrices: _Matrices, rows: Rows, laws: Laws, loads: Array, values: Array, dt: float, first: int, count: int,
    state: _State, before: Trail, out: Output, cursor: int,
) -> tuple[int, Array, int, int]:  # fmt: skip
    """Take `count` steps from step `first`; return the cursor, events, contact solves, and the step that failed or -1.

    The state at the start of a step is stored once the step is done: its
    acceleration is the mean of those of the steps on both sides.
    """
    n, m, contacts = state.q.size, rows.start.size - 1, state.status.size
    q, v = state.q, state.v
    damped = matrices.damping.shape[0] > 0
    w, right, load, loss = np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    u0, u1, free, drag = np.empty(m), np.empty(m), np.empty(m), np.zeros(m)
    now = np.empty(n)
    events = np.empty((16 if contacts else 0, 3))
    happened, solves = 0, 0
    for j in range(m):
        u0[j] = dot(rows, j, q)
    for step in range(first, first + count):
        t = step * dt
        for k in range(loads.shape[0]):
            f = values[k, step - first]
            for i in range(n):
                load[i] = loads[k, i] * f if k == 0 else load[i] + loads[k, i] * f
        for i in range(n):
            right[i] = load[i]
            w[i] = (-2.0 / dt) * v[i]
        subtract_product(matrices.mass, w, right)
        subtract_product(matrices.stiffness, q, right)
        w[:] = right
        solve(matrices.factored, w)
        taken = 0.0
        if m > 0:
            for j in range(m):
                free[j] = u0[j] + dot(rows, j, w)
            found = solve_reactions(laws, matrices.compliance, free, u0, True, 1.0 / dt, drag, state.reaction, u1)
            if found < 0:
                return cursor, events[:happened], solves, step
            if found > 0:
                solves += 1
                w[:] = right
                for j in range(m):
                    if state.reaction[j] != 0.0:
                        subtract_row(rows, j, state.reaction[j], w)
                solve(matrices.factored, w)
        # What is known now completes the state at the start of the step.
        for i in range(n):
            rate = 2.0 * (w[i] / dt - v[i]) / dt
            now[i] = rate if step == 0 else 0.5 * (state.a[i] + rate)
            state.a[i] = rate
        cursor = store(out, cursor, t, dt, step == 0, before, q, v, now)
        leave(before, q, v, now)
        if damped:
            loss[:] = 0.0
            subtract_product(matrices.damping, w, loss)
            taken -= np.dot(loss, w) / dt
        if loads.shape[0] > 0:
            before.work[0] += np.dot(load, w)
        for i in range(n):
            q[i] += w[i]
            v[i] = 2.0 * w[i] / dt - v[i]
        for j in range(m):
            u1[j] = dot(rows, j, q)
            if laws.damping[j] > 0.0:
                taken += laws.damping[j] / dt * closed_share(laws, j, u0[j], u1[j]) * (u1[j] - u0[j])
            if j < contacts:
                s = u1[j] - laws.gap[j]
                if switched(s, state.status[j]):
                    events = log_event(events, happened, j, t + dt, dt, u0[j] - laws.gap[j], s)
                    state.status[j] = int(events[happened, 2])
                    happened += 1
            u0[j] = u1[j]
        before.dissipated[0] += taken
    return cursor, events[:happened], solves, -1
