"""Central differences: Eq. 21 of the paper in velocity form.

Order 2 in dt for smooth systems and for contacts that act on the penetration;
order 1, or worse, where a force jumps within a step: that of a contact that
acts on the displacement, of a contact damper at closing, of a pulse. Stable for ``dt < 2/omega_max``,
damped or not; no numerical dissipation. With ``v`` at half steps,

    (M + dt C/2) a_n = f_n - K q_n - C v_{n-1/2} - sum_j b_j R_j,
    v_{n+1/2} = v_{n-1/2} + dt a_n,    q_{n+1} = q_n + dt v_{n+1/2},

which is Eq. 21 with C = 0 but loses far fewer digits than its two-step form.
Contact dampers are implicit, through the compliance of the contact rows. The
kinetic energy reported is ``v_{n-1/2}' M v_{n+1/2} / 2``: with it the scheme
conserves energy to rounding between switches.

N. M. Newmark's family at beta = 0, gamma = 1/2; R. W. Clough, J. Penzien, Dynamics of Structures, 1993.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import InstabilityError, StepSizeError
from vofem.integrators.base import Energies, Samples, initial_status
from vofem.integrators.critical_step import critical_step
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.stepped import SteppedSolution, quintic, storage_times
from vofem.integrators.switch import contact_stiffness
from vofem.linalg.banded import band_order, factor, solve, subtract_product, to_band, widen
from vofem.linalg.jit import jit
from vofem.system import CLOSED, OPEN, ContactLaws, Counters, Events, State, System

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Default step as a fraction of the critical one.
_DEFAULT_FRACTION = 0.5

#: Steps between two looks at the outcome.
_CHUNK = 8192

#: Growth of the energy balance over the energies at work that counts as a blow-up.
_BLOW_UP = 1e3


class _Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped), and the factored ``M + dt C/2``."""

    mass: Array
    stiffness: Array
    damping: Array
    factored: Array


class _Contacts(NamedTuple):
    """Contact rows in compressed form with their laws; `shape` and `compliance` are ``A^-1 B'`` and ``B A^-1 B'``."""

    start: IntArray
    column: IntArray
    weight: Array
    gap: Array
    offset: Array
    stiffness: Array
    damping: Array
    resolution: Array
    shape: Array
    compliance: Array


class _State(NamedTuple):
    """Where a run stands: q at a step, v half a step before, the step before, and (now, before) of the totals."""

    q: Array
    half: Array
    q_before: Array
    v_before: Array
    a_before: Array
    work: Array
    dissipated: Array


class _Output(NamedTuple):
    """Stored times and what is stored there: q, v, a of shape (n, n_times), and work and dissipation."""

    times: Array
    q: Array
    v: Array
    a: Array
    work: Array
    dissipated: Array


