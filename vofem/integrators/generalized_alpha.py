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
The ``a`` of the method lag by ``(alpha_f - alpha_m) dt``; accelerations that are told are put forward by as much.
Under the jump law the reaction may lie anywhere in [0, K0 gap] at the gap. A
contact damper and a springpot act by their mean over the step, extrapolated to
the time of balance; where a springpot of an order below some 0.02 is ten
thousand times stiffer than the structure, that may make energy too.

J. Chung, G. M. Hulbert, A time integration algorithm for structural dynamics with improved numerical dissipation:
the generalized-alpha method, J. Appl. Mech. 60 (1993) 371-375, https://doi.org/10.1115/1.2900803.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.errors import ArgumentError, ConvergenceError
from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.balance import Structure, balance, structure
from vofem.integrators.stepping.checks import check_times, look
from vofem.integrators.stepping.checks import watch as watch_of
from vofem.integrators.stepping.contact_solve import law
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.march import MOST_FACTORED, Banded, chunk, march, note_chatter, stored_energy, tally
from vofem.integrators.stepping.probes import tap
from vofem.integrators.stepping.recall import remember, tell_histories
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, output, rounding, store, switched, trail
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.integrators.watching import Snapshot, Watch
from vofem.laws import SpringpotLaws, initial_status
from vofem.laws.callbacks import callbacks_of
from vofem.laws.evaluate import closed_share, commit_all, loaded
from vofem.laws.rows import Rows, all_rows, compressed, dot, subtract_row
from vofem.laws.springpot import (
    FORCE,
    MEAN,
    NO_HISTORY,
    NO_PACE,
    NO_SPRINGPOTS,
    WORK,
    History,
    Pace,
    Springpots,
    carry_on,
    impose,
)
from vofem.laws.table import Laws, build_laws, with_state
from vofem.linalg.banded import factor, solve, subtract_product, to_band, widen
from vofem.linalg.jit import jit
from vofem.system import Counters, State, System

if TYPE_CHECKING:
    from vofem.integrators.stepping.history import Springpotted

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Energy out of nowhere, over the energies at work, that ends a run.
_BLOW_UP = 1.0

#: Default number of steps in a run.
_STEPS = 1000


class Parameters(NamedTuple):
    """The method's four numbers."""

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float


def parameters(
    rho_infinity: float = 0.8,
    alpha_m: float | None = None,
    alpha_f: float | None = None,
    gamma: float | None = None,
    newmark_beta: float | None = None,
) -> Parameters:
    """Return the parameters of the method, those given in place of Chung and Hulbert's.

    Raises
    ------
    ArgumentError
        Outside [0, 1] for rho_infinity, or where linear systems would not be stable.
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
    return Parameters(am, af, g, b)


class _Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped), and the structure of a step."""

    mass: Array
    stiffness: Array
    damping: Array
    structure: Structure


class _State(NamedTuple):
    """Displacement, velocity, acceleration, reactions without dampers, dampers' mean forces, status, laws' memory."""

    q: Array
    v: Array
    a: Array
    reaction: Array
    damper: Array
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
    **options: float,
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
    watch : callable, optional
        Told the time reached.
    resume : dict, optional
        A snapshot of the same run, from which to go on.
    probes : ProbeRows, optional
        Points to be recorded at every step.
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
    counters, notes = Counters(), []
    if dt is None:
        dt, why = followed(system, t_end / _STEPS, t_end)
        notes.append(f"step: dt = {dt:.6g} s was chosen{why or ', a thousandth of the run'}")
    steps = step_count(t_end, dt)
    stored = storage_times(times, t_end, dt, steps, system.size, notes)
    note_chatter(system, notes)
    note_loads(system, dt, t_end, notes)
    kernel = _GeneralizedAlpha(system, start, t_end, dt, steps, chosen, counters)
    points = tap(probes, kernel.bands.order)
    looks = check_times(t_end, dt, system.size), watch_of(system.contacts)
    out = output(stored, system.size, points, system.histories, kernel.laws.state.size, looks)
    return march(
        kernel, GENERALIZED_ALPHA, start, kernel.state.status.copy(), t_end, dt, out, notes,
        first_energy=stored_energy(system, start.q, start.v), blow_up=_BLOW_UP, watch=watch, resume=resume,
        probes=probes,
    )  # fmt: skip


