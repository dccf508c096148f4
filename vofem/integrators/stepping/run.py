"""A run in time steps: bands, matrices of step sizes, loads, chunks of steps, checkpoints, and the solution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError, InstabilityError
from vofem.integrators.base import Energies, ProbeRows, Samples, SpringSamples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.method import Method
from vofem.integrators.observer import Observer, Snapshot, deferred_interrupts
from vofem.integrators.registry import advice
from vofem.integrators.rounding import static_loss
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.checks import check_times, contact_checks
from vofem.integrators.stepping.energies import contact_energy, kinetic_energy, stored_energy, strain_energy
from vofem.integrators.stepping.kernel import Equations, Numbers, Size, advance, work_space
from vofem.integrators.stepping.quality import Checked, quality_notes
from vofem.integrators.stepping.record import Path, Record, Switches, hysteretic_energy
from vofem.integrators.stepping.step_loads import StepLoads
from vofem.kernels.mode import compiled
from vofem.laws import initial_status
from vofem.laws.group import StepPast
from vofem.laws.law import DAMPING, FEWEST_IN_BAND, LawSet, ask
from vofem.laws.python import callbacks_of
from vofem.laws.rows import Rows, all_rows, compressed
from vofem.linalg.banded import band_order, band_width, factor, solve, subtract_product, to_band, widen
from vofem.system import CLOSED, Counters, Events, State, System

if TYPE_CHECKING:
    from vofem.integrators.stepping.slide import Sliders
    from vofem.integrators.stepping.travel import Midpoint, Travel

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Relative loss of static responses to rounding above which rounding is named as the cause of a blow-up.
_SPOILT = 1e-3

#: Entries of states that one call of a kernel advances: some milliseconds of work.
_CHUNK_WORK = 200_000

#: The same in plain Python.
_PLAIN_WORK = 10_000

#: Steps of one call at most.
_MOST_STEPS = 8192

#: Factored matrices of a method that are kept with a system: those of all step sizes that `tol` tries, and some more.
_MOST_FACTORED = 48


class Scheme(NamedTuple):
    """The numbers that make the steps of `kernel` those of a method.

    Attributes
    ----------
    alpha_m, alpha_f, gamma, beta : float
    mean : bool
        Whether laws act by their mean forces over a step, and not by those at its end.
    """

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    mean: bool = False

    @property
    def explicit(self) -> bool:
        """Whether the displacement at the end of a step does not depend on forces there."""
        return self.beta == 0.0

    @property
    def lags(self) -> bool:
        """Whether the accelerations of the method belong to times before the ends of steps."""
        return not self.mean and self.alpha_m != self.alpha_f

    def numbers(self, dt: float) -> Numbers:
        """Return the numbers of a step size in s."""
        am, af, gamma, beta, mean = self
        share = am / (1.0 - am)
        return Numbers(
            dt, 1.0 - af, 0.5 - beta - beta * share, beta / (1.0 - am), 1.0 - gamma - gamma * share,
            gamma / (1.0 - am), am, mean, 0.0 if mean else 0.5 - af,
        )  # fmt: skip


class Forcing(NamedTuple):
    """Loads over some steps: combinations of the vectors in `Loaded`.

    Attributes
    ----------
    values, means : ndarray, shape (steps, 2 n_loads)
        Of the loads and of what they move within steps: in the balance of a step, and over it.
    first : ndarray, shape (steps, n_loads)
        First moments over the steps, used where laws act by means.
    """

    values: Array
    means: Array
    first: Array


class Loaded(NamedTuple):
    """What loads do in steps of one size: a step's matrix and its answers to load vectors F.

    Attributes
    ----------
    size : Size
    loads : ndarray, shape (2 n_loads, n)
        F and ``K A^-1 F``.
    shift, inertia : ndarray, shape (n_loads, n)
        ``dt A^-1 F`` and M times it.
    """

    size: Size
    loads: Array
    shift: Array
    inertia: Array


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
        every_row = all_rows([group for group in system.laws if group is not system.sliders])
        rows = compressed(every_row, order)
        self.rows = None if every_row is None else every_row[:, order].tocsr()
        q, v = start.q[order], start.v[order]
        u = np.zeros(0) if self.rows is None else np.asarray(self.rows @ q)
        self.moving = None if system.contacts is None else system.contacts.moving
        if self.moving is not None:
            self.moving = self.moving.ordered(order)
            u[: self.moving.weights.shape[0]] += self.moving.at(0.0)
        self.travel: Travel | None = None
        if any(group.travelling is not None for group in system.laws):
            from vofem.integrators.stepping.travel import begin_ties, travel_of

            assert self.rows is not None
            self.travel = travel_of(system.laws, self.rows.toarray(), order)
            begin_ties(self.travel, q, v)
            self.start = State(q[self.back], v[self.back], start.internal)
            at_start, offsets, present = (part[0] for part in self.travel.rows(np.zeros(1)))
            u = np.where(present, at_start @ q + offsets, self.travel.away)
        self.sliders: Sliders | None = None
        if system.sliders is not None:
            from vofem.integrators.stepping.slide import Sliders

            ordinary = np.empty((0, system.size)) if self.rows is None else self.rows.toarray()
            self.sliders = Sliders(system, ordinary, order, q, v)
        self.laws = LawSet(system.laws, self.callbacks)
        self.laws.load(u, start.internal)
        laws = self.laws.records
        damping = np.empty((0, system.size)) if self.damping is None else to_band(self.damping, order)
        self.equations = Equations(
            to_band(system.mass, order), to_band(system.stiffness, order), damping, rows, laws
        )  # fmt: skip
        self._lossy = None if self.damping is None else self.damping[order][:, order].tocsr()
        self.dampers = any(law.damped for law in self.laws.laws)
        self.past: StepPast | None = None
        for group in system.laws:
            past = group.past_in_steps(system.first_of(group), shortest, longest)
            if past is not None:
                # A rough run before the run itself takes fewer.
                counters.history_terms = max(counters.history_terms, past.terms)
                self.past = past
        pots = 0 if self.past is None else self.past.count
        self.path = Path(room + 2, system.size, laws, pots, scheme.lags)
        status = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            status = initial_status(system.contacts, start.q, start.v)
        self.initial = status
        self.switches = Switches(system.contacts, self.rows, status)
        self.sizes: dict[float, Loaded] = {}
        self._midpoints: dict[float, Midpoint] = {}
        chunk = self.path.chunk
        chunk.q[0], chunk.v[0], chunk.u[0], chunk.past[0] = q, v, u, laws.state
        self.kick, self.load = np.zeros(0), np.zeros(system.size)

    # -- matrices -------------------------------------------------------------------------------------

    def size(self, dt: float) -> Loaded:
        """Return the matrix of a step size in s, and its answers to loads."""
        if dt not in self.sizes:
            size = self.system.cache.get(
                "matrix of a step", (dt, self.scheme, self.travel is None), lambda: self._size(dt), _MOST_FACTORED
            )
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
        if m == 0 or self.travel is not None or self.sliders is not None:
            return Size(numbers, factored, None, None)
        if _band_pays(self.laws, self.system.size, width):
            return Size(numbers, factored, None, widen(a, width))
        assert self.rows is not None
        dense = self.rows.toarray()
        answers = dense.copy()
        for answer in answers:
            solve(factored, answer)
        compliance = dense @ answers.T
        return Size(numbers, factored, 0.5 * (compliance + compliance.T), None)

    # -- loads ------------------------------------------------------------------------------------------

    def moments(self, moments: Array, dt: float) -> Forcing:
        """Return the loads of steps of one size by their moments, shape (3, n_loads, steps)."""
        means = np.concatenate([moments[0], -0.5 * dt**2 * moments[2]]).T
        return Forcing(means, means, moments[1].T)

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
        u = chunk.u[0]
        rate = np.zeros(0) if self.rows is None else np.asarray(self.rows @ chunk.v[0])
        if self.moving is not None:
            rate[: self.moving.weights.shape[0]] += self.moving.rate(0.0)
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
        a = load.copy() if load.size else np.zeros(system.size)
        subtract_product(self.equations.stiffness, chunk.q[0], a)
        if self._lossy is not None:
            subtract_product(self.equations.damping, chunk.v[0], a)
        if self.rows is not None:
            a -= self.rows.T @ reaction
        solve(factor(self.equations.mass, "the mass matrix"), a)
        chunk.a[0] = self.path.out[0] = a
        chunk.reaction[0] = reaction if scheme.explicit else reaction - chunk.damper[0]
        if self.past is not None and not scheme.explicit:
            chunk.reaction[0, self.past.row : self.past.row + self.past.count] = 0.0

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
        known, values, n = self.size(dt), forcing.values, self.system.size
        force = shift = np.empty((0, n))
        if self.vectors.size:
            count = self._acting(values)
            force = values[:, :count] @ known.loads[:count]
            if self.scheme.mean and np.any(forcing.first):
                shift = forcing.first @ known.shift
        chunk, size = path.steps(t.size), known.size
        if self.sliders is not None:
            from vofem.integrators.stepping.slide import advance_sliding

            self.taken, solves, self.driven, self.rubbed = advance_sliding(
                self.sliders, self._midpoint(dt), self.equations.laws, np.append(t[0] - dt, t), force, chunk
            )
            return -1 if self.taken < t.size else solves
        if self.travel is not None:
            from vofem.integrators.stepping.travel import advance_travelling

            self.taken, solves, self.driven = advance_travelling(
                self.travel, self._midpoint(dt), self.equations.laws, np.append(t[0] - dt, t), force, shift,
                path.chunk.a[max(path.filled - 1, 0)], chunk,
            )  # fmt: skip
            return -1 if self.taken < t.size else solves
        self.taken, solves = advance(
            self.equations, size.numbers, size.factored, size.compliance, size.band, self.dampers, pots,
            self._drift(np.append(t[0] - dt, t)), force, shift, path.chunk.a[max(path.filled - 1, 0)], chunk,
            self._work(size),
        )  # fmt: skip
        if self.callbacks is not None:
            self.callbacks.complain(dt)
        return -1 if self.taken < t.size else solves

    def _midpoint(self, dt: float) -> Midpoint:
        """Return the matrices of steps of a size in s where something travels."""
        if dt not in self._midpoints:
            from vofem.integrators.stepping.travel import midpoint

            self._midpoints[dt] = midpoint(self.system, self.damping, self.order, dt)
        return self._midpoints[dt]

    def _drift(self, times: Array) -> Array | None:
        """Return offsets of the laws' coordinates at times, m, and their rates, (2, n_times, n_laws); None if zero."""
        if self.moving is None:
            return None
        drift = np.zeros((2, times.size, len(self.laws)))
        contacts = slice(self.moving.weights.shape[0])
        drift[0, :, contacts], drift[1, :, contacts] = self.moving.at(times).T, self.moving.rate(times).T
        return drift

    def _work(self, size: Size) -> Any:
        """Return work space."""
        if not hasattr(self, "_space"):
            self._space = work_space(self.system.size, len(self.laws), size)
        return self._space

    def enter(self, path: Path, dt: float, t: Array, forcing: Forcing) -> None:
        """Enter steps that were taken into a path: their times and energies, and the switches of contacts."""
        known, count, scheme = self.size(dt), t.size, self.scheme
        q, v, a, u, reaction, damper, _, pots = path.steps(count)
        first = path.filled
        path.t[first + 1 : first + count + 1], path.dt[first + 1 : first + count + 1] = t, dt
        rows = slice(first + 1, first + count + 1)
        way = u[1:] - u[:-1]
        path.work[rows], path.dissipated[rows] = 0.0, 0.0
        if self.sliders is not None:
            # Steps that are cut have several mean velocities; energies were found with these.
            path.work[rows], path.dissipated[rows] = self.driven[:count], self.rubbed[:count]
            path.filled += count
            self.switches.step_on(path, count, self.t_end)
            return
        if self.vectors.size and scheme.mean:
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
        if self.travel is not None:
            # What drives a point along the beam, and what moves a stop, does work against its force.
            path.work[rows] += self.driven[:count]
        elif self.moving is not None:
            # What moves a stop does work against its force.
            contacts = slice(self.moving.weights.shape[0])
            force = reaction[:, contacts]
            mean = force[1:] if scheme.mean else 0.5 * (force[1:] + force[:-1])
            if not scheme.mean and not scheme.explicit:
                mean = mean + damper[1:, contacts]
            moved = np.diff(self.moving.at(np.append(t[0] - dt, t)).T, axis=0)
            path.work[rows] += np.einsum("kj,kj->k", mean, moved)
        if self._lossy is not None:
            if scheme.mean:
                rate = 0.5 * (v[1:] + v[:-1])
                if np.any(forcing.first):
                    rate -= forcing.first @ known.shift
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
            own = slice(self.initial.size) if self.travel is None else self.travel.dissipating
            damper = damper[:, own]
            mean = 0.5 * (damper[1:] + damper[:-1]) if scheme.explicit else damper[1:]
            path.dissipated[rows] += np.einsum("kj,kj->k", mean, way[:, own])
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
        if self.sliders is not None:
            return float(self.sliders.history(0.0).stored(np.array([self.reached()]))[0]), 0.0
        if not self.laws.state.size:
            return 0.0, absorbed
        energy, loss = hysteretic_energy(self.equations.laws, chunk.past[0], chunk.u[0])
        return energy, loss + absorbed

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
            self.rows, self.order, self.moving,
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

    Attributes
    ----------
    done : int
        Steps that were taken. Where laws act by means there is one beyond the end.
    nodes : ndarray, optional
        What stands for the loads' values at the end of the last step.
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
        room, longest = min(self._most, steps + beyond), (steps + beyond + scheme.explicit) * dt
        super().__init__(system, start, counters, t_end, method, scheme, room, dt, longest)
        self.begin(dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done >= self.steps_in_all

    def advance(self, out: Record) -> None:
        """Take some steps.

        Raises
        ------
        ConvergenceError
            Where a step has no solution.
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
            solves = self.steps(path, dt, t, forcing, pots)
            if self.taken:
                self.enter(path, dt, t[: self.taken], Forcing(*(part[: self.taken] for part in forcing)))
                if scheme.explicit:
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


def march(
    run: Run, out: Record, notes: list[str], dt: float, *, first_energy: float, blow_up: float,
    observer: Observer | None, resume: Snapshot | None, probes: ProbeRows | None,
) -> SteppedSolution:  # fmt: skip
    """Run to the end, or until interrupted, and return the solution.

    Parameters
    ----------
    run : Run
    out : Record
    notes : list of str
    dt : float
        Size of a step, s.
    first_energy : float
        At t = 0, in the method's own form and without hysteretic springs, J.
    blow_up : float
        Energy that no load has supplied, over the largest energy, that ends a run.
    observer : callable, optional
    resume : dict, optional
        A snapshot of the same run, from which to go on.
    probes : ProbeRows, optional
        Points that are recorded at every step.

    Raises
    ------
    InstabilityError
        If energy grows beyond what the loads can have done, or a state is no longer finite.
    """
    system, counters, start, t_end = run.system, run.counters, run.start, run.t_end
    in_springs = run.in_springs(out)[0]
    energy = stored_energy(system, start.q, start.v) + in_springs
    log, missing, wanted_end = list[Array](), (0.0, 0.0), t_end
    if resume is not None:
        run.restore(resume["run"])
        out.restore(resume["record"])
        vars(counters).update(vars(resume["counters"]))
        notes[:], log, missing = resume["notes"], [resume["log"]], tuple(resume["missing"])

    def snapshot() -> Snapshot:
        return {
            "run": run.saved(), "record": out.saved(), "counters": counters, "notes": list(notes),
            "log": np.concatenate([np.empty((0, 3)), *log]), "missing": list(missing),
        }  # fmt: skip

    with deferred_interrupts() as interrupted:
        while not run.finished:
            run.advance(out)
            log += run.switches.log
            run.switches.log = []
            excess = _check(run, out, energy, dt, blow_up)
            if run.method.conserves and abs(excess) > abs(missing[0]):
                missing = excess, run.reached()
            stop = interrupted() and not run.finished
            if observer is not None:
                observer(run.reached(), snapshot, stop)
            if stop:
                kept = np.flatnonzero(out.wanted[: out.cursor])
                if not kept.size:
                    raise KeyboardInterrupt
                notes.append(
                    f"interrupted at t = {run.reached():g} s of {t_end:g} s: what was computed until then is here"
                )
                t_end = float(out.times[kept[-1]])
                break
    time, which, entered = np.concatenate([np.empty((0, 3)), *log]).T
    events = Events(time.copy(), which.astype(np.int64), entered.astype(np.int64), run.initial)
    counters.events = events.time.size
    first_energy += in_springs
    done = np.arange(out.cursor)
    checked = done[np.isin(out.times[done], check_times(wanted_end, run.dt, system.size))]
    times, samples, parts, _ = _outcome(run, out, checked)
    found = Checked(times, samples, parts, out.contact_checks, missing)
    notes += quality_notes(system, run.method, found, events, first_energy, run.dt, wanted_end)
    points = None if probes is None else out.probe_samples(wanted_end * (1.0 + 1e-12))
    times, samples, parts, springs = _outcome(run, out, done[out.wanted[done]])
    return SteppedSolution(
        system, t_end, times, samples, parts, first_energy, dt, events, counters, notes, springs, points,
        None if run.sliders is None else run.sliders.history(t_end),
    )  # fmt: skip


def _outcome(run: Run, out: Record, rows: IntArray) -> tuple[Array, Samples, Energies, SpringSamples | None]:
    """Return times, states, energies and hysteretic springs at some of the stored times."""
    system = run.system
    samples = Samples(*(np.ascontiguousarray(part[rows].T[run.back]) for part in (out.q, out.v, out.a)))
    strain, dissipated, springs = strain_energy(system, samples.q, out.times[rows]), out.dissipated[rows], None
    if system.recorded:
        force, energy, loss = out.histories[:, :, rows]
        springs = SpringSamples(force, energy, loss, out.past)
        strain = strain + springs.stored.sum(axis=0)
        dissipated = dissipated + springs.dissipated.sum(axis=0)
    if run.sliders is not None:
        strain = strain + run.sliders.history(0.0).stored(out.times[rows])
    contact = contact_energy(system.contacts, samples.q, out.times[rows])
    return (
        out.times[rows],
        samples,
        Energies(run.kinetic(samples), strain, contact, dissipated, out.work[rows]),
        springs,
    )


def _check(run: Run, out: Record, first: float, dt: float, blow_up: float) -> float:
    """Return the error in J of the balance of energy at the time reached; raise if it shows that the run blew up."""
    (in_springs, loss), chunk = run.in_springs(out), run.path.chunk
    now = stored_energy(run.system, chunk.q[0][run.back], chunk.v[0][run.back], run.reached()) + in_springs
    work, dissipated = float(out.total[0]), float(out.total[1]) + loss
    scale = abs(first) + out.most + abs(loss) + run.uncounted()
    excess = now - first - work + dissipated
    if not excess <= blow_up * scale + 1e-300:
        raise run.blown_up(f"{now:.3g} J, from {first:.3g} J at the start and {work:.3g} J of work", dt)
    return excess


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