def run(system: System, start: State, t_end: float, times: Array | None, dt: float | None = None) -> SteppedSolution:
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
        In s; half the critical step where not given.

    Raises
    ------
    StepSizeError
        If dt is not below the critical step.
    InstabilityError
        If energy grows beyond what the loads can have done.
    """
    counters, notes = Counters(), []
    tangents = _tangents(system, start)
    limit = critical_step(system, tangents)
    counters.eigensolves += 1
    if tangents is not None:
        notes.append(
            f"step: the critical step of {limit:.6g} s counts nonlinear springs with their tangent at the start; "
            "where they stiffen it is smaller, and a run beyond it stops with an error"
        )
    if dt is None:
        dt = min(_DEFAULT_FRACTION * limit, t_end / 1000.0)
        notes.append(f"step: dt = {dt:.6g} s was chosen; the critical step is {limit:.6g} s")
    elif not dt < limit:
        raise StepSizeError(
            f"dt is {dt:g} s, beyond the critical step {limit:.4g} s of central differences with all contacts "
            f"closed (2/omega_max, omega_max = {2.0 / limit:.6g} rad/s); choose dt below it, or "
            "method='event_driven', which has no step"
        )
    steps = max(1, int(np.ceil(t_end / dt - 1e-9)))
    stored = storage_times(times, t_end, dt, steps, system.size, notes)
    return _Run(system, dt, counters, notes).advance(start, t_end, steps, stored)


def _tangents(system: System, start: State) -> Array | None:
    """Return the tangent stiffness of nonlinear springs at the start, or None where there are none."""
    if system.nonlinear is None:
        return None
    u = system.nonlinear.rows @ start.q
    return np.array([law.tangent(float(x)) for law, x in zip(system.nonlinear.laws, u, strict=True)])


class _Run:
    """One run: matrices in band storage, contacts in compressed rows."""

    def __init__(self, system: System, dt: float, counters: Counters, notes: list[str]) -> None:
        self.system, self.dt, self.counters, self.notes = system, dt, counters, notes
        self.damping = damping = damping_matrix(system, counters)
        present = [system.mass, system.stiffness] + ([] if damping is None else [damping])
        self.order = band_order(*present)
        mass, stiffness = to_band(system.mass, self.order), to_band(system.stiffness, self.order)
        if damping is None:
            c = np.empty((0, system.size))
            a = mass
        else:
            c = to_band(damping, self.order)
            width = max(mass.shape[0], c.shape[0]) - 1
            a = widen(mass, width) + 0.5 * dt * widen(c, width)
        counters.factorizations += 1
        self.matrices = _Matrices(mass, stiffness, c, factor(a, "the mass matrix"))
        self.contacts = self._compress(system.contacts)
        self.loads = np.array([load.vector[self.order] for load in system.loads]).reshape(-1, system.size)
        self.working = len(system.loads)
        self.nonlinear = None
        if system.nonlinear is not None:
            # Explicit steps need a law's force at the beginning of a step only: one more load, which does no work.
            self.nonlinear = system.nonlinear.rows.toarray()[:, self.order]
            self.loads = np.vstack([self.loads, -self.nonlinear])

    def _compress(self, laws: ContactLaws | None) -> _Contacts:
        n = self.system.size
        if laws is None:
            none, no_int = np.empty(0), np.empty(0, dtype=np.int64)
            return _Contacts(
                np.zeros(1, dtype=np.int64), no_int, none, none, none, none, none, none,
                np.empty((n, 0)), np.empty((0, 0)),
            )  # fmt: skip
        place = np.empty(n, dtype=np.int64)
        place[self.order] = np.arange(n)
        m = len(laws)
        shape, compliance = np.zeros((n, m)), np.zeros((m, m))
        if np.any(laws.damping > 0):
            rows = laws.rows.toarray()[:, self.order]
            for j in np.flatnonzero(laws.damping > 0):
                column = rows[j].copy()
                solve(self.matrices.factored, column)
                shape[:, j] = column
            compliance = rows @ shape
        return _Contacts(
            laws.rows.indptr.astype(np.int64), place[laws.rows.indices], laws.rows.data, laws.gap, laws.offset,
            laws.stiffness, laws.damping, laws.resolution, shape, compliance,
        )  # fmt: skip

    def advance(self, start: State, t_end: float, steps: int, stored: Array) -> SteppedSolution:
        system, laws, n = self.system, self.system.contacts, self.system.size
        status = np.empty(0, dtype=np.int64)
        if laws is not None:
            size = abs(laws.rows) @ np.abs(start.q)
            status = initial_status(laws, laws.rows @ start.q, laws.rows @ start.v, size)
        initial = status.copy()
        output = _Output(stored, *np.full((3, n, stored.size), np.nan), *np.zeros((2, stored.size)))
        q, v = start.q[self.order].copy(), start.v[self.order].copy()
        # Second-order start: half a step back with the acceleration of the initial conditions.
        acceleration = self._start_acceleration(start, initial)
        half = v - 0.5 * self.dt * acceleration[self.order]
        state = _State(q, half, q.copy(), v, np.zeros(n), np.zeros(2), np.zeros(2))
        energy = self._energy(q, v)
        log: list[tuple[float, int, int]] = []
        cursor, done = 0, 0
        while done <= steps:
            count = min(_CHUNK if self.nonlinear is None else 1, steps + 1 - done)
            values = self._load_values(np.arange(done, done + count, dtype=float) * self.dt)
            if self.nonlinear is not None:
                values = np.vstack([values, self._reactions(state.q)[:, None]])
            cursor, events, happened = _advance(
                self.matrices, self.contacts, self.loads, self.working, values, self.dt, done, count,
                state, status, output, cursor,
            )  # fmt: skip
            log.extend((float(t), int(j), int(s)) for t, j, s in events[:happened])
            done += count
            if self.nonlinear is None or done % 64 == 0 or done > steps:
                self._check(state, energy, (done - 1) * self.dt)
        self.counters.steps = steps
        self.counters.gap_evaluations = (0 if laws is None else len(laws)) * (steps + 1)
        self.counters.events = len(log)
        if system.damped:
            self.counters.damping_evaluations += steps + 1
        first = energy - 0.125 * self.dt**2 * float(acceleration @ (system.mass @ acceleration))
        return self._solution(t_end, output, log, initial, first)

    def _start_acceleration(self, start: State, status: IntArray) -> Array:
        """Return the acceleration that the equation of motion gives at t = 0, shape (n,)."""
        system, laws = self.system, self.system.contacts
        force = system.force(0.0) - system.stiffness @ start.q
        if self.damping is not None:
            force -= self.damping @ start.v
        if laws is not None:
            u, rate = laws.rows @ start.q, laws.rows @ start.v
            share = np.where(status == CLOSED, 1.0, 0.0)
            for j in np.flatnonzero(np.isfinite(laws.resolution)):
                share[j] = contact_stiffness(1.0, float(u[j] - laws.gap[j]), float(laws.resolution[j]))
            force -= laws.rows.T @ (share * (laws.stiffness * (u - laws.offset) + laws.damping * rate))
        if system.nonlinear is not None:
            force -= system.nonlinear.rows.T @ self._reactions(start.q[self.order])
        banded = force[self.order]
        solve(factor(self.matrices.mass, "the mass matrix"), banded)
        acceleration = np.empty_like(banded)
        acceleration[self.order] = banded
        return acceleration

    def _load_values(self, t: Array) -> Array:
        self.counters.load_evaluations += t.size * len(self.system.loads)
        return np.array([load.function(t) for load in self.system.loads]).reshape(-1, t.size)

    def _reactions(self, q: Array) -> Array:
        """Return the forces of the nonlinear springs at q (in band order), shape (n_laws,)."""
        assert self.system.nonlinear is not None
        assert self.nonlinear is not None
        laws = self.system.nonlinear.laws
        self.counters.law_evaluations += len(laws)
        forces = np.array([law.reaction(float(u)) for law, u in zip(laws, self.nonlinear @ q, strict=True)])
        if not np.all(np.isfinite(forces)):
            k = int(np.argmax(~np.isfinite(forces)))
            raise InstabilityError(
                f"NonlinearSpring {laws[k].name!r} returned {forces[k]} N at u = {float(self.nonlinear[k] @ q):g} m, "
                f"expected a finite number; reduce dt = {self.dt:g} s, or look at its law"
            )
        return forces

    def _energy(self, q: Array, v: Array) -> float:
        strain, motion = np.zeros(q.size), np.zeros(q.size)
        subtract_product(self.matrices.stiffness, q, strain)
        subtract_product(self.matrices.mass, v, motion)
        stored = 0.0
        if self.nonlinear is not None and self.system.nonlinear is not None:
            laws = self.system.nonlinear.laws
            stored = sum(law.energy(float(u)) for law, u in zip(laws, self.nonlinear @ q, strict=True))
        contacts = self.system.contacts
        if contacts is not None:
            natural = np.empty_like(q)
            natural[self.order] = q
            stored += float(_contact_energy(contacts, (contacts.rows @ natural)[:, None])[0])
        return stored - 0.5 * float(q @ strain + v @ motion)

    def _check(self, state: _State, first: float, t: float) -> None:
        now = self._energy(state.q_before, state.v_before)
        work, dissipated = float(state.work[0]), float(state.dissipated[0])
        scale = abs(first) + abs(work) + abs(dissipated)
        if not now - first - work + dissipated <= _BLOW_UP * scale + 1e-300:
            raise InstabilityError(
                f"central_difference blew up before t = {t:g} s: energy {now:.3g} J, from {first:.3g} J at the start "
                f"and {work:.3g} J of work; reduce dt = {self.dt:g} s, or choose method='event_driven'"
            )

    def _solution(
        self, t_end: float, output: _Output, log: list[tuple[float, int, int]], initial: IntArray, first: float
    ) -> SteppedSolution:
        system, laws = self.system, self.system.contacts
        back = np.empty(system.size, dtype=np.int64)
        back[self.order] = np.arange(system.size)
        samples = Samples(output.q[back], output.v[back], output.a[back])
        kinetic = 0.5 * np.sum(samples.v * (system.mass @ samples.v), axis=0)
        kinetic -= 0.125 * self.dt**2 * np.sum(samples.a * (system.mass @ samples.a), axis=0)
        if system.strain is not None:
            strain = 0.5 * np.sum(np.asarray(system.strain @ samples.q) ** 2, axis=0)
        else:
            strain = 0.5 * np.sum(samples.q * (system.stiffness @ samples.q), axis=0)
        if system.nonlinear is not None:
            for law, u in zip(system.nonlinear.laws, system.nonlinear.rows @ samples.q, strict=True):
                strain += np.array([law.energy(float(x)) for x in u])
        contact = np.zeros(output.times.size)
        if laws is not None:
            contact = _contact_energy(laws, laws.rows @ samples.q)
        events = Events(initial=initial)
        if log:
            time, which, entered = zip(*log, strict=True)
            events = Events(np.array(time), np.array(which), np.array(entered), initial)
        return SteppedSolution(
            system, t_end, output.times, samples, Energies(kinetic, strain, contact, output.dissipated, output.work),
            first, self.dt, events, self.counters, self.notes,
        )  # fmt: skip


def _contact_energy(laws: ContactLaws, u: Array) -> Array:
    """Return the energy stored in closed contacts; of a resolved switch by quadrature over its law."""
    from vofem.integrators.base import spring_potential

    status = np.where(u > laws.gap[:, None], CLOSED, OPEN)
    status[np.isfinite(laws.resolution)] = OPEN
    total = spring_potential(laws, u, status)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for j in np.flatnonzero(np.isfinite(laws.resolution)):
        from vofem.fractional.constants import resolved

        s = np.maximum(u[j] - laws.gap[j], 0.0)
        # Panels between multiples of the switching length resolve the rise; beyond 40 of them K_eq is K0.
        s0 = laws.resolution[j]
        edges = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0]) / s0
        for low, high in pairwise(edges):
            width = np.clip(s, low, high) - low
            at = low + 0.5 * width[:, None] * (1.0 + nodes)
            lever = at + laws.gap[j] - laws.offset[j]
            total += 0.5 * width * ((resolved(laws.stiffness[j], at, s0) * lever) @ weights)
        beyond = np.maximum(s - edges[-1], 0.0)
        lever = laws.gap[j] - laws.offset[j] + edges[-1]
        total += laws.stiffness[j] * beyond * (lever + 0.5 * beyond)
    return total


@jit
def _dot(contacts: _Contacts, j: int, x: Array) -> float:
    total = 0.0
    for e in range(contacts.start[j], contacts.start[j + 1]):
        total += contacts.weight[e] * x[contacts.column[e]]
    return total


@jit
def _subtract_row(contacts: _Contacts, j: int, factor: float, y: Array) -> None:
    for e in range(contacts.start[j], contacts.start[j + 1]):
        y[contacts.column[e]] -= contacts.weight[e] * factor


@jit
def _advance(
    matrices: _Matrices, contacts: _Contacts, loads: Array, working: int, values: Array, dt: float, first: int,
    count: int,
    state: _State, status: IntArray, output: _Output, cursor: int,
) -> tuple[int, Array, int]:  # fmt: skip
    """Advance `count` steps from step `first`; return the output cursor and events (time, contact, status).

    The first `working` rows of `loads` are loads, whose work is counted; the others are forces of springs.
    """
    n, m = state.q.size, contacts.gap.size
    q, half = state.q, state.half
    damped = matrices.damping.shape[0] > 0
    dampers = contacts.shape.shape[1] > 0 and np.any(contacts.damping > 0.0)
    a, v, load, loss = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n)
    k_eq, c_eq = np.zeros(m), np.zeros(m)
    events = np.empty((64, 3))
    happened = 0
    for step in range(first, first + count):
        t = step * dt
        for k in range(working):
            f = values[k, step - first]
            for i in range(n):
                load[i] = loads[k, i] * f if k == 0 else load[i] + loads[k, i] * f
        for i in range(n):
            a[i] = load[i]
        for k in range(working, loads.shape[0]):
            f = values[k, step - first]
            for i in range(n):
                a[i] += loads[k, i] * f
        subtract_product(matrices.stiffness, q, a)
        any_damper = False
        for j in range(m):
            u = _dot(contacts, j, q)
            s = u - contacts.gap[j]
            k_eq[j] = contact_stiffness(contacts.stiffness[j], s, contacts.resolution[j])
            if step == 0:
                if status[j] == CLOSED and contacts.resolution[j] == np.inf:
                    k_eq[j] = contacts.stiffness[j]
            elif (s > 0.0) != (status[j] == CLOSED):
                status[j] = CLOSED if s > 0.0 else OPEN
                if happened == events.shape[0]:
                    more = np.empty((2 * happened, 3))
                    more[:happened] = events
                    events = more
                before = _dot(contacts, j, state.q_before) - contacts.gap[j]
                part = before / (before - s) if before != s else 1.0
                events[happened, 0] = t - dt * (1.0 - min(max(part, 0.0), 1.0))
                events[happened, 1] = j
                events[happened, 2] = status[j]
                happened += 1
            reaction = k_eq[j] * (u - contacts.offset[j])
            if dampers:
                c_eq[j] = contacts.damping[j] * (k_eq[j] / contacts.stiffness[j])
                if c_eq[j] > 0.0:
                    any_damper = True
                    reaction += c_eq[j] * _dot(contacts, j, half)
            if reaction != 0.0:
                _subtract_row(contacts, j, reaction, a)
        if damped:
            subtract_product(matrices.damping, half, a)
        solve(matrices.factored, a)
        if any_damper:
            _implicit_dampers(contacts, c_eq, 0.5 * dt, a)
        for i in range(n):
            v[i] = half[i] + 0.5 * dt * a[i]
        lossy = damped or any_damper
        if lossy:
            # Minus the damping force.
            loss[:] = 0.0
            if damped:
                subtract_product(matrices.damping, v, loss)
            for j in range(m):
                if c_eq[j] > 0.0:
                    _subtract_row(contacts, j, c_eq[j] * _dot(contacts, j, v), loss)
        # Work and dissipation by the trapezoidal rule: this time ends one step and begins the next.
        if step > 0:
            if working > 0:
                state.work[0] += 0.5 * dt * np.dot(half, load)
            if lossy:
                state.dissipated[0] -= 0.5 * dt * np.dot(half, loss)
        cursor = _store(output, cursor, t, dt, step, state, v, a)
        state.q_before[:] = q
        state.v_before[:] = v
        state.a_before[:] = a
        state.work[1] = state.work[0]
        state.dissipated[1] = state.dissipated[0]
        for i in range(n):
            half[i] += dt * a[i]
            q[i] += dt * half[i]
        if working > 0:
            state.work[0] += 0.5 * dt * np.dot(half, load)
        if lossy:
            state.dissipated[0] -= 0.5 * dt * np.dot(half, loss)
    return cursor, events, happened


@jit
def _implicit_dampers(contacts: _Contacts, c_eq: Array, half_step: float, a: Array) -> None:
    """Correct the acceleration for closed contact dampers, which act on the mean of both half-step velocities."""
    m = c_eq.size
    system, right = np.eye(m), np.zeros(m)
    for j in range(m):
        right[j] = _dot(contacts, j, a)
        for i in range(m):
            system[j, i] += contacts.compliance[j, i] * c_eq[i] * half_step
    mean = np.linalg.solve(system, right)
    for j in range(m):
        if c_eq[j] > 0.0:
            force = c_eq[j] * half_step * mean[j]
            for i in range(a.size):
                a[i] -= contacts.shape[i, j] * force


@jit
def _store(output: _Output, cursor: int, t: float, dt: float, step: int, state: _State, v: Array, a: Array) -> int:
    """Store all times up to t: on the step as it is, inside it by the quintic through both ends."""
    while cursor < output.times.size and output.times[cursor] <= t + 1e-9 * dt:
        x = 1.0 - (t - output.times[cursor]) / dt
        if step == 0 or x >= 1.0 - 1e-9:
            x = 1.0
            output.q[:, cursor] = state.q
            output.v[:, cursor] = v
            output.a[:, cursor] = a
        else:
            for i in range(v.size):
                output.q[i, cursor], output.v[i, cursor], output.a[i, cursor] = quintic(
                    x, dt, state.q_before[i], state.v_before[i], state.a_before[i], state.q[i], v[i], a[i]
                )
        output.work[cursor] = x * state.work[0] + (1.0 - x) * state.work[1]
        output.dissipated[cursor] = x * state.dissipated[0] + (1.0 - x) * state.dissipated[1]
        cursor += 1
    return cursor
