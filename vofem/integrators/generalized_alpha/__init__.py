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

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.errors import ArgumentError, ConvergenceError
from vofem.integrators.base import ProbeRows
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.balance import Structure, balance, law, structure
from vofem.integrators.stepping.checks import look
from vofem.integrators.stepping.doubling import Attempt, StepDoubling, impact
from vofem.integrators.stepping.implicit import Asked, Doubled, implicit_run
from vofem.integrators.stepping.ladder import RUNGS
from vofem.integrators.stepping.march import MOST_FACTORED
from vofem.integrators.stepping.recall import remember, tell_histories
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import EqualSteps, Matrices, Setting
from vofem.integrators.watching import Snapshot, Watch
from vofem.laws import SpringpotLaws
from vofem.laws.evaluate import closed_share, commit_all
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot import FORCE, MEAN, WORK, History, Pace, Springpots, carry_on, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.banded import factor, solve, subtract_product, widen
from vofem.linalg.jit import jit
from vofem.system import Counters, State, System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Energy that no load has supplied, over the largest energy, that ends a run.
_BLOW_UP = 1.0


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


class _Size(NamedTuple):
    """What belongs to a step size: the matrices of a step, its load vectors and what it does to springpots' past."""

    dt: float
    parameters: Parameters
    matrices: Matrices
    structure: Structure
    loads: Array
    pace: Pace


class _State(NamedTuple):
    """State: q, v, a, reactions without dampers, mean forces of dampers, status, internal variables."""

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
    tol: float | None = None,
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

    def equal(counters: Counters, dt: float, steps: int) -> _FixedSteps:
        kernel = _FixedSteps(system, start, counters, t_end, chosen)
        kernel.plan(dt, steps)
        return kernel

    made = Doubled(equal, lambda counters: _AdaptiveSteps(system, start, counters, t_end, chosen))
    asked = Asked(system, start, t_end, times, dt, tol, watch, resume, probes)
    return implicit_run(GENERALIZED_ALPHA, made, asked, _BLOW_UP)


class _Alpha(Setting):
    """The state of a run, how it begins, and the matrices of its step sizes."""

    def __init__(self, system: System, start: State, counters: Counters, t_end: float, chosen: Parameters) -> None:
        super().__init__(system, start, counters, t_end)
        self.parameters = chosen
        order, u = self.bands.order, self.u
        rate = np.zeros(0) if self.every_row is None else np.asarray(self.every_row @ start.v)
        reaction = np.array([law(self.laws, j, x, x, False, 0.0, 0.0)[0] for j, x in enumerate(u.tolist())])
        self.state = _State(
            start.q[order].copy(), start.v[order].copy(), np.zeros(system.size), reaction,
            _start_dampers(self.laws, u, rate), self.status, self.laws.state,
        )  # fmt: skip
        self.sizes: dict[float, _Size] = {}

    def size_of(self, dt: float) -> _Size:
        """Return what belongs to a step size in s."""
        if dt not in self.sizes:
            made = self.bands.system.cache.get(
                "generalized-alpha matrix", (dt, self.parameters), lambda: self._factor(dt), MOST_FACTORED
            )
            # The matrix of a step tends to (1 - am) M as dt does to 0.
            second = (1.0 - self.parameters.alpha_m) * self.bands.answers(made.factored, self.matrices.stiffness)
            loads = np.concatenate([self.bands.loads, second])
            self.sizes[dt] = _Size(dt, self.parameters, self.matrices, made, loads, self.pace(dt))
        return self.sizes[dt]

    def _factor(self, dt: float) -> Structure:
        """Return the structure of a step."""
        (am, af, gamma, beta), (mass, stiffness, c) = self.parameters, self.matrices
        width = max(part.shape[0] for part in self.matrices) - 1
        a = (1.0 - am) * widen(mass, width) + (1.0 - af) * beta * dt**2 * widen(stiffness, width)
        if c.size:
            a += (1.0 - af) * gamma * dt * widen(c, width)
        self.bands.counters.factorizations += 1
        # Coordinates at the end answer to reactions there, or to dampers' forces over the step, weighted 1 - af.
        return structure(a, "the matrix of a step", self.rows, self.laws, beta * dt**2, 1.0 - af)

    def begin(self, dt: float) -> None:
        """Find the acceleration at t = 0, and what loads that are short against a step of a size do there."""
        system, start, order = self.bands.system, self.start, self.bands.order
        springpots = system.group(SpringpotLaws)
        if springpots is not None:
            first = system.first_of(springpots)
            self.state.damper[first : first + len(springpots)] = self.history.told[:, FORCE]
        self.at_start, beyond = self.bands.over.start(dt)
        # An impulse at t = 0 becomes an initial velocity; by steps it would act late.
        unit = np.ones((1, system.size))
        answers = (1.0 - self.parameters.alpha_m) * self.bands.answers(self.size_of(dt).structure.factored, unit)
        self.kick = 0.5 * dt * (beyond @ answers)
        force = (self.at_start @ self.bands.loads)[self.bands.back] - system.stiffness @ start.q
        if self.damping is not None:
            force -= self.damping @ start.v
        if self.every_row is not None:
            force -= self.every_row.T @ (self.state.reaction + self.state.damper)
        self.state.a[:] = force[order]
        solve(factor(self.matrices.mass, "the mass matrix"), self.state.a)
        self.begin_trail(self.state.a)

    def store_start(self, out: Output, dt: float) -> int:
        """Store the state at t = 0; return the output cursor. Then give the structure the impulse of loads there."""
        state = self.state
        look(out.watch, self.rows, dt, state.q, state.v)
        cursor = store(out, 0, 0.0, dt, True, self.trail, state.q, state.v, state.a, state.a)
        if state.memory.size:
            remember(self.laws, state.memory, self.rows, out, 0, cursor)
        tell_histories(self.history, out, 0, cursor, 0.0, dt)
        if np.any(self.kick):
            gain = np.zeros(self.kick.size)
            subtract_product(self.matrices.mass, self.kick, gain)
            # The work of the impulse is what the kinetic energy gains.
            self.trail.work[:] -= float(gain @ (state.v + 0.5 * self.kick))
            state.v[:] += self.kick
        return int(cursor)

    def steps_of(
        self, dt: float, first: int, count: int, springpots: Springpots, out: Output, cursor: int
    ) -> tuple[int, Array, int, int]:
        """Take steps of a size; return output cursor, events, contact solves, and the step that failed or -1."""
        values = self.nodal_loads(first, count + 1, dt)
        if first == 0:
            values[: self.at_start.size, 0] = self.at_start
        found: tuple[int, Array, int, int] = _advance(
            self.size_of(dt), self.rows, with_state(self.laws, self.state.memory), values, first, count, self.state,
            self.trail, out, cursor, springpots, self.history,
        )  # fmt: skip
        return found


