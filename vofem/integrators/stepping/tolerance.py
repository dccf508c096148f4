"""Steps that follow a tolerance, for any implicit method.

Every step is taken once as a whole and once as two halves, which are kept. The difference of
the two results estimates the error, that of a closing or opening within the
step included. Where a contact acts, velocities are compared too, and the step
must resolve the impact. Displacements alone are not enough there: against a very
stiff stop every step ends at the stop, whatever its size.

The acceleration of generalized-alpha is that at ``(alpha_f - alpha_m) dt`` before the end of a step, so it is moved
where the size of steps changes (M. Arnold, O. Brüls, Multibody Syst. Dyn. 18 (2007) 185-202,
https://doi.org/10.1007/s11044-007-9084-0).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.observer import Observer
from vofem.integrators.registry import advice
from vofem.integrators.stepping.checks import check_times
from vofem.integrators.stepping.equal import EqualSteps
from vofem.integrators.stepping.record import Path, Record
from vofem.integrators.stepping.run import Run
from vofem.integrators.stepping.scheme import Forcing
from vofem.integrators.stepping.step_loads import of_halves
from vofem.integrators.stepping.step_size import HALVINGS, StepSizeControl
from vofem.integrators.stepping.structure import Structure
from vofem.linalg.banded import solve, subtract_product
from vofem.system import CLOSED, Counters, State

#: Number of steps of one call of `advance`.
_CHUNK = 256

#: Change of velocity in one half of a step, over that of the impact, up to which a step resolves a contact.
_RESOLVED = 0.25

#: Tangent of a law over that of the rest of its step, up to which a step resolves a jump of it: the same measure.
_SOFT = 0.5 * _RESOLVED**2

#: An unresolved change of velocity is accepted if it moves the contact by at most this many tolerances until t_end.
_HARMLESS = 0.1

#: Tolerance of the coarser run with which a run is compared, over that of the run.
_COARSER = 4.0

#: Difference between both, over the tolerance, above which a note reports it.
_APART = 5.0

#: Size of a step over the shortest time of a load, up to which it may be where a slider sticks.
_FOLLOWED = 0.25

#: Largest displacement, over the one that errors were related to, below which the latter was too large.
_OVERSIZED = 0.5

#: Steps of a rough run.
_STEPS = 1000


class Attempt(NamedTuple):
    """Result of a step that was taken as a whole and in halves."""

    solves: int  #: Contact solves; negative where a step has no solution.
    ratio: float = np.inf  #: Error over its share of the tolerance.
    halves: Forcing | None = None  #: Loads over the halves.


class StepDoubling(StepSizeControl, Run):
    """A run of steps chosen by their error.

    `fineness`: how finely impacts are resolved, over what is done by default.
    `coarser` (shape (n_times, n)): what a run of a coarser tolerance found at the times of `check_times`, in band
    order.
    `last`: size of the last step in s, 0 before the first one.
    `gain` (shape (n,)): what the acceleration of the method gained in it.
    `means` (shape (2 n_loads,)): of the loads over it.
    """

    place = (
        *Run.place, *StepSizeControl.place, "tolerance", "steps_taken", "coarsest", "beyond", "farthest", "coarser",
        "fineness", "last", "gain", "means",
    )  # fmt: skip

    def __init__(
        self, structure: Structure, start: State, counters: Counters, t_end: float, tolerance: float,
        fineness: float = 1.0,
    ) -> None:  # fmt: skip
        self.set_range(t_end, tolerance)
        super().__init__(structure, start, counters, t_end, 2 * _CHUNK + 2, self.tick, t_end + 2.0 * self.largest)
        system, scheme = structure.system, structure.scheme
        self.bends = np.array([self.laws.turns(j) for j in range(len(self.laws))], dtype=bool)
        self.aside = Path(
            2, system.size, self.equations.laws, self.path.pull.shape[1], scheme.lags, self.path.status.shape[1]
        )  # fmt: skip
        self.weight = system.scale[self.order]
        self.period = self.over.period(t_end)
        self.steps_taken, self.coarsest, self.beyond, self.fineness = 0, 0.0, False, fineness
        self.farthest, self.last, self.gain = 0.0, 0.0, np.zeros(system.size)
        self.means = np.zeros(2 * self.vectors.shape[0])
        self.follows = _FOLLOWED * min((load.function.shortest(t_end) for load in system.loads), default=np.inf)
        self.coarser = np.empty((0, 0))

    def largest_of(self, displacement: Array) -> float:
        """Return the largest of displacements in band order, shape (n_times, n), in m; rotations by their arms."""
        return float(np.max(np.abs(self.weight * displacement), initial=0.0))

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.beyond

    def reached(self) -> float:
        """Return the time of the last state that is complete, s."""
        return min(super().reached(), self.t_end)

    def advance(self, out: Record) -> None:
        """Take some steps; where a state is completed by the step after it, the last one goes beyond the end."""
        for _ in range(_CHUNK):
            if self.beyond:
                break
            self.advance_once()
        self.take(out)
        self.count(self.steps_taken, self.steps_taken)

    def advance_once(self) -> None:
        """Take the next step, as long as its error allows."""
        path, past = self.path, self.past
        while True:
            row, t, dt = path.filled, self.time, self.length(self.level)
            if self.ticks == 0:
                self.begin(0.5 * dt)
                self.means = np.zeros(2 * self.vectors.shape[0])
                if not self.scheme.mean:
                    self.means[: self.at_start.size] = self.at_start
            known = path.chunk.a[row].copy(), None if past is None else past.y.copy()
            held = None if self.sliders is None else (self.sliders.now, len(self.sliders.turns))
            tried = self.attempt(t, dt)
            if tried.solves < 0 and self.at_smallest:
                raise self.lost(t)
            if self.accepts(tried.ratio):
                break
            self.counters.rejected += 1
            path.chunk.a[row] = known[0]
            if held is not None and self.sliders is not None:
                self.sliders.back_to(*held)
            if past is not None:
                past.y[:] = known[1]
        assert tried.halves is not None
        half, mean = 0.5 * dt, self.scheme.mean
        self.enter(path, half, np.array([t + half, t + dt]), tried.halves)
        self.solves += tried.solves
        after = self.ticks + 2 ** (HALVINGS - self.level)
        self.beyond = (self.ticks if mean else after) >= self.last_tick
        self.farthest = max(self.farthest, float(np.max(self.weight * np.abs(path.chunk.q[path.filled]))))
        self.step_on(tried.ratio)
        self.gain = path.chunk.a[path.filled] - path.chunk.a[path.filled - 1]
        self.coarsest, self.last, self.means = max(self.coarsest, half), half, tried.halves.means[-1]
        self.steps_taken += 0 if self.beyond and mean else 2

    def attempt(self, t: float, dt: float) -> Attempt:
        """Take the next step whole, and again in halves, which stay in the rows after the last one."""
        path, aside, scheme, half = self.path, self.aside, self.scheme, 0.5 * dt
        parts = self.over.parts(t, t + dt)
        between, y = 0.0, None if self.past is None else self.past.y.copy()
        moments = np.empty((3, 0, 3))
        if parts.shape[1]:
            moments, fluctuations = of_halves(parts)
            # Short loads cause motion between the ends of steps that no interpolation shows. It is no error of the
            # steps and does not accumulate, but states between steps have it.
            moved = fluctuations @ np.abs(half * self.size(half).shift)
            between = float(np.max(self.weight * moved, initial=0.0)) / self.whole
        whole, halves = self._loads(moments[:, :, :1], dt), self._loads(moments[:, :, 1:], half)
        row, solves, sliders = path.filled, 0, self.sliders
        held = None if sliders is None else (sliders.now, len(sliders.turns))
        for mine, other in zip(aside.chunk, path.chunk, strict=True):
            mine[0] = other[row]
        for onto, size, forcing, ends in ((aside, dt, whole, [t + dt]), (path, half, halves, [t + half, t + dt])):
            if self.last > 0.0 and not scheme.mean:
                # The acceleration of the method lags, by a part of the step that has changed.
                shift = (scheme.alpha_f - scheme.alpha_m) * (1.0 - size / self.last)
                onto.chunk.a[onto.filled] += shift * self.gain
            pots = None
            if sliders is not None and held is not None:
                sliders.back_to(*held)
            if self.past is not None:
                self.past.y[:] = y
                middles = np.array(ends) - 0.5 * size
                pots = self.past.over(size, middles)
            more = self.steps(onto, size, np.array(ends), forcing, pots)
            if more < 0:
                return Attempt(-1)
            solves += more
        ratio = max(self._ratio(dt, whole, halves), between)
        if sliders is not None:
            # A slider that sticks makes no error, however long the step: loads are followed, and the limit is watched.
            late = sliders.late(self, path, half)
            ratio = max(ratio, late / (self.whole * dt / self.t_end), dt / self.follows if sliders.sticks() else 0.0)
        return Attempt(solves, ratio, halves)

    def _loads(self, moments: Array, dt: float) -> Forcing:
        """Return the loads of the next steps of one size by their moments, shape (3, n_loads, steps).

        Where laws do not act by means, the mean over a step is moved to the time of balance by its change since the
        step before. So no step takes what acts after its end, and the sum over equal steps is the loads' impulse.
        """
        forcing = self.moments(moments, dt)
        if self.scheme.mean:
            return forcing
        before = np.vstack([self.means, forcing.means])[:-1]
        apart = np.full((before.shape[0], 1), dt)
        apart[0] = 0.5 * (dt + self.last)
        ahead = (0.5 - self.scheme.alpha_f) * dt / apart
        return forcing._replace(values=forcing.means + ahead * (forcing.means - before))

    def _ratio(self, dt: float, whole: Forcing, halves: Forcing) -> float:
        """Return the error of displacements of the step that was tried over its share of the tolerance."""
        full, chunk, half = self.aside.chunk, self.path.steps(2), 0.5 * dt
        if self.scheme.mean and not self.structure.jumps:
            # Computed from velocities: the shortest steps change only the last digits of displacements.
            p = 0.5 * (chunk.v[1:] + chunk.v[:-1])
            once = 0.5 * (full.v[0] + full.v[1])
            if np.any(whole.first) or np.any(halves.first):
                once = once - whole.first[0] @ self.size(dt).shift
                p = p - halves.first @ self.size(half).shift
            error = half * ((once - p[0]) + (once - p[1])) / 3.0
        else:
            error = (full.q[1] - chunk.q[2]) / 3.0
        acts, unresolved = self.impact(half)
        rough = float(np.max(self.weight * np.abs(error), initial=0.0))
        if acts:
            # Where a stop is stiff, steps of any size end at it: their displacements agree, their velocities do not.
            # Without contact those of fast modes with tiny displacements would set the step.
            rough = max(rough, float(np.max(self.weight * np.abs(full.v[1] - chunk.v[2]))) * dt / 3.0)
        # What the step resolves well: (A^-1 M)^2 of the error, A of steps eight times as long.
        factored = self.size(self.length(max(self.level - 3, 0))).size.factored
        for _ in range(2):
            moved = np.zeros(error.size)
            subtract_product(self.equations.mass, error, moved)
            solve(factored, moved)
            error = -moved
        ratio = self.ratio(rough, float(np.max(self.weight * np.abs(error), initial=0.0)))
        # An impact that the step does not resolve may change velocities for the whole rest of the run.
        return max(ratio, 2.0) if unresolved * self.t_end > _HARMLESS * self.whole else ratio

    def impact(self, dt: float) -> tuple[bool, float]:
        """Return whether a law's tangent jumps in two halves of a step, and the largest change of rate unresolved, m/s.

        For a stiffness k, a mass m, a penetration s and its rate r, the velocity of the impact
        is ``sqrt(r^2 + k s^2/m)``. The mass need not be known, because ``k s/m`` is the change of rate
        per time. A contact that a static load keeps closed has a large velocity of impact by this
        formula, so its small vibrations count as resolved.
        Of any other law the tangents k at the ends of the halves are compared; ``k dt^2/2m`` follows from
        the change of rate ``R dt/m`` that its reaction R causes.
        """
        if self.rows is None:
            return False, 0.0
        chunk, laws, m, acts = self.path.steps(2), self.laws, self.initial.size, False
        rates, worst = np.asarray(self.rows @ chunk.v.T).T, 0.0
        if self.movement is not None:
            times = self.path.t[self.path.filled] + dt * np.arange(3.0)
            rates = self.movement.rates(chunk.q, chunk.v, times)
        change = np.max(np.abs(rates[1:] - rates[:-1]), axis=0)
        contacts = self.system.contacts
        if contacts is not None:
            deepest = np.max(chunk.u[:, :m], axis=0) - contacts.gap
            closed = deepest > 0.0
            acts = bool(np.any(closed))
            speed = np.max(rates[:, :m] ** 2, axis=0) + deepest * change[:m] / dt
            coarse = closed & (change[:m] ** 2 > (_RESOLVED / self.fineness) ** 2 * speed)
            worst = float(np.max(change[:m], where=coarse, initial=0.0))
        if laws.state.size and np.any(self.bends[m:]):
            laws.state[:] = chunk.past[0]
            tangents = np.zeros(chunk.u.shape)
            for j in (np.flatnonzero(self.bends[m:]) + m).tolist():
                tangents[:, j] = laws.tangent(j, chunk.u[:, j])
            stiff = np.max(np.abs(tangents), axis=0)
            jumps = np.max(np.abs(tangents[1:] - tangents[:-1]), axis=0) > 0.5 * stiff
            reaction = np.max(np.abs(chunk.reaction[1:]), axis=0)
            coarse = jumps & (0.5 * stiff * change * dt > _SOFT / self.fineness**2 * reaction)
            acts, worst = acts or bool(np.any(jumps)), max(worst, float(np.max(change, where=coarse, initial=0.0)))
        return acts, worst


def under_tolerance(
    structure: Structure, start: State, t_end: float, tol: float, counters: Counters, resumed: bool,
    observer: Observer | None,
) -> StepDoubling:  # fmt: skip
    """Return a run whose steps follow a tolerance, ready to begin.

    Errors are related to the largest displacement of a rough run, as a scene that starts from rest has none at first.
    A run that is resumed has it already.

    A scene with impacts is run at a coarser tolerance first, which takes about half the steps. The errors of steps
    bound that of the run where it is smooth. What an impact does depends on velocities, and on fast motion that
    displacements do not show, so `note_tolerance` compares both runs.
    """
    run = StepDoubling(structure, start, counters, t_end, tol)
    if resumed:
        return run
    rough = EqualSteps(structure, start, counters, t_end, t_end / _STEPS, _STEPS)
    run.size_of_motion = run.largest_of(_trial(rough, np.linspace(0.0, t_end, _STEPS + 1))[0])
    if not np.any(run.bends):
        return run
    trial = StepDoubling(structure, start, Counters(), t_end, _COARSER * tol, 0.5)
    trial.size_of_motion = run.size_of_motion
    hit = trial.initial.size < len(trial.laws) or bool(np.any(trial.initial == CLOSED))
    found, switched = _trial(trial, check_times(t_end, None, structure.system.size), observer)
    if hit or switched:
        # This run gives the largest displacement more accurately than the rough one.
        run.size_of_motion = min(run.size_of_motion, trial.largest_of(found))
        run.coarser = found
    return run


def _trial(run: Run, times: Array, observer: Observer | None = None) -> tuple[Array, bool]:
    """Run to the end; return the displacements at some times, shape (n_times, n), and whether a law switched."""
    out = run.record(times, None)
    out.q[:] = 0.0
    failed = False
    try:
        while not run.finished:
            run.advance(out)
            if observer is not None:
                observer(run.reached(), None)
    except ConvergenceError:
        # At large steps a stiff law may leave no solution in double precision. The displacements before that are used;
        # the run itself takes other steps, or raises the error.
        failed = True
    return out.q, failed or any(part.size for part in run.switches.log)


def note_tolerance(run: StepDoubling, out: Record, notes: list[str]) -> None:
    """Add notes where the tolerance may not be kept."""
    tol, size = run.tolerance, run.size_of_motion
    if run.forced:
        notes.append(
            f"tol: {run.forced} steps of the smallest size, {run.tick:.3g} s, exceeded their share of the "
            "tolerance and were taken all the same: a force jumps there"
        )
    if run.coarser.size:
        checks = check_times(run.t_end, None, run.system.size)
        # The first of each, as a time may occur twice.
        off = run.largest_of(np.nan_to_num(out.q[np.searchsorted(out.times, checks)] - run.coarser))
        if off > _APART * tol * size:
            notes.append(
                f"tol: displacements may be wrong by {off:.2g} m, {off / (tol * size):.2g} times what tol = "
                f"{tol:g} allows: by so much the run differs from one whose tolerance is {_COARSER:g} times as large; "
                f"impacts magnify errors. Choose a smaller tol, or {advice(exact=True)} where it applies"
            )
    if run.farthest < _OVERSIZED * size:
        notes.append(
            f"tol: errors are held below tol = {tol:g} of {size:.3g} m, which a rough run of {_STEPS} steps "
            f"found, but nothing moves farther than {run.farthest:.3g} m; choose a tol smaller by their ratio"
        )
