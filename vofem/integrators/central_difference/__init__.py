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

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import StepSizeError
from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.critical_step import critical_step
from vofem.integrators.methods import CENTRAL_DIFFERENCE
from vofem.integrators.registry import advice
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.checks import look
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import MOST_FACTORED, march, note_chatter, stored_energy
from vofem.integrators.stepping.recall import remember, tell_histories
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import EqualSteps, Matrices
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.integrators.watching import Snapshot, Watch
from vofem.laws import SpringpotLaws
from vofem.laws.evaluate import commit, force_at
from vofem.laws.kinds import AFFINE
from vofem.laws.resolved import contact_stiffness
from vofem.laws.rows import Rows, all_rows, dot, subtract_row
from vofem.laws.springpot import (
    FORCE,
    MEAN,
    WORK,
    History,
    Pace,
    Springpots,
    affine,
    carry_on,
)
from vofem.laws.table import Laws, with_state
from vofem.linalg.banded import factor, solve, subtract_product, widen
from vofem.linalg.jit import jit
from vofem.system import CLOSED, Counters, State, System

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Default step as a fraction of the critical one.
_DEFAULT_FRACTION = 0.5

#: Steps beyond which a run whose step was not given is refused; it would take minutes or hours.
_MOST_STEPS = 1e9

#: Growth of the energy balance over the energies at work that counts as a blow-up.
_BLOW_UP = 1e3


class _Size(NamedTuple):
    """What belongs to the step size: matrices, load vectors, and what a step does to the past of springpots.

    `factored` is ``M + dt C/2``, `shape` and `compliance` are ``A^-1 B'`` and ``B A^-1 B'`` of contact dampers and
    springpots.
    """

    dt: float
    matrices: Matrices
    factored: Array
    shape: Array
    compliance: Array
    loads: Array
    pace: Pace


class _State(NamedTuple):
    """Current state: q at a step, v half a step before, status of the contacts, and internal variables."""

    q: Array
    half: Array
    status: IntArray
    memory: Array


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    watch: Watch | None = None,
    resume: Snapshot | None = None,
    probes: ProbeRows | None = None,
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
    kernel = _CentralDifference(system, start, counters, t_end)
    kernel.plan(dt, steps)
    initial, acceleration = kernel.state.status.copy(), kernel.start_acceleration
    first = stored_energy(system, start.q, start.v) - 0.125 * dt**2 * float(acceleration @ (system.mass @ acceleration))
    return march(
        kernel, CENTRAL_DIFFERENCE, start, initial, t_end, dt, kernel.output(stored, probes, t_end), notes,
        first_energy=first, blow_up=_BLOW_UP, watch=watch, resume=resume,
        probes=probes,
    )  # fmt: skip


def _without_limit() -> str:
    """Return what a message recommends where the critical step is too small."""
    return f"{advice(exact=True)}, which has no step, or {advice(conserves=True)}, which is stable at any"