class _FixedSteps(EqualSteps, _Alpha):
    """A run of equal steps."""

    lag = 0

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        super().plan(dt, steps)
        self.begin(dt)

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        if first == 0:
            cursor = self.store_start(out, self.dt)
        cursor, events, solves, failed = self.steps_of(self.dt, first, count, springpots, out, cursor)
        self.complain(self.dt)
        if failed >= 0:
            raise ConvergenceError(
                f"{GENERALIZED_ALPHA.name} found no solution of the step from t = {failed * self.dt:g} s at dt = "
                f"{self.dt:g} s; a nonlinear spring that softens may leave none, or the state has blown up: reduce dt"
            )
        self.done += count
        self.count(self.done, self.done, solves)
        return cursor, events


class _AdaptiveSteps(StepDoubling, _Alpha):
    """A run of steps chosen by their error.

    The acceleration of the method is that at ``(alpha_f - alpha_m) dt`` before the end of a step, so it is moved where
    the size of steps changes (M. Arnold, O. Brüls, Multibody Syst. Dyn. 18 (2007) 185-202,
    https://doi.org/10.1007/s11044-007-9084-0).
    """

    place = (*StepDoubling.place, "last", "gain")
    lag = 0
    method = GENERALIZED_ALPHA

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        super().plan(t_end, tolerance, fineness)
        #: Size of the last step in s, 0 before the first one, and what the acceleration gained in it.
        self.last, self.gain = 0.0, np.zeros(self.state.q.size)
        self.unseen = self.output(np.zeros(0), None)
        self.begin(self.length(self.rung + 1))

    @property
    def displacement(self) -> Array:
        """Displacements where the run stands."""
        return self.state.q

    def _parts(self, out: Output) -> tuple[NDArray[Any], ...]:
        """Return all arrays that a step changes, but those of states that are stored."""
        return *self.state, *self.trail, *self.history, out.watch, out.tap.filled, out.past

    def _one_step(self, dt: float, number: int, out: Output, cursor: int) -> tuple[int, Array, int]:
        """Take the step of a number and a size; return output cursor, events, and contact solves or -1."""
        am, af, before = self.parameters.alpha_m, self.parameters.alpha_f, self.state.a.copy()
        if self.last > 0.0:
            self.state.a[:] += (af - am) * (1.0 - dt / self.last) * self.gain
            before[:] = self.state.a
        springpots = self.springpots(np.array([(number + 0.5) * dt]))
        cursor, events, solves, failed = self.steps_of(dt, number, 1, springpots, out, cursor)
        self.last, self.gain = dt, self.state.a - before
        return cursor, events, solves if failed < 0 else -1

    def attempt(self, out: Output, cursor: int) -> Attempt:
        """Take the next step whole, and again in halves, which stay."""
        half = self.length(self.rung + 1)
        number = self.now // 2 ** (RUNGS - self.rung)
        if self.now == 0:
            self.begin(half)
        self.before = [part.copy() for part in self._parts(out)], self.last, self.gain
        if self.now == 0:
            cursor = self.store_start(out, half)
        begun = [part.copy() for part in self._parts(out)]
        solves, (q, v) = self._one_step(2.0 * half, number, self.unseen, 0)[2], self.state[:2]
        whole = q.copy(), v.copy()
        _put(self._parts(out), begun)
        self.last, self.gain = self.before[1:]
        path, found = [(q.copy(), v.copy(), self.state.reaction.copy())], []
        for k in range(2):
            cursor, events, more = self._one_step(half, 2 * number + k, out, cursor)
            found.append(events)
            if more < 0 or solves < 0:
                return Attempt(-1)
            solves += more
            path.append((q.copy(), v.copy(), self.state.reaction.copy()))
        self.halves = cursor, np.concatenate(found)
        acts, kick = self._impact(half, path)
        error = (whole[0] - q) / 3.0
        rough = float(np.max(self.weight * np.abs(error), initial=0.0))
        if acts:
            # Where a stop is stiff, steps of any size end at it: their displacements agree, their velocities do not.
            rough = max(rough, float(np.max(self.weight * np.abs(whole[1] - v))) * 2.0 * half / 3.0)
        return Attempt(solves, rough, float(np.max(self.weight * np.abs(self._smooth(error)), initial=0.0)), kick)

    def _smooth(self, error: Array) -> Array:
        """Return ``((1 - am) A^-1 M)^2`` of an error, A of steps eight times as long: what the step resolves well."""
        factored = self.size_of(self.length(max(self.rung - 3, 0))).structure.factored
        for _ in range(2):
            moved = np.zeros(error.size)
            subtract_product(self.matrices.mass, error, moved)
            solve(factored, moved)
            error = -(1.0 - self.parameters.alpha_m) * moved
        return error

    def _impact(self, dt: float, path: list[tuple[Array, Array, Array]]) -> tuple[bool, float]:
        """Return what `stepping.doubling.impact` finds along two halves of a step."""
        if self.every_row is None:
            return False, 0.0
        u, rates = (np.array([self._along @ part[k] for part in path]) for k in (0, 1))
        reactions = np.array([part[2] for part in path[1:]])
        found: tuple[bool, float] = impact(self.laws, self.status.size, dt, u, rates, reactions, self.fineness)
        return found

    @cached_property
    def _along(self) -> csr_matrix:
        """Rows of the laws in band order."""
        assert self.every_row is not None
        return self.every_row[:, self.bands.order]

    def take(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Keep the halves."""
        return self.halves

    def withdraw(self, out: Output) -> None:
        """Return to where the step began."""
        parts, self.last, self.gain = self.before
        _put(self._parts(out), parts)


def _put(target: Sequence[NDArray[Any]], saved: Sequence[NDArray[Any]]) -> None:
    """Copy arrays into others."""
    for mine, other in zip(target, saved, strict=True):
        mine[...] = other


def _start_dampers(laws: Laws, u: Array, rate: Array) -> Array:
    """Return the contact dampers' forces at t = 0: of a path of a millionth of the rate's own length scale."""
    forces = np.zeros(u.size)
    for j in np.flatnonzero(laws.table["damping"] > 0.0):
        ahead = u[j] + 1e-6 * abs(laws.table[j]["gap"] - u[j]) + 1e-9
        forces[j] = laws.table[j]["damping"] * rate[j] * closed_share(laws, int(j), u[j], ahead) / (ahead - u[j])
    return forces


@jit
def _advance(
    size: _Size, rows: Rows, laws: Laws, values: Array, first: int, count: int, state: _State, before: Trail,
    out: Output, cursor: int, springpots: Springpots, history: History,
) -> tuple[int, Array, int, int]:  # fmt: skip
    """Take `count` steps; return the cursor, events, number of contact solves, and the step that failed or -1."""
    n, m, contacts = state.q.size, rows.start.size - 1, state.status.size
    dt, parameters, matrices, structure, loads, pace = size
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
            solve(structure.factored, a1)
        else:
            for j in range(m):
                base[j] = dot(rows, j, q1)
                guess[j] = state.reaction[j]
                # What the last step's damper takes from the extrapolation.
                drag[j] = (ahead - 1.0) * state.damper[j] / (1.0 - af)
            found = balance(
                laws, structure, rows, right, none, base, u0, False, weight, drag, guess, u1, a1
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
