"""A run in time steps: its state, its first forces, its steps, and what energies need of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vofem._validate import TINY
from vofem.arrays import Array, IntArray
from vofem.errors import ConvergenceError, InstabilityError
from vofem.integrators.base import ProbeRows, Samples
from vofem.integrators.registry import advice
from vofem.integrators.rounding import static_loss
from vofem.integrators.stepping.checks import check_times, contact_checks
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.stepping.guides import Guides
from vofem.integrators.stepping.kernel import NO_DRIFT, Equations, Size, advance, work_space
from vofem.integrators.stepping.reactions import Reactions, begin_reactions
from vofem.integrators.stepping.record import Path, Record, Switches, hysteretic_energy
from vofem.integrators.stepping.scheme import Forcing, Loaded
from vofem.integrators.stepping.step_loads import StepLoads
from vofem.integrators.stepping.structure import Structure
from vofem.laws import initial_status
from vofem.laws.group import StepPast
from vofem.laws.law import DAMPING, FORCE, LawSet, ask
from vofem.laws.python import callbacks_of
from vofem.linalg.banded import factor, solve, subtract_product
from vofem.system import CLOSED, Counters, State

if TYPE_CHECKING:
    from vofem.integrators.stepping.sliding import Sliders


#: Relative loss of static responses to rounding above which rounding is named as the cause of a blow-up.
_SPOILT = 1e-3


class Run:
    """A run of a method from its start, by steps of sizes that `advance` of a derived class chooses.

    Attributes
    ----------
    structure : Structure
        With `system`, `method`, `scheme`, `order`, `back`, `rows`, `vectors` and `movement`.
    counters : Counters
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
        self, structure: Structure, start: State, counters: Counters, t_end: float, room: int, shortest: float,
        longest: float,
    ) -> None:  # fmt: skip
        self.structure, self.start, self.counters, self.t_end = structure, start, counters, t_end
        self.system, self.method, self.scheme = system, _, scheme = structure.system, structure.method, structure.scheme
        self.order, self.back, self.rows = structure.order, structure.back, structure.rows
        self.vectors, self.movement, self.solves = structure.vectors, structure.movement, 0
        self.over = StepLoads(system, counters, t_end)
        self.callbacks = callbacks_of(system.laws)
        q, v = start.q[self.order], start.v[self.order]
        u = np.zeros(0) if self.rows is None else np.asarray(self.rows @ q)
        if self.movement is not None:
            now = np.zeros(1)
            self.movement.begin_ties(q, v, longest)
            self.start = State(q[self.back], v[self.back], start.internal)
            u = self.movement.along(q[None, :], now)[0] + self.movement.offsets(now)[0, 0]
            u = np.where(self.movement.present(now)[0], u, self.movement.away)
        self.laws = LawSet(system.laws, self.callbacks)
        self.laws.load(u, start.internal)
        self.sliders: Sliders | None = None
        if system.sliders is not None:
            from vofem.integrators.stepping.sliding import Sliders

            self.sliders = Sliders(system, structure.mass, self.laws, self.rows, v)
        self.guides = None
        if self.movement is not None or self.sliders is not None:
            self.guides = Guides(structure, self.laws, self.sliders)
        laws = self.laws.records
        self.equations = Equations(
            structure.mass, structure.stiffness, structure.damping, structure.compressed, laws
        )  # fmt: skip
        self.dampers = any(law.damped for law in self.laws.laws)
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
        self.initial = np.empty(0, dtype=np.int64)
        if system.contacts is not None:
            self.initial = initial_status(system.contacts, start.q, start.v)
        self.switches = Switches(structure, self.initial)
        self._space: Any = None
        self._of: Size | None = None
        chunk = self.path.chunk
        chunk.q[0], chunk.v[0], chunk.u[0], chunk.past[0] = q, v, u, laws.state
        #: The last row of the path whose switches are known.
        self.known = 0
        self.kick, self.load = np.zeros(0), np.zeros(system.size)

    def size(self, dt: float) -> Loaded:
        """Return the matrix of a step size in s, and its answers to loads."""
        return self.structure.size(dt, self.counters)

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
        chunk, scheme = self.path.chunk, self.scheme
        pots = np.zeros(0) if self.past is None else self.past.begin(self.start, dt if scheme.explicit else None)
        chunk.pots[0, :, 0] = self.path.pull[0] = pots
        if scheme.mean:
            return
        if scheme.explicit:
            force = self.over.nodal(0, 1, dt)
            values = np.concatenate([force[0], -0.5 * dt**2 * force[1]])[:, 0]
            load = values @ self.size(dt).loads
        else:
            # An impulse at t = 0 becomes an initial velocity; by steps it would act late.
            self.at_start, beyond = self.over.start(dt)
            self.kick = 0.5 * (beyond @ self.size(dt).shift)
            load = self.at_start @ self.vectors
        self._act(self.path, 0.0, dt, load, pots)

    def restart(self, path: Path, t: float, dt: float, forcing: Forcing) -> None:
        """Find forces and acceleration anew after the last step of a path, where forces jump at a time in s.

        Laws that act by their mean forces do not need them.
        """
        if not self.scheme.mean:
            self.laws.state[:] = path.chunk.past[path.filled]
            self._act(path, t, dt, forcing.values[-1, : self.vectors.shape[0]] @ self.vectors)

    def _act(self, path: Path, t: float, dt: float, load: Array, pots: Array | None = None) -> None:
        """Enter forces of laws and the acceleration at the last row of a path, at a time in s; steps of dt follow.

        `load`: forces of loads, shape (n,).
        `pots`: forces of springpots at t = 0, N.
        """
        chunk, row, explicit = path.chunk, path.filled, self.scheme.explicit
        u, begins = chunk.u[row], pots is not None
        reaction = self.laws.everywhere(FORCE, u[:, None])[:, 0] if u.size else np.zeros(0)
        damper = np.zeros(u.size)
        if begins and explicit:
            self._begin_explicit(reaction, damper, self.rates(row))
        else:
            damper = self._start_dampers(u, self.rates(row))
            reaction = reaction + damper
        springpots = slice(0) if self.past is None else slice(self.past.row, self.past.row + self.past.count)
        if begins:
            reaction[springpots] = pots
        mass = factor(self.equations.mass, "the mass matrix")
        a = np.array(load)
        subtract_product(self.equations.stiffness, chunk.q[row], a)
        if self.structure.lossy is not None:
            subtract_product(self.equations.damping, chunk.v[row], a)
        if self.guides is not None and self.structure.special:
            a = self.guides.acceleration(path, row, t + dt * np.arange(3.0), mass, a, reaction)
        else:
            if self.rows is not None:
                a -= self.rows.T @ reaction
            solve(mass, a)
        chunk.a[row] = path.out[row] = a
        chunk.damper[row] = damper
        chunk.reaction[row] = reaction if explicit else reaction - damper
        if begins and not explicit:
            chunk.reaction[row, springpots] = 0.0

    def rates(self, row: int) -> Array:
        """Return the rates of the laws' coordinates at a row of the path, shape (m,)."""
        v, q, t = self.path.chunk.v[row], self.path.chunk.q[row], self.path.t[row : row + 1]
        if self.rows is None:
            return np.zeros(0)
        if self.movement is not None:
            return self.movement.rates(q[None, :], v[None, :], t)[0]
        return np.asarray(self.rows @ v)

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
        """Return the contact dampers' forces at t = 0: of a path of a millionth of the way to the first kink."""
        forces = np.zeros(u.size)
        for j, law in enumerate(self.laws.laws):
            if law.damped:
                off = [1e-6 * abs(kink - u[j]) for kink in self.laws.kinks(j)[:1]]
                ahead = u[j] + max(TINY, 1e-12 * abs(u[j]), *off)
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
        first = path.filled
        self.taken = self.sliders.steps(self, path, dt, t, forcing, cut=False)
        path.filled = first
        return self.taken if self.taken == t.size else -1

    def advanced(
        self, path: Path, dt: float, t: Array, forcing: Forcing, pots: Any, status: IntArray | None = None,
        fixed: bool = False,
    ) -> int:  # fmt: skip
        """Take steps as `steps` does, with the statuses of sliders at the start, shape (k,), where they are given.

        Several steps end before one within which a slider turns.
        `fixed`: whether sliders keep these statuses.
        """
        known, shift = self.size(dt), np.empty((0, self.system.size))
        count = self._acting(forcing.values)
        values, loads = np.ascontiguousarray(forcing.values[:, :count]), known.loads[:count]
        if self.scheme.mean and np.any(forcing.first):
            shift = forcing.first @ known.shift
        equations, drift, rules = self.equations, NO_DRIFT, None
        if self.guides is not None:
            ahead = np.concatenate([[t[0] - dt], t, [t[-1] + dt]])
            equations, drift, rules = self.guides.over(path, ahead, equations, status, fixed)
        self.taken, solves = advance(
            equations, *known.size[:3], self.dampers, pots, drift, rules, values, loads, shift,
            path.chunk.a[max(path.filled - 1, 0)], path.steps(t.size), self._work(known.size),
        )  # fmt: skip
        if self.callbacks is not None:
            self.callbacks.complain(dt)
        return -1 if self.taken < t.size else solves

    def _work(self, size: Size) -> Any:
        """Return work space."""
        if self._space is None:
            slides = self.sliders is not None and self.sliders.chosen
            self._space = work_space(self.equations, size, slides)
        if self._of is not size:
            self._of, work, numbers = size, self._space[0], size.numbers
            begin_reactions(
                work.reactions, numbers.way, numbers.per_y, numbers.part, size.coupling, size.factored, size.banded
            )  # fmt: skip
        return self._space[0]

    @property
    def reactions(self) -> Reactions:
        """How kernels found the forces of the last step."""
        return self._space[0].reactions

    def enter(self, path: Path, dt: float, t: Array, forcing: Forcing) -> None:
        """Enter steps that were taken into a path: their times and energies."""
        first, count = path.filled, t.size
        rows, steps = slice(first + 1, first + count + 1), path.steps(count)
        path.t[rows], path.dt[rows] = t, dt
        path.work[rows], path.dissipated[rows] = self._work_of_loads(dt, steps, forcing), self._lost(dt, steps, forcing)
        if self.guides is not None:
            path.work[rows] += self.guides.work(path, dt, t)
        way = np.diff(steps.u, axis=0)
        if self.movement is not None and self.structure.travels:
            way[~self.movement.through(np.append(t[0] - dt, t))] = 0.0
        if self.dampers:
            path.dissipated[rows] += self._lost_in_laws(steps.damper, way)
        if self.sliders is not None:
            lost, jumps = self.sliders.enter(path, first, count, self.scheme)
            path.dissipated[rows] += lost
            path.work[first + 1] += jumps
        if self.past is not None:
            mine = slice(self.past.row, self.past.row + self.past.count)
            mean = _middle(steps.reaction[:, mine]) if self.scheme.explicit else steps.pots[1:, :, 0]
            path.absorbed[rows] = mean * way[:, mine]
        path.filled += count

    def _work_of_loads(self, dt: float, steps: Any, forcing: Forcing) -> Array | float:
        """Return the work in J of the loads over steps, shape (steps,)."""
        known, acting = self.size(dt), self._acting(forcing.means)
        if not self.vectors.size:
            return 0.0
        loads, means = known.loads[:acting], forcing.means[:, :acting]
        # A load on few unknowns sees few of their displacements.
        on = np.flatnonzero(loads.any(axis=0))
        seen = on if 4 * on.size < self.system.size else slice(None)
        if not self.scheme.mean or self.sliders is not None:
            return np.asarray(np.sum(np.diff(loads[:, seen] @ steps.q[:, seen].T) * means.T, axis=0))
        along = self._mean_rate(dt, steps)[:, seen] @ loads[:, seen].T
        if not np.any(forcing.first):
            return dt * np.einsum("ke,ke->k", along, means)
        along -= forcing.first @ (known.shift @ loads.T)
        inner = dt * np.einsum("ke,ke->k", steps.a[1:] @ known.inertia.T, forcing.first)
        return np.asarray(inner + dt * np.einsum("ke,ke->k", along, means))

    def _lost(self, dt: float, steps: Any, forcing: Forcing) -> Array | float:
        """Return what the damping matrix takes over steps, J, shape (steps,)."""
        lossy, v, a = self.structure.lossy, steps.v, steps.a
        if lossy is None:
            return 0.0
        if self.scheme.mean:
            rate = self._mean_rate(dt, steps)
            if np.any(forcing.first):
                rate = rate - forcing.first @ self.size(dt).shift
            return dt * np.einsum("ki,ki->k", rate, (lossy @ rate.T).T)
        pull = (lossy @ v.T).T
        if self.scheme.explicit:
            return 0.5 * dt * np.einsum("ki,ki->k", v[:-1] + 0.5 * dt * a[:-1], pull[1:] + pull[:-1])
        power = 0.5 * dt * np.einsum("ki,ki->k", v, pull)
        return power[1:] + power[:-1]

    def _mean_rate(self, dt: float, steps: Any) -> Array:
        """Return mean velocities over steps where laws act by means, shape (steps, n); jumps come after a step."""
        return steps.v[:-1] + 0.5 * dt * steps.a[1:] if self.structure.jumps else _middle(steps.v)

    def _lost_in_laws(self, damper: Array, way: Array) -> Array:
        """Return what dampers of laws take over steps, J, for their forces and the ways of their coordinates."""
        own: slice | IntArray = slice(self.initial.size)
        if self.structure.travels:
            counted = [np.full(len(group), not group.recorded) for group in self.system.laws]
            own = np.flatnonzero(np.concatenate(counted))
        damper = damper[:, own]
        mean = _middle(damper) if self.scheme.explicit else damper[1:]
        return np.einsum("kj,kj->k", mean, way[:, own])

    def take(self, out: Record) -> None:
        """Record the steps that were entered, as far as their states are complete."""
        self.switches.step_on(self.path, self.path.filled - self.known, self.t_end)
        out.take(self.path, self.scheme.mean, self.scheme.explicit, 0 if self.past is None else self.past.row)
        self.known = self.path.filled

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

    def lost(self, t: float) -> ConvergenceError:
        """Return the error of a step from a time in s that has no solution."""
        laws = "a nonlinear spring that softens, or friction under the force of a contact that it moves, may leave none"
        if self.dt is None:
            step, cure = ", however small", laws
        else:
            blown = "" if self.method.conserves else " The state may have blown up, which smaller steps prevent."
            step, cure = f" at dt = {self.dt:g} s", f"reduce dt.{blown} If it ends there at every dt, {laws}"
        return ConvergenceError(f"{self.method.name} found no solution of the step from t = {t:g} s{step}: {cure}")

    # -- records ----------------------------------------------------------------------------------------

    def record(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Record:
        """Return an empty record of the run at some times, and of points at every step.

        Where the end of the run in s is given, the record also holds what the checks of the run need.
        """
        system, further, table = self.system, np.empty(0), contact_checks(None)
        if t_end is not None:
            further, table = check_times(t_end, self.dt, system.size), contact_checks(system.contacts)
        return Record(times, further, self.structure, self.equations.laws, self.path.pull.shape[1], table, probes)

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
        self.known = self.path.filled
        self.switches.status, self.switches.size = saved["status"], saved["size"]
        for name, value in saved["place"].items():
            setattr(self, name, value)
        if self.past is not None:
            self.past.y[:] = saved["history"]
        if self.sliders is not None:
            self.sliders.restore(saved["sliders"])


def _middle(values: Array) -> Array:
    """Return the means of values before and after steps."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))
