"""A run in time steps: bands, matrices of step sizes, loads, chunks of steps, and checkpoints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.errors import ConvergenceError, InstabilityError
from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.method import Method
from vofem.integrators.registry import advice
from vofem.integrators.rounding import static_loss
from vofem.integrators.stepping.checks import check_times, contact_checks
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.kernel import Equations, Rules, Size, advance, work_space
from vofem.integrators.stepping.movement import Movement
from vofem.integrators.stepping.reactions import ABSENT, ACTS, HOLDS, PUSHES, begin_reactions
from vofem.integrators.stepping.record import Path, Record, Switches, hysteretic_energy
from vofem.integrators.stepping.scheme import Forcing, Loaded, Scheme
from vofem.integrators.stepping.step_loads import StepLoads
from vofem.kernels.mode import compiled
from vofem.laws import initial_status
from vofem.laws.group import StepPast
from vofem.laws.law import DAMPING, FEWEST_IN_BAND, STORED, LawSet, ask
from vofem.laws.python import callbacks_of
from vofem.laws.rows import Rows, all_rows, compressed
from vofem.linalg.banded import band_order, band_width, factor, solve, subtract_product, to_band, widen
from vofem.system import CLOSED, Counters, State, System

if TYPE_CHECKING:
    from vofem.integrators.stepping.sliding import Sliders


#: Relative loss of static responses to rounding above which rounding is named as the cause of a blow-up.
_SPOILT = 1e-3

#: Entries of states that one call of a kernel advances: some milliseconds of work.
_CHUNK_WORK = 200_000

#: The same in plain Python.
_PLAIN_WORK = 10_000

#: Steps of one call at most.
_MOST_STEPS = 8192

#: Rows of a path for steps that are cut.
_ROOM = 40

#: Factored matrices of a method that are kept with a system: those of all step sizes that `tol` tries, and some more.
_MOST_FACTORED = 48


class Run:
    """A run of a method from its start, by steps of sizes that `advance` of a derived class chooses.

    Attributes
    ----------
    system : System
    counters : Counters
    method : Method
    scheme : Scheme
    order, back : ndarray of int, shape (n,)
        The unknowns in the order of the bands, and the place of each.
    path : Path
    switches : Switches
    dt : float, optional
        Size of all steps in s; None where they follow a tolerance.
    place : tuple of str
        Names of the attributes that, beside these records, make up the state of the run.
    """

    place: tuple[str, ...] = ("solves",)
    dt: float | None = None

    def __init__(
        self, system: System, start: State, counters: Counters, t_end: float, method: Method, scheme: Scheme,
        room: int, shortest: float, longest: float,
    ) -> None:  # fmt: skip
        self.system, self.start, self.counters, self.method, self.scheme = system, start, counters, method, scheme
        self.t_end, self.solves = t_end, 0
        self.damping = damping_matrix(system, counters)
        matrices = [m for m in (system.mass, system.stiffness, self.damping) if m is not None]
        self.order = order = _order(system, matrices)
        self.back = np.empty(system.size, dtype=np.int64)
        self.back[order] = np.arange(system.size)
        self.vectors = np.array([load.vector[order] for load in system.loads]).reshape(-1, system.size)
        self.over = StepLoads(system, counters)
        self.over.until = t_end
        self.callbacks = callbacks_of(system.laws)
        every_row = all_rows(system.laws)
        rows = compressed(every_row, order)
        self.rows = None if every_row is None else every_row[:, order].tocsr()
        q, v = start.q[order], start.v[order]
        u = np.zeros(0) if self.rows is None else np.asarray(self.rows @ q)
        self.movement: Movement | None = None
        if any(group.moving is not None for group in system.laws):
            assert self.rows is not None
            now, self.movement = np.zeros(1), Movement(system.laws, self.rows, order)
            self.movement.begin_ties(q, v)
            self.start = State(q[self.back], v[self.back], start.internal)
            u = self.movement.along(q[None, :], now)[0] + self.movement.offsets(now)[0, 0]
            u = np.where(self.movement.present(now)[0], u, self.movement.away)
        self.laws = LawSet(system.laws, self.callbacks)
        self.laws.load(u, start.internal)
        self.sliders: Sliders | None = None
        if system.sliders is not None:
            from vofem.integrators.stepping.sliding import Sliders

            self.sliders = Sliders(system, self.laws, self.rows, q, v)
        self.travels = self.movement is not None and self.movement.travels
        self.special = self.travels or (self.sliders is not None and self.sliders.special)
        laws = self.laws.records
        damping = np.empty((0, system.size)) if self.damping is None else to_band(self.damping, order)
        self.equations = Equations(
            to_band(system.mass, order), to_band(system.stiffness, order), damping, rows, laws
        )  # fmt: skip
        self._lossy = None if self.damping is None else self.damping[order][:, order].tocsr()
        self.dampers = any(law.damped for law in self.laws.laws)
        self.dissipating: IntArray | None = None
        if self.travels:
            counted = [np.full(len(group), not group.recorded) for group in system.laws]
            self.dissipating = np.flatnonzero(np.concatenate(counted))
        self.past: StepPast | None = None
        for group in system.laws:
            past = group.past_in_steps(system.first_of(group), shortest, longest)
            if past is not None:
                # A rough run before the run itself takes fewer.
                counters.history_terms = max(counters.history_terms, past.terms)
                self.past = past
        pots = 0 if self.past is None else self.past.count
        sliders = 0 if self.sliders is None else len(self.sliders.laws)
        self.path = Path(room + 2, system.size, laws, pots, scheme.lags, sliders)
        status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            status = initial_status(system.contacts, start.q, start.v)
        self.initial = status
        self.switches = Switches(system.contacts, self.rows, status)
        self.sizes: dict[float, Loaded] = {}
        self._space: Any = None
        self._of: Size | None = None
        chunk = self.path.chunk
        chunk.q[0], chunk.v[0], chunk.u[0], chunk.past[0] = q, v, u, laws.state
        self.kick, self.load = np.zeros(0), np.zeros(system.size)

    # -- matrices -------------------------------------------------------------------------------------

    def size(self, dt: float) -> Loaded:
        """Return the matrix of a step size in s, and its answers to loads."""
        if dt not in self.sizes:
            if len(self.sizes) > _MOST_FACTORED:
                # Steps that are cut have many sizes.
                del self.sizes[next(iter(self.sizes))]
            size = self.system.cache.get(
                "matrix of a step", (dt, self.scheme), lambda: self._size(dt), _MOST_FACTORED
            )  # fmt: skip
            mass, stiffness = self.equations[:2]
            moved = self.vectors.copy()
            for answer in moved:
                solve(size.factored, answer)
            loads = np.concatenate([self.vectors, _products(stiffness, moved)])
            self.sizes[dt] = Loaded(size, loads, dt * moved, dt * _products(mass, moved))
        return self.sizes[dt]

    def _size(self, dt: float) -> Size:
        """Return the factored matrix of a step size, and the way in which reactions are found."""
        numbers, (mass, stiffness, damping, rows, _) = self.scheme.numbers(dt), self.equations
        b, m = numbers.b, len(self.laws)
        bands = [(mass, 1.0), (damping, b * dt * numbers.cvw), (stiffness, b * dt**2 * numbers.cqw)]
        bands = [(band, factor) for band, factor in bands if band.size and factor]
        width = max(band.shape[0] for band, _ in bands) - 1
        a = np.sum([factor * widen(band, width) for band, factor in bands], axis=0)
        self.counters.factorizations += 1
        factored = factor(a, "the mass matrix" if self.scheme.explicit else "the matrix of a step")
        width = max(width, *(_spread(rows, j) for j in range(m))) if m else width
        if m == 0 or self.travels:
            return Size(numbers, factored, np.zeros((0, 0)), False)
        if not self.special and _band_pays(self.laws, self.system.size, width):
            return Size(numbers, factored, widen(a, width), True)
        assert self.rows is not None
        dense = self.rows.toarray()
        answers = dense.copy()
        for answer in answers:
            solve(factored, answer)
        compliance = dense @ answers.T
        return Size(numbers, factored, 0.5 * (compliance + compliance.T), False)

    # -- loads ------------------------------------------------------------------------------------------

    def moments(self, moments: Array, dt: float) -> Forcing:
        """Return the loads of steps of one size by their moments, shape (3, n_loads, steps)."""
        means = np.concatenate([moments[0], -0.5 * dt**2 * moments[2]]).T
        return Forcing(means, means, moments[1].T if self.sliders is None else np.zeros(moments[1].T.shape))

    def _acting(self, values: Array) -> int:
        """Return how many of the vectors in `Loaded.loads` act: slow loads move nothing within steps."""
        count = self.vectors.shape[0]
        return 2 * count if np.any(values[:, count:]) else count

    # -- the start --------------------------------------------------------------------------------------

    def begin(self, dt: float) -> None:
        """Find forces and acceleration at t = 0 for a first step of a size in s."""
        chunk, scheme, system = self.path.chunk, self.scheme, self.system
        pots = np.zeros(0) if self.past is None else self.past.begin(self.start, dt if scheme.explicit else None)
        chunk.pots[0, :, 0] = self.path.pull[0] = pots
        if scheme.mean:
            return
        u, rate = chunk.u[0], self.rates(0)
        reaction = np.array([float(self.laws.force(j, u[[j]])[0]) for j in range(u.size)])
        if scheme.explicit:
            force = self.over.nodal(0, 1, dt)
            values = np.concatenate([force[0], -0.5 * dt**2 * force[1]])[:, 0]
            load = values @ self.size(dt).loads
            self._begin_explicit(reaction, chunk.damper[0], rate)
        else:
            # An impulse at t = 0 becomes an initial velocity; by steps it would act late.
            self.at_start, beyond = self.over.start(dt)
            self.kick = 0.5 * (beyond @ self.size(dt).shift)
            load = self.at_start @ self.vectors
            chunk.damper[0] = self._start_dampers(u, rate)
            reaction = reaction + chunk.damper[0]
        if self.past is not None:
            reaction[self.past.row : self.past.row + self.past.count] = pots
        self._accelerate(self.path, 0, 0.0, dt, load if load.size else np.zeros(system.size), reaction)
        chunk.reaction[0] = reaction if scheme.explicit else reaction - chunk.damper[0]
        if self.past is not None and not scheme.explicit:
            chunk.reaction[0, self.past.row : self.past.row + self.past.count] = 0.0

    def restart(self, path: Path, t: float, dt: float, forcing: Forcing) -> None:
        """Find forces and acceleration anew after the last step of a path, where forces jump at a time in s.

        Laws that act by their mean forces do not need them.
        """
        if self.scheme.mean:
            return
        row = path.filled
        u, rate = path.chunk.u[row], self.rates(row)
        self.laws.state[:] = path.chunk.past[row]
        reaction = np.array([float(self.laws.force(j, u[[j]])[0]) for j in range(u.size)])
        damper = self._start_dampers(u, rate)
        load = forcing.values[-1, : self.vectors.shape[0]] @ self.vectors + np.zeros(self.system.size)
        reaction += damper
        self._accelerate(path, row, t, dt, load, reaction)
        path.chunk.damper[row] = damper
        path.chunk.reaction[row] = reaction if self.scheme.explicit else reaction - damper

    def rates(self, row: int) -> Array:
        """Return the rates of the laws' coordinates at a row of the path, shape (m,)."""
        v, q, t = self.path.chunk.v[row], self.path.chunk.q[row], self.path.t[row : row + 1]
        if self.rows is None:
            return np.zeros(0)
        if self.movement is not None:
            return self.movement.rates(q[None, :], v[None, :], t)[0]
        return np.asarray(self.rows @ v)

    def _accelerate(self, path: Path, row: int, t: float, dt: float, load: Array, reaction: Array) -> None:
        """Find the acceleration at a row of a path, at a time in s, for the forces of laws; steps of dt in s follow.

        Forces of rows that hold, or push, are found here and entered.
        """
        chunk, mass = path.chunk, factor(self.equations.mass, "the mass matrix")
        a = load.copy()
        subtract_product(self.equations.stiffness, chunk.q[row], a)
        if self._lossy is not None:
            subtract_product(self.equations.damping, chunk.v[row], a)
        if self.special:
            a = self._constrained(path, row, t + dt * np.arange(3.0), mass, a, reaction)
        else:
            if self.rows is not None:
                a -= self.rows.T @ reaction
            solve(mass, a)
        chunk.a[row] = path.out[row] = a

    def _constrained(self, path: Path, row: int, times: Array, mass: Array, right: Array, reaction: Array) -> Array:
        """Return the acceleration at a row of a path that brings rows that hold to their places at the second time.

        Sliders whose force would be beyond the limit slide instead.
        """
        assert self.rows is not None
        chunk, dt = path.chunk, float(times[1] - times[0])
        now = later = self.rows.toarray()
        if self.movement is not None:
            now, later = self.movement.matrix(times[:2]).toarray().reshape(2, *now.shape)
        status = np.empty(0, dtype=np.int64) if self.sliders is None else self.sliders.now.status.copy()
        drift, answers = self._drift(path, row, times), now.copy()
        for answer in answers:
            solve(mass, answer)
        while True:
            rules = self._rules(times, status)
            kind, push = rules.kind[0], rules.push[0]
            pressed = np.where(rules.pressing >= 0, np.maximum(reaction[np.maximum(rules.pressing, 0)], 0.0), 1.0)
            reaction[kind == PUSHES] = (push * pressed)[kind == PUSHES]
            held = np.flatnonzero(kind == HOLDS)
            reaction[held] = reaction[kind == ABSENT] = 0.0
            a = right - reaction @ now
            solve(mass, a)
            anchored = rules.anchored[held]
            place = later @ (dt * chunk.v[row] + 0.5 * dt**2 * a) + drift[0, 1]
            place = place[held] + np.where(anchored, -drift[0, 0, held], later[held] @ chunk.q[row])
            if held.size:
                forces = np.linalg.solve(0.5 * dt**2 * (later[held] @ answers[held].T), place)
                a -= forces @ answers[held]
                reaction[held] = forces
            if self.sliders is None:
                return a
            bound = self.sliders.static * self.sliders.normals(times[:1], None)[0] * pressed[self.sliders.rows]
            force = reaction[self.sliders.rows]
            over = self.sliders.rigid & (status == 0) & (np.abs(force) > bound * (1.0 + 1e-9))
            if not np.any(over):
                return a
            status = np.where(over, np.sign(force), status).astype(np.int64)

    def _begin_explicit(self, reaction: Array, damper: Array, rate: Array) -> None:
        """Enter the forces of contacts at t = 0, which follow their status there, and those of their dampers."""
        laws = self.system.contacts
        if laws is None:
            return
        m, u = len(laws), self.path.chunk.u[0]
        share = np.where(self.initial == CLOSED, 1.0, 0.0)
        share = np.where(np.isinf(laws.resolution), share, laws.shares(u[:m] - laws.gap))
        damper[:m] = share * laws.damping * rate[:m]
        reaction[:m] = share * laws.elastic(u[:m]) + damper[:m]

    def _start_dampers(self, u: Array, rate: Array) -> Array:
        """Return the contact dampers' forces at t = 0: of a path of a millionth of the rate's own length scale."""
        forces = np.zeros(u.size)
        for j, law in enumerate(self.laws.laws):
            if law.damped:
                ahead = u[j] + 1e-9 + max((1e-6 * abs(kink - u[j]) for kink in self.laws.kinks(j)[:1]), default=0.0)
                forces[j] = rate[j] * ask(self.laws.records, j, DAMPING, float(u[j]), float(ahead))
        return forces

    # -- steps ------------------------------------------------------------------------------------------

    def steps(self, path: Path, dt: float, t: Array, forcing: Forcing, pots: Any) -> int:
        """Take some steps of one size on from the last row of a path, without entering them; return contact solves.

        Parameters
        ----------
        path : Path
        dt : float
            In s.
        t : ndarray, shape (steps,)
            Times at which the steps end, s.
        forcing : Forcing
        pots
            What `StepPast.over` returns for the steps, or None.

        Returns
        -------
        solves : int
            Negative where there is no solution; `taken` is the number of steps before that.
        """
        if self.sliders is None or not self.sliders.chosen:
            return self.advanced(path, dt, t, forcing, pots)
        first, self.taken = path.filled, 0
        for k, end in enumerate(t.tolist()):
            if not self.sliders.step(self, path, dt, end, forcing.at(k), cut=False):
                break
            self.taken, path.filled = k + 1, path.filled + 1
        path.filled = first
        return self.taken if self.taken == t.size else -1

    def advanced(
        self, path: Path, dt: float, t: Array, forcing: Forcing, pots: Any, status: IntArray | None = None
    ) -> int:  # fmt: skip
        """Take steps as `steps` does, with the statuses of sliders, shape (k,), where they are given."""
        known, values, n = self.size(dt), forcing.values, self.system.size
        force = shift = np.empty((0, n))
        if self.vectors.size:
            count = self._acting(values)
            force = values[:, :count] @ known.loads[:count]
            if self.scheme.mean and np.any(forcing.first):
                shift = forcing.first @ known.shift
        chunk, size, times = path.steps(t.size), known.size, np.append(t[0] - dt, t)
        equations, drift, rules = self.equations, None, None
        if self.movement is not None or (self.sliders is not None and self.sliders.belts) or self.special:
            ahead = np.append(times, t[-1] + dt)
            drift = self._drift(path, path.filled, ahead)
            if self.special:
                rules = self._rules(ahead, status)
            if self.travels:
                assert self.movement is not None
                assert rules is not None
                rows, rates = self.movement.rows(ahead)
                equations, rules = equations._replace(rows=rows), rules._replace(rates=rates)
        earlier = path.chunk.a[max(path.filled - 1, 0)] if self.scheme.mean else None
        self.taken, solves = advance(
            equations, *size[:3], self.dampers, pots, drift, rules, force, shift, earlier, chunk, self._work(size)
        )
        if self.callbacks is not None:
            self.callbacks.complain(dt)
        return -1 if self.taken < t.size else solves

    def _drift(self, path: Path, row: int, times: Array) -> Array:
        """Return offsets of the laws' coordinates at times, m, and their rates, (2, n_times, m), on from a row."""
        drift = np.zeros((2, times.size, len(self.laws)))
        if self.movement is not None:
            drift = self.movement.offsets(times)
        if self.sliders is not None and self.sliders.belts:
            mine, sliders = self.sliders.rows, self.sliders
            drift[0, :, mine] = path.chunk.u[row, mine] - sliders.matrix @ path.chunk.q[row]
            drift[0, 1:, mine] -= np.cumsum(sliders.ways(times), axis=0)
            drift[1, :, mine] = -np.array([sliders.speeds(float(t)) for t in times])
        return drift

    def _rules(self, times: Array, status: IntArray | None) -> Rules:
        """Return what rows do in steps between all times but the last one, which is a step ahead."""
        m, steps, scheme = len(self.laws), times.size - 2, self.scheme
        kind, push = np.full((steps, m), ACTS), np.zeros((steps, m))
        present, away = np.ones((steps + 1, m), dtype=bool), np.zeros(m)
        anchored, springs = np.zeros((2, m), dtype=bool)
        pressing, normal = np.full(m, -1), np.zeros((steps + 1, m))
        if self.movement is not None:
            present, away = self.movement.present(times[:-1]), self.movement.away
            kind[:, self.movement.tied] = HOLDS
            kind[~(present[1:] & present[:-1])] = ABSENT
        if self.sliders is not None:
            mine, sliders = self.sliders.rows, self.sliders
            status = sliders.now.status if status is None else status
            kind[:, mine], push[:, mine] = sliders.kinds(status, sliders.normals(times[:-1], scheme.part))
            anchored[mine], pressing[mine], normal[:, mine] = True, sliders.pressing, sliders.normals(times[:-1], None)
            springs[mine] = ~sliders.rigid & sliders.varying
        return Rules(
            m if self.travels else 0, self.equations.rows, kind, present, away, anchored, push, pressing, springs,
            normal,
        )  # fmt: skip

    def _work(self, size: Size) -> Any:
        """Return work space."""
        if self._space is None:
            self._space = work_space(self.equations, size)
        if self._of is not size:
            self._of, work, numbers = size, self._space[0], size.numbers
            begin_reactions(
                work.reactions, numbers.way, numbers.per_y, numbers.part, size.coupling, size.factored, size.banded
            )  # fmt: skip
        return self._space[0]

    def enter(self, path: Path, dt: float, t: Array, forcing: Forcing) -> None:
        """Enter steps that were taken into a path: their times and energies, and the switches of contacts."""
        known, count, scheme = self.size(dt), t.size, self.scheme
        q, v, a, u, reaction, damper, _, pots = path.steps(count)
        first = path.filled
        path.t[first + 1 : first + count + 1], path.dt[first + 1 : first + count + 1] = t, dt
        rows = slice(first + 1, first + count + 1)
        way = u[1:] - u[:-1]
        path.work[rows], path.dissipated[rows] = 0.0, 0.0
        # Velocities jump where sliding ends, after the step.
        rate = 0.5 * (v[1:] + v[:-1]) if self.sliders is None else v[:-1] + 0.5 * dt * a[1:]
        if self.vectors.size and scheme.mean and self.sliders is None:
            along = v @ known.loads.T
            along = 0.5 * (along[1:] + along[:-1])
            if np.any(forcing.first):
                along -= forcing.first @ (known.shift @ known.loads.T)
                path.work[rows] = dt * np.einsum("ke,ke->k", a[1:] @ known.inertia.T, forcing.first)
            path.work[rows] += dt * np.einsum("ke,ke->k", along, forcing.means)
        elif self.vectors.size:
            acting = self._acting(forcing.means)
            along = q @ known.loads[:acting].T
            path.work[rows] = np.einsum("ke,ke->k", along[1:] - along[:-1], forcing.means[:, :acting])
        if self.movement is not None or self.sliders is not None:
            path.work[rows] += self._driven(path, dt, t)
        if self._lossy is not None:
            if scheme.mean:
                if np.any(forcing.first):
                    rate = rate - forcing.first @ known.shift
                path.dissipated[rows] = dt * np.einsum("ki,ki->k", rate, (self._lossy @ rate.T).T)
            else:
                pull = (self._lossy @ v.T).T
                power = 0.5 * dt * np.einsum("ki,ki->k", v, pull) if not scheme.explicit else np.zeros(0)
                if scheme.explicit:
                    half = v[:-1] + 0.5 * dt * a[:-1]
                    path.dissipated[rows] = 0.5 * dt * np.einsum("ki,ki->k", half, pull[1:] + pull[:-1])
                else:
                    path.dissipated[rows] = power[1:] + power[:-1]
        if self.dampers:
            own = slice(self.initial.size) if self.dissipating is None else self.dissipating
            damper = damper[:, own]
            mean = 0.5 * (damper[1:] + damper[:-1]) if scheme.explicit else damper[1:]
            path.dissipated[rows] += np.einsum("kj,kj->k", mean, way[:, own])
        if self.sliders is not None:
            lost, jumps = self.sliders.enter(path, first, count, scheme.mean)
            path.dissipated[rows] += lost
            path.work[first + 1] += jumps
        if self.past is not None:
            mine = slice(self.past.row, self.past.row + self.past.count)
            mean = 0.5 * (reaction[1:, mine] + reaction[:-1, mine]) if scheme.explicit else pots[1:, :, 0]
            path.absorbed[rows] = mean * way[:, mine]
        if scheme.lags:
            out = path.out[rows]
            np.subtract(a[1:], a[:-1], out=out)
            out *= scheme.alpha_f - scheme.alpha_m
            out += a[1:]
        path.filled += count
        self.switches.step_on(path, count, self.t_end)

    def _driven(self, path: Path, dt: float, t: Array) -> Array:
        """Return the work in J over steps of what moves stops, points and belts, by their ends in s."""
        rows, times = slice(path.filled, path.filled + t.size + 1), np.append(t[0] - dt, t)
        q, u, reaction, damper = (
            part[rows] for part in (path.chunk.q, path.chunk.u, path.chunk.reaction, path.chunk.damper)
        )  # fmt: skip
        mine, acts = slice(None), np.ones((t.size, u.shape[1]), dtype=bool)
        if self.movement is not None and not self.special and self.sliders is None:
            mine = slice(self.initial.size)
        mean = reaction[1:] if self.scheme.mean else 0.5 * (reaction[1:] + reaction[:-1])
        if not self.scheme.mean and not self.scheme.explicit:
            mean = mean + damper[1:]
        moved = np.diff(self._drift(path, path.filled, times)[0], axis=0)
        if self.special and not self.scheme.mean:
            # Rows that hold or push act at the time of balance.
            beside = self._rules(np.append(times, t[-1] + dt), None).kind[0] != ACTS
            mean = np.where(beside, reaction[1:], mean)
        if not self.travels:
            return np.einsum("kj,kj->k", mean[:, mine], moved[:, mine])
        assert self.movement is not None
        present = self.movement.present(times)
        acts = present[1:] & present[:-1]
        way, half = np.diff(q, axis=0), 0.5
        along = half * (self.movement.along(way, times[:-1]) + self.movement.along(way, times[1:]))
        moved = np.where(acts, np.diff(u, axis=0) - along, 0.0)
        work = np.einsum("kj,kj->k", mean, moved)
        laws = self.equations.laws
        for k, j in np.argwhere(present[1:] ^ present[:-1]).tolist():
            # What a law stores when its point leaves the beam is lost to it.
            ends = [float(u[i, j]) for i in (k, k + 1)]
            work[k] += ask(laws, j, STORED, ends[1], ends[1]) - ask(laws, j, STORED, ends[0], ends[0])
        return np.asarray(work)

    def take(self, out: Record) -> None:
        """Record the states of the path that are complete."""
        out.take(self.path, self.scheme.mean, self.scheme.explicit, 0 if self.past is None else self.past.row)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        raise NotImplementedError

    def advance(self, out: Record) -> None:
        """Take some steps, at least one."""
        raise NotImplementedError

    def reached(self) -> float:
        """Return the time of the last state that is complete, s."""
        return float(self.path.t[0])

    def count(self, steps: int, evaluations: int) -> None:
        """Set the counters of steps, and of evaluations of laws and dampers."""
        counters, system = self.counters, self.system
        counters.steps, counters.contact_solves = steps, self.solves
        counters.gap_evaluations = self.initial.size * evaluations
        counters.memory_updates = sum(law.remembers for law in self.laws.laws) * evaluations
        if self.callbacks is not None:
            counters.law_evaluations = self.callbacks.calls
        if system.damped:
            counters.damping_evaluations = evaluations
        if self.past is not None:
            counters.history_updates = self.past.count * evaluations

    # -- energies ---------------------------------------------------------------------------------------

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy of the method's own balance, J."""
        energy = kinetic_energy(self.system, samples.v)
        if not self.scheme.explicit:
            return energy
        assert self.dt is not None
        # That of the velocities half a step before and after.
        return energy - (0.5 * self.dt) ** 2 * kinetic_energy(self.system, samples.a)

    def uncounted(self) -> float:
        """Return a bound on the energy that loads have given beyond the work that is counted, J.

        In explicit steps it is what the loads at the last step give to a body at rest in half a step: the velocity at
        a step contains half a step of the present loads, whose work is counted with the velocities half a step before
        and after.
        """
        if not self.scheme.explicit or not self.vectors.size:
            return 0.0
        assert self.dt is not None
        impulse = self.load.copy()
        solve(self.size(self.dt).size.factored, impulse)
        return 0.125 * self.dt**2 * float(self.load @ impulse)

    def in_springs(self, out: Record) -> tuple[float, float]:
        """Return the energies in J that hysteretic springs store, and have dissipated, at the last complete state.

        The work that springpots have absorbed counts as dissipated here.
        """
        absorbed = float(np.sum(out.total[2:]))
        chunk = self.path.chunk
        elastic = 0.0 if self.sliders is None else float(self.sliders.stored(chunk.past[:1])[0].sum())
        if not self.system.histories or not self.laws.state.size:
            return elastic, absorbed
        energy, loss = hysteretic_energy(self.equations.laws, chunk.past[0], chunk.u[0])
        return elastic + energy, loss + absorbed

    def blown_up(self, energy: str, dt: float) -> InstabilityError:
        """Return the error of a run whose energy in J is more than the loads can have supplied."""
        loss = static_loss(self.system)
        smaller = f"reduce dt = {dt:g} s" if self.dt is not None else "reduce tol"
        if loss > _SPOILT:
            cure = (
                f"rounding spoils {min(loss, 1.0):.0%} of static responses on this mesh: use fewer elements or a mesh "
                f"less graded, or choose {advice(exact=True)}"
            )
        elif self.method.conserves:
            cure = f"{smaller}, or choose {advice(exact=True)} where it applies"
        else:
            cure = f"{smaller}, or choose {advice(exact=True)}, or {advice(conserves=True)} where that does not apply"
        return InstabilityError(f"{self.method.name} blew up before t = {self.reached():g} s: energy {energy}; {cure}")

    def lost(self, what: str, cure: str) -> ConvergenceError:
        """Return the error of a step without a solution."""
        blown = "" if self.method.conserves else ", or the state has blown up"
        return ConvergenceError(
            f"{self.method.name} {what}; a nonlinear spring that softens may leave none{blown}: {cure}"
        )

    # -- records ----------------------------------------------------------------------------------------

    def record(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Record:
        """Return an empty record of the run at some times, and of points at every step.

        Where the end of the run in s is given, the record also holds what the checks of the run need.
        """
        system, further, table = self.system, np.empty(0), contact_checks(None)
        if t_end is not None:
            further, table = check_times(t_end, self.dt, system.size), contact_checks(system.contacts)
        return Record(
            times, further, system.size, self.equations.laws, system.histories, self.path.pull.shape[1], table, probes,
            self.rows, self.order, None if self.movement is None else self.movement.of_contacts,
        )  # fmt: skip

    def saved(self) -> dict[str, Any]:
        """Return the state of the run as plain data."""
        return {
            "path": self.path.saved(),
            "status": self.switches.status,
            "size": self.switches.size,
            "place": {name: getattr(self, name) for name in self.place},
        } | (
            ({} if self.past is None else {"history": self.past.y})
            | ({} if self.sliders is None else {"sliders": self.sliders.saved()})
        )

    def restore(self, saved: dict[str, Any]) -> None:
        """Set the run to a saved state."""
        self.path.restore(saved["path"])
        self.switches.status, self.switches.size = saved["status"], saved["size"]
        for name, value in saved["place"].items():
            setattr(self, name, value)
        if self.past is not None:
            self.past.y[:] = saved["history"]
        if self.sliders is not None:
            self.sliders.restore(saved["sliders"])


class EqualSteps(Run):
    """A run of equal steps, taken in chunks.

    `done`: steps that were taken. Where laws act by means there is one beyond the end.
    `nodes`: what stands for the loads' values at the end of the last step.
    """

    place = (*Run.place, "done", "nodes")
    dt: float

    def __init__(
        self, system: System, start: State, counters: Counters, t_end: float, method: Method, scheme: Scheme,
        dt: float, steps: int,
    ) -> None:  # fmt: skip
        work = _CHUNK_WORK if compiled() else _PLAIN_WORK
        self._most = int(np.clip(work // max(system.size, 1), 1, _MOST_STEPS))
        beyond = 1 if scheme.mean else 0
        self.dt, self.steps_in_all, self.done = dt, steps + beyond, 0
        self.nodes: Array | None = None
        room = min(self._most, steps + beyond) + (_ROOM if system.sliders is not None else 0)
        longest = (steps + beyond + scheme.explicit) * dt
        super().__init__(system, start, counters, t_end, method, scheme, room, dt, longest)
        self.begin(dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done >= self.steps_in_all

    def advance(self, out: Record) -> None:
        """Take some steps.

        Raises `ConvergenceError` where a step has no solution.
        """
        dt, first, scheme, path = self.dt, self.done, self.scheme, self.path
        count = min(self._most, self.steps_in_all - first)
        pots = None
        if self.past is not None:
            count = self.past.most_steps(count)
            # An explicit step needs the orders of the step after it too.
            pots = self.past.over(dt, (np.arange(first, first + count + scheme.explicit, dtype=float) + 0.5) * dt)
        t = np.arange(first + 1, first + count + 1, dtype=float) * dt
        if scheme.mean:
            forcing = self.moments(self.over.steps(first, count, dt), dt)
        else:
            nodes = self._nodal(first, count)
            b = 1.0 - scheme.alpha_f
            values, means = b * nodes[1:] + (1.0 - b) * nodes[:-1], 0.5 * (nodes[1:] + nodes[:-1])
            forcing = Forcing(values, means, np.empty((0, self.vectors.shape[0])))
            self.nodes = nodes[-1]
        with self.kicked(path):
            if self.sliders is not None and self.sliders.chosen:
                solves = self.taken = self.sliders.steps(self, path, t, forcing)
                solves = -1 if self.sliders.lost else solves
            else:
                solves = self.steps(path, dt, t, forcing, pots)
                if self.taken:
                    self.enter(path, dt, t[: self.taken], Forcing(*(part[: self.taken] for part in forcing)))
        if self.taken and scheme.explicit:
            self.load = nodes[self.taken] @ self.size(dt).loads
        self.done += self.taken
        self.take(out)
        self.solves += max(solves, 0)
        done = min(self.done, self.steps_in_all - (1 if scheme.mean else 0))
        self.count(done, done + (1 if scheme.explicit and self.finished else 0))
        if solves < 0:
            t_lost = (first + self.taken) * dt
            raise self.lost(f"found no solution of the step from t = {t_lost:g} s at dt = {dt:g} s", "reduce dt")

    def _nodal(self, first: int, count: int) -> Array:
        """Return what stands for the loads' values at the ends of steps, shape (count + 1, 2 n_loads)."""
        begin = 0 if self.nodes is None else 1
        mean, second = self.over.nodal(first + begin, count + 1 - begin, self.dt)
        values = np.concatenate([mean, -0.5 * self.dt**2 * second]).T
        if self.nodes is not None:
            values = np.vstack([self.nodes, values])
        if first == 0 and not self.scheme.explicit:
            values[0, : self.at_start.size] = self.at_start
        return values

    @contextmanager
    def kicked(self, path: Path) -> Iterator[None]:
        """Give the structure within this block the impulse that loads have at t = 0, where the run stands there."""
        if self.path.t[0] > 0.0 or self.path.filled > 0 or not np.any(self.kick):
            yield
            return
        v = path.chunk.v[0].copy()
        path.chunk.v[0] += self.kick
        try:
            yield
        finally:
            path.chunk.v[0] = v
            # The work of the impulse is what the kinetic energy gains.
            gain = _products(self.equations.mass, self.kick[None, :])[0]
            path.work[0] = float(gain @ (v + 0.5 * self.kick))


def _order(system: System, matrices: list[Any]) -> IntArray:
    """Return an order that keeps matrices narrow and, where laws are many, their rows too, if both can be had."""
    order, rows = band_order(*matrices), all_rows(system.laws)
    if rows is None or rows.shape[0] < FEWEST_IN_BAND:
        return order
    pairs = abs(rows).T @ abs(rows)
    together = band_order(*matrices, pairs)
    return together if band_width(together, *matrices, pairs) <= 2 * band_width(order, *matrices) + 2 else order


def _products(band: Array, vectors: Array) -> Array:
    """Return the products of a band with vectors, shape (k, n)."""
    result = np.zeros(vectors.shape)
    for vector, product in zip(vectors, result, strict=True):
        subtract_product(band, vector, product)
    return -result


def _band_pays(laws: LawSet, n: int, width: int) -> bool:
    """Return whether a Newton step costs less in the band than through the compliance, half of the laws acting.

    The compliance is always used where a spring softens, because the band may then not be positive definite, and where
    a force jumps, because Newton's method on all unknowns then stalls.
    """
    m = len(laws)
    costly = m >= FEWEST_IN_BAND and m**3 / 24.0 + 1.5 * m**2 > 8.0 * n * (width + 1.0) ** 2
    return costly and all(law.rising for law in laws.laws)


def _spread(rows: Rows, j: int) -> int:
    """Return the largest distance of two columns of row j."""
    columns = rows.column[rows.start[j] : rows.start[j + 1]]
    return int(columns.max() - columns.min()) if columns.size else 0