class _CentralDifference(EqualSteps):
    """A run of equal steps. The velocity of a state is known, and the state stored, when the step after it is done."""

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps, and begin."""
        super().plan(dt, steps)
        system, start, order = self.bands.system, self.start, self.bands.order
        if self.springpotted is not None:
            self._begin_history()
        parts = system.cache.get("central-difference matrix", dt, self._factor, MOST_FACTORED)
        loads = np.concatenate([self.bands.loads, self.bands.answers(parts[0], self.matrices.stiffness)])
        self.size = _Size(dt, self.matrices, *parts, loads, self.step_pace)
        self.start_acceleration = self._start_acceleration(start, self.status)
        # Second-order start: half a step back with the acceleration of the initial conditions.
        half = start.v[order] - 0.5 * dt * self.start_acceleration[order]
        self.state = _State(start.q[order].copy(), half, self.status, self.laws.state)
        self.begin_trail(np.zeros(system.size))

    def _factor(self) -> tuple[Array, Array, Array]:
        """Return the factored ``M + dt C/2``, and `shape` and `compliance` of `_Size`."""
        a, _, c = self.matrices
        if c.size:
            width = max(a.shape[0], c.shape[0]) - 1
            a = widen(a, width) + 0.5 * self.dt * widen(c, width)
        self.bands.counters.factorizations += 1
        factored = factor(a, "the mass matrix")
        return factored, *_implicit(self.bands.system, factored, self.bands.order)

    def _begin_history(self) -> None:
        """Let the force that springpots begin with be the mean of the first step.

        With the force at t = 0, which grows like a power below 1, the sum over half steps would lose its order.
        """
        springpots = self.bands.system.group(SpringpotLaws)
        assert springpots is not None
        first = self.springpots(np.array([0.5 * self.dt]))
        for i, rate in enumerate(springpots.rows @ self.start.v):
            self.history.told[i, MEAN] = affine(first, self.step_pace, self.history, i, 0)[0] * rate

    def kinetic(self, samples: Samples) -> Array:
        """Return ``v_{n-1/2}' M v_{n+1/2} / 2`` at the stored times, J."""
        system = self.bands.system
        return kinetic_energy(system, samples.v) - (0.5 * self.dt) ** 2 * kinetic_energy(system, samples.a)

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        cursor, events = _advance(
            self.size, self.rows, with_state(self.laws, self.state.memory), self.nodal_loads(first, count, self.dt),
            first, count, self.state, self.trail, out, cursor, springpots, self.history,
        )  # fmt: skip
        self.complain(self.dt)
        self.done += count
        # Forces are evaluated at both ends of the run.
        self.count(min(self.done, self.steps), self.done)
        return cursor, events

    def _start_acceleration(self, start: State, status: IntArray) -> Array:
        """Return the acceleration that the equation of motion gives at t = 0, shape (n,)."""
        system, laws = self.bands.system, self.bands.system.contacts
        force = (self.nodal_loads(0, 1, self.dt)[:, 0] @ self.size.loads)[self.bands.back] - system.stiffness @ start.q
        if self.damping is not None:
            force -= self.damping @ start.v
        first = 0
        for group in system.laws:
            u, rate = np.asarray(group.rows @ start.q), np.asarray(group.rows @ start.v)
            if group is laws:
                ideal = np.isinf(laws.resolution)
                share = np.where(ideal, np.where(status == CLOSED, 1.0, 0.0), laws.shares(u - laws.gap))
                pull = share * (laws.elastic(u) + laws.damping * rate)
            elif isinstance(group, SpringpotLaws):
                pull = self.history.told[:, MEAN]
            else:
                pull = np.array([force_at(self.laws, first + i, float(x)) for i, x in enumerate(u)])
            force -= group.rows.T @ pull
            first += len(group)
        banded = force[self.bands.order]
        solve(factor(self.matrices.mass, "the mass matrix"), banded)
        return banded[self.bands.back]


def _implicit(system: System, factored: Array, order: IntArray) -> tuple[Array, Array]:
    """Return ``A^-1 B'`` and ``B A^-1 B'`` of contacts with dampers and of springpots; empty where there are none.

    B has the rows of all laws; columns of other laws are zero.
    """
    laws, every, n = system.contacts, all_rows(system.laws), system.size
    which = [] if laws is None else np.flatnonzero(laws.damping > 0).tolist()
    springpots = system.group(SpringpotLaws)
    if springpots is not None:
        first = system.first_of(springpots)
        which += range(first, first + len(springpots))
    if every is None or not which:
        return np.empty((n, 0)), np.empty((0, 0))
    rows = every.toarray()[:, order]
    shape = np.zeros((n, rows.shape[0]))
    for j in which:
        column = rows[j].copy()
        solve(factored, column)
        shape[:, j] = column
    return shape, rows @ shape