class _GeneralizedAlpha:
    """One run at a fixed step."""

    place: tuple[str, ...] = ("done",)

    def __init__(
        self, system: System, start: State, t_end: float, dt: float, steps: int, chosen: Parameters,
        counters: Counters,
    ) -> None:  # fmt: skip
        self.dt, self.steps, self.done, self.parameters = dt, steps, 0, chosen
        am = chosen.alpha_m
        damping = damping_matrix(system, counters)
        self.bands = Banded(system, counters, system.mass, system.stiffness, damping)
        order, n = self.bands.order, system.size
        self.callbacks = callbacks_of(system.laws)
        self.laws = build_laws(system.laws, self.callbacks)
        self.rows = compressed(all_rows(system.laws), order)
        mass, stiffness = to_band(system.mass, order), to_band(system.stiffness, order)
        c = np.empty((0, n)) if damping is None else to_band(damping, order)
        answer = system.cache.get(
            "generalized-alpha matrix", (dt, chosen), lambda: self._factor(mass, stiffness, c, counters), MOST_FACTORED
        )
        self.matrices = _Matrices(mass, stiffness, c, answer)
        status = np.empty(0, dtype=np.int64)
        m = self.laws.table.size
        u, rate = np.zeros(m), np.zeros(m)
        rows = all_rows(system.laws)
        if rows is not None:
            u, rate = np.asarray(rows @ start.q), np.asarray(rows @ start.v)
        self.laws = loaded(self.laws, u, start.memory)
        if system.contacts is not None:
            status = initial_status(system.contacts, start.q, start.v)
        self.history, self.pace = NO_HISTORY, NO_PACE
        self.springpotted: Springpotted | None = None
        reaction = np.array([law(self.laws, j, u[j], u[j], False, 0.0, 0.0)[0] for j in range(m)])
        dampers = _start_dampers(self.laws, u, rate)
        springpots = system.group(SpringpotLaws)
        if springpots is not None:
            self._keep_history(start, counters)
            first = system.first_of(springpots)
            dampers[first : first + len(springpots)] = self.history.told[:, FORCE]
        # The matrix of a step tends to (1 - am) M as dt does to 0.
        second = (1.0 - am) * self.bands.answers(answer.factored, stiffness)
        self.loads = np.concatenate([self.bands.loads, second])
        self.bands.over.until = t_end
        self.at_start, beyond = self.bands.over.start(dt)
        # An impulse at t = 0 is a velocity: the steps would tell it late.
        answers = (1.0 - am) * self.bands.answers(answer.factored, np.ones((1, n)))
        self.kick = 0.5 * dt * (beyond @ answers)
        force = (self.at_start @ self.bands.loads)[self.bands.back] - system.stiffness @ start.q
        if damping is not None:
            force -= damping @ start.v
        if rows is not None:
            force -= rows.T @ (reaction + dampers)
        acceleration = force[order]
        solve(factor(mass, "the mass matrix"), acceleration)
        past = self.laws.state
        self.state = _State(
            start.q[order].copy(), start.v[order].copy(), acceleration, reaction, dampers, status, past
        )  # fmt: skip
        self.trail = trail(n, past)
        leave(self.trail, self.state.q, self.state.v, self.state.a)

    def _factor(self, mass: Array, stiffness: Array, c: Array, counters: Counters) -> Structure:
        """Return the structure of a step."""
        (am, af, gamma, beta), dt = self.parameters, self.dt
        width = max(mass.shape[0], stiffness.shape[0], c.shape[0]) - 1
        a = (1.0 - am) * widen(mass, width) + (1.0 - af) * beta * dt**2 * widen(stiffness, width)
        if c.size:
            a += (1.0 - af) * gamma * dt * widen(c, width)
        counters.factorizations += 1
        # Coordinates at the end answer to reactions there, or to dampers' forces over the step, weighted 1 - af.
        return structure(a, "the matrix of a step", self.rows, self.laws, beta * dt**2, 1.0 - af)

    def _keep_history(self, start: State, counters: Counters) -> None:
        """Let springpots keep their past."""
        from vofem.integrators.stepping.history import Springpotted

        self.springpotted = Springpotted(self.bands.system, self.dt, self.steps * self.dt, counters)
        self.history, self.pace = self.springpotted.begin(start), self.springpotted.pace(self.dt)
        self.place = (*self.place, "history")

    def _kick(self) -> None:
        """Give the structure the impulse of loads at t = 0; its work is what the kinetic energy gains."""
        if np.any(self.kick):
            gain = np.zeros(self.kick.size)
            subtract_product(self.matrices.mass, self.kick, gain)
            self.trail.work[:] -= float(gain @ (self.state.v + 0.5 * self.kick))
            self.state.v[:] += self.kick

    def load_values(self, first: int, count: int) -> Array:
        """Return the values of `loads` at some ends of steps, shape (2 n_loads, count)."""
        mean, second = self.bands.over.nodal(first, count, self.dt)
        return np.concatenate([mean, -0.5 * self.dt**2 * second])

    @property
    def finished(self) -> bool:
        """Whether the last step is done."""
        return self.done >= self.steps

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""
        return self.done * self.dt

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy at the stored times, J."""
        return kinetic_energy(self.bands.system, samples.v)

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        first = self.done
        count, springpots = min(chunk(self.state.q.size), self.steps - first), NO_SPRINGPOTS
        if self.springpotted is not None:
            count = self.springpotted.most_steps(count)
            springpots = self.springpotted.at((np.arange(first, first + count, dtype=float) + 0.5) * self.dt)
        if first == 0:
            look(out.watch, self.rows, self.dt, self.state.q, self.state.v)
            cursor = store(
                out, 0, 0.0, self.dt, True, self.trail, self.state.q, self.state.v, self.state.a, self.state.a
            )
            if self.state.memory.size:
                remember(self.laws, self.state.memory, self.rows, out, 0, cursor)
            tell_histories(self.history, out, 0, cursor, 0.0, self.dt)
        values = self.load_values(first, count + 1)
        if first == 0:
            values[: self.at_start.size, 0] = self.at_start
            self._kick()
        cursor, events, solves, failed = _advance(
            self.matrices, self.parameters, self.rows, with_state(self.laws, self.state.memory), self.loads,
            values, self.dt, first, count, self.state, self.trail, out, cursor, springpots, self.pace, self.history,
        )  # fmt: skip
        if self.callbacks is not None:
            self.callbacks.complain(self.dt)
        if failed >= 0:
            raise ConvergenceError(
                f"{GENERALIZED_ALPHA.name} found no solution of the step from t = {failed * self.dt:g} s at dt = "
                f"{self.dt:g} s; a nonlinear spring that softens may leave none, or the state has blown up: reduce dt"
            )
        self.done += count
        tally(self.bands, self.laws, self.callbacks, self.done, self.done)
        self.bands.counters.contact_solves += solves
        return cursor, events


def _start_dampers(laws: Laws, u: Array, rate: Array) -> Array:
    """Return the contact dampers' forces at t = 0: of a path of a millionth of the rate's own length scale."""
    forces = np.zeros(u.size)
    for j in np.flatnonzero(laws.table["damping"] > 0.0):
        ahead = u[j] + 1e-6 * abs(laws.table[j]["gap"] - u[j]) + 1e-9
        forces[j] = laws.table[j]["damping"] * rate[j] * closed_share(laws, int(j), u[j], ahead) / (ahead - u[j])
    return forces


@jit
def _advance(
    matrices: _Matrices, parameters: Parameters, rows: Rows, laws: Laws, loads: Array, values: Array, dt: float,
    first: int, count: int, state: _State, before: Trail, out: Output, cursor: int, springpots: Springpots,
    pace: Pace, history: History,
) -> tuple[int, Array, int, int]:  # fmt: skip
    """Take `count` steps; return the cursor, events, number of contact solves, and the step that failed or -1."""
    n, m, contacts = state.q.size, rows.start.size - 1, state.status.size
    am, af, gamma, beta = parameters
    q, v, a, seen = state.q, state.v, state.a, out.watch
    damped = matrices.damping.shape[0] > 0
    right, a1, q1, v1, load, loss = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    told = np.empty(n)
    u0, u1, base, none, drag, guess = np.empty(m), np.empty(m), np.empty(m), np.zeros(m), np.zeros(m), np.empty(m)
    # Dampers act by their mean over the step, which is extrapolated from its middle to the time of balance.
    ahead = 1.0 + (0.5 - af)
    weight = ahead / (dt * (1.0 - af))
    events = np.empty((16 if contacts else 0, 3))
    happened, solves = 0, 0
    for j in range(m):
        u0[j] = dot(rows, j, q)
    for step in range(first, first + count):
        t = (step + 1) * dt
        for i in range(n):
            q1[i] = q[i] + dt * (v[i] + dt * (0.5 - beta) * a[i])
            v1[i] = v[i] + dt * (1.0 - gamma) * a[i]
        for k in range(loads.shape[0]):
            f = (1.0 - af) * values[k, step + 1 - first] + af * values[k, step - first]
            for i in range(n):
                load[i] = loads[k, i] * f if k == 0 else load[i] + loads[k, i] * f
        for i in range(n):
            right[i] = load[i]
            a1[i] = am * a[i]
        subtract_product(matrices.mass, a1, right)
        for i in range(n):
            a1[i] = (1.0 - af) * q1[i] + af * q[i]
        subtract_product(matrices.stiffness, a1, right)
        if damped:
            for i in range(n):
                a1[i] = (1.0 - af) * v1[i] + af * v[i]
            subtract_product(matrices.damping, a1, right)
        for j in range(m):
            if state.reaction[j] != 0.0:
                subtract_row(rows, j, af * state.reaction[j], right)
        if history.y.shape[0] > 0:
            impose(springpots, pace, history, step - first, laws, u0, ahead - 1.0, 1.0 - af)
        if m == 0:
            a1[:] = right
            solve(matrices.structure.factored, a1)
        else:
            for j in range(m):
                base[j] = dot(rows, j, q1)
                guess[j] = state.reaction[j]
                # What the last step's damper takes from the extrapolation.
                drag[j] = (ahead - 1.0) * state.damper[j] / (1.0 - af)
            found = balance(
                laws, matrices.structure, rows, right, none, base, u0, False, weight, drag, guess, u1, a1
            )  # fmt: skip
            if found < 0:
                return cursor, events[:happened], solves, step
            solves += min(found, 1)
        for i in range(n):
            q1[i] += beta * dt * dt * a1[i]
            v1[i] += gamma * dt * a1[i]
        taken = 0.0
        if damped:
            loss[:] = 0.0
            subtract_product(matrices.damping, v, loss)
            taken -= 0.5 * dt * np.dot(loss, v)
            loss[:] = 0.0
            subtract_product(matrices.damping, v1, loss)
            taken -= 0.5 * dt * np.dot(loss, v1)
        if loads.shape[0] > 0:
            for k in range(loads.shape[0]):
                gain = 0.0
                for i in range(n):
                    gain += loads[k, i] * (q1[i] - q[i])
                before.work[0] += 0.5 * (values[k, step + 1 - first] + values[k, step - first]) * gain
        for j in range(m):
            u1[j] = dot(rows, j, q1)
            # The damper's part is not a force at the end: what is left is.
            state.reaction[j] = guess[j]
            if laws.table[j]["damping"] > 0.0:
                mean = laws.table[j]["damping"] * closed_share(laws, j, u0[j], u1[j]) / dt
                state.reaction[j] -= laws.table[j]["damping"] * weight * closed_share(laws, j, u0[j], u1[j]) - drag[j]
                state.damper[j] = mean
                taken += mean * (u1[j] - u0[j])
            if j < contacts:
                s = u1[j] - laws.table[j]["gap"]
                if switched(s, state.status[j], rounding(rows, j, laws.table[j]["gap"], q1, before)):
                    events = log_event(events, happened, j, t, dt, u0[j] - laws.table[j]["gap"], s)
                    state.status[j] = int(events[happened, 2])
                    happened += 1
            u0[j] = u1[j]
        if history.y.shape[0] > 0:
            _accept_history(springpots, pace, history, step - first, ahead - 1.0, 1.0 - af, state.reaction, laws, u1)
        before.dissipated[0] += taken
        q[:] = q1
        v[:] = v1
        for i in range(n):
            told[i] = a1[i] + (af - am) * (a1[i] - a[i])
        a[:] = a1
        wanted = cursor
        if out.every_step or (cursor < out.times.size and out.times[cursor] <= t + 1e-9 * dt):
            cursor = store(out, cursor, t, dt, False, before, q, v, told, told)
        if state.memory.size > 0:
            remember(laws, before.memory, rows, out, wanted, cursor)
            commit_all(laws, u1)
            before.memory[:] = state.memory
        if history.y.shape[0] > 0:
            tell_histories(history, out, wanted, cursor, t, dt)
        look(seen, rows, dt, q, v)
        leave(before, q, v, told)
    return cursor, events[:happened], solves, -1


@jit
def _accept_history(
    springpots: Springpots, pace: Pace, history: History, s: int, ahead: float, share: float, reaction: Array,
    laws: Laws, u1: Array,
) -> None:  # fmt: skip
    """Take step s: forces at its end are extrapolated from the means of the last two steps, and take part no longer."""
    told = history.told
    for i in range(told.shape[0]):
        j = springpots.row + i
        # The law of the step counts from where the step began.
        rate = (u1[j] - laws.table[j]["gap"]) / pace.dt
        mean = (share * reaction[j] + ahead * told[i, MEAN]) / (1.0 + ahead)
        told[i, WORK] += pace.dt * mean * rate
        told[i, FORCE] = 1.5 * mean - 0.5 * told[i, MEAN]
        carry_on(springpots, pace, history, i, s, rate, mean)
        reaction[j] = 0.0