@jit
def _advance(
    size: _Size, rows: Rows, laws: Laws, values: Array, first: int, count: int, state: _State, before: Trail,
    out: Output, cursor: int, springpots: Springpots, history: History,
) -> tuple[int, Array]:  # fmt: skip
    """Advance `count` steps from step `first`; return the output cursor and events (time, contact, status)."""
    dt, matrices, loads, pace = size.dt, size.matrices, size.loads, size.pace
    n, m, contacts = state.q.size, rows.start.size - 1, state.status.size
    q, half, seen = state.q, state.half, out.watch
    damped = matrices.damping.shape[0] > 0
    dampers = size.shape.shape[1] > 0
    pots, told = history.y.shape[0], history.told
    slope, rest, pull = np.zeros(pots), np.zeros(pots), np.zeros(pots)
    a, v, load, loss = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n)
    k_eq, c_eq = np.zeros(contacts), np.zeros(m)
    events = np.empty((16 if contacts else 0, 3))
    happened = 0
    for step in range(first, first + count):
        t = step * dt
        for k in range(loads.shape[0]):
            f = values[k, step - first]
            for i in range(n):
                load[i] = loads[k, i] * f if k == 0 else load[i] + loads[k, i] * f
        for i in range(n):
            a[i] = load[i]
        for j in range(contacts, m):
            if laws.table[j]["kind"] != AFFINE:
                u = dot(rows, j, q)
                if laws.table[j]["end"] > laws.table[j]["start"]:
                    commit(laws, j, u)
                subtract_row(rows, j, force_at(laws, j, u), a)
        subtract_product(matrices.stiffness, q, a)
        any_damper = False
        for i in range(pots):
            j, pull[i] = springpots.row + i, told[i, MEAN]
            slope[i], rest[i] = affine(springpots, pace, history, i, step - first)
            if step > 0:
                pull[i] = 0.5 * (told[i, MEAN] + rest[i] + slope[i] * dot(rows, j, half))
                c_eq[j] = slope[i]
            subtract_row(rows, j, pull[i], a)
        for j in range(contacts):
            u = dot(rows, j, q)
            s = u - laws.table[j]["gap"]
            k_eq[j] = contact_stiffness(laws.table[j]["stiffness"], s, laws.table[j]["resolution"])
            if step == 0:
                if state.status[j] == CLOSED and laws.table[j]["resolution"] == np.inf:
                    k_eq[j] = laws.table[j]["stiffness"]
            elif switched(s, state.status[j], rounding(rows, j, laws.table[j]["gap"], q, before)):
                events = log_event(events, happened, j, t, dt, dot(rows, j, before.q) - laws.table[j]["gap"], s)
                state.status[j] = int(events[happened, 2])
                happened += 1
            reaction = k_eq[j] * (u - laws.table[j]["offset"])
            if dampers:
                c_eq[j] = laws.table[j]["damping"] * (k_eq[j] / laws.table[j]["stiffness"])
                if c_eq[j] > 0.0:
                    any_damper = True
                    reaction += c_eq[j] * dot(rows, j, half)
            if reaction != 0.0:
                subtract_row(rows, j, reaction, a)
        if damped:
            subtract_product(matrices.damping, half, a)
        solve(size.factored, a)
        if any_damper or (pots > 0 and step > 0):
            _implicit_forces(size, rows, c_eq, 0.5 * dt, a)
        for i in range(n):
            v[i] = half[i] + 0.5 * dt * a[i]
        lossy = damped or any_damper
        if lossy:
            # Minus the damping force.
            loss[:] = 0.0
            if damped:
                subtract_product(matrices.damping, v, loss)
            for j in range(contacts):
                if c_eq[j] > 0.0:
                    subtract_row(rows, j, c_eq[j] * dot(rows, j, v), loss)
        for i in range(pots):
            j = springpots.row + i
            if step > 0:
                pull[i] += 0.5 * dt * slope[i] * dot(rows, j, a)
                told[i, FORCE] = pull[i]
                told[i, WORK] += 0.5 * dt * pull[i] * dot(rows, j, half)
        # Work and dissipation by the trapezoidal rule: this time ends one step and begins the next.
        if step > 0:
            if loads.shape[0] > 0:
                before.work[0] += 0.5 * dt * np.dot(half, load)
            if lossy:
                before.dissipated[0] -= 0.5 * dt * np.dot(half, loss)
        wanted = cursor
        if out.every_step or (cursor < out.times.size and out.times[cursor] <= t + 1e-9 * dt):
            cursor = store(out, cursor, t, dt, step == 0, before, q, v, a, a)
        if state.memory.size > 0:
            remember(laws, before.memory, rows, out, wanted, cursor)
            before.memory[:] = state.memory
        if pots > 0:
            tell_histories(history, out, wanted, cursor, t, dt)
        look(seen, rows, dt, q, v)
        leave(before, q, v, a)
        for i in range(n):
            half[i] += dt * a[i]
            q[i] += dt * half[i]
        if loads.shape[0] > 0:
            before.work[0] += 0.5 * dt * np.dot(half, load)
        if lossy:
            before.dissipated[0] -= 0.5 * dt * np.dot(half, loss)
        for i in range(pots):
            rate = dot(rows, springpots.row + i, half)
            told[i, WORK] += 0.5 * dt * pull[i] * rate
            carry_on(springpots, pace, history, i, step - first, rate, slope[i] * rate + rest[i])
    return cursor, events[:happened]


@jit
def _implicit_forces(size: _Size, rows: Rows, c_eq: Array, half_step: float, a: Array) -> None:
    """Correct the acceleration for laws that act, by `c_eq`, on the mean of both half-step velocities."""
    m = c_eq.size
    system, right = np.eye(m), np.zeros(m)
    for j in range(m):
        right[j] = dot(rows, j, a)
        for i in range(m):
            system[j, i] += size.compliance[j, i] * c_eq[i] * half_step
    mean = np.linalg.solve(system, right)
    for j in range(m):
        if c_eq[j] > 0.0:
            force = c_eq[j] * half_step * mean[j]
            for i in range(a.size):
                a[i] -= size.shape[i, j] * force
