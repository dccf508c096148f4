"""Periodic orbits by shooting: the state at the end of an orbit must equal the state at its beginning.

The unknowns are modal displacements and velocities at t = 0 of the loads; for large systems those of the vectors of
`condensed.py`. The flow is exact between events and its derivative is too, so Newton's method converges quadratically
and the multipliers are those of the orbit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import ArgumentError, ConvergenceError, EventStormError, MethodError
from vofem.initial import Initial, StoredState
from vofem.integrators.event_driven.along import Course
from vofem.integrators.event_driven.flow import Flow, Start, flow, modal_state, modes_of, share_modes
from vofem.integrators.event_driven.run import obstacle
from vofem.integrators.methods import EVENT_DRIVEN
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.plan import Plan, run_plan
from vofem.studies.steady.condensed import Condensed, condensable, condensed, first_count
from vofem.studies.steady.loads import with_corners
from vofem.studies.steady.orbit import TIMES, OrbitSource, PeriodicOrbit
from vofem.studies.steady.problem import OrbitProblem, Work
from vofem.system import OPEN, PINNED, State, System

#: Degrees of freedom up to which all modes may be unknowns.
MOST_UNKNOWNS = 600

#: Stiffness against sliders that stick, as a share of the largest one, that is rounding, and the share of what they can
#: hold below which a displacement is no size of a motion.
FREE, _HELD = 1e-10, 1e-6

#: Largest difference of both ends of an orbit under an ordinary run, over the size of the motion.
CLOSES = 1e-8


def relative(residual: Array, sizes: tuple[float, float]) -> float:
    """Return the size of a difference of states over sizes of displacements and velocities."""
    n = residual.size // 2
    return share((float(np.linalg.norm(residual[:n])), float(np.linalg.norm(residual[n:]))), sizes)


def share(norms: tuple[float, float], sizes: tuple[float, float]) -> float:
    """Return the larger of two norms over the sizes that belong to them."""
    parts = [norm / size if size > 0.0 else float(norm > 0.0) for norm, size in zip(norms, sizes, strict=True)]
    return max(parts) if np.all(np.isfinite(parts)) else np.inf


class Shooting(OrbitProblem):
    """Periodic orbits of a scene as roots of the flow.

    `earlier`: a problem whose modes define the unknowns. They are used here too if the modes are the same.
    `vectors`: number of vectors of a large system. The default is that of `earlier`, or the first number.
    """

    def __init__(
        self,
        what: str,
        scene: Scene,
        periods: int = 1,
        *,
        period: float | None = None,
        earlier: Shooting | None = None,
        work: Work | None = None,
        vectors: int | None = None,
    ) -> None:
        full = scene.model.system
        reason = shooting_refusal(scene)
        if reason is not None:
            raise MethodError(f"{what}: {reason}")
        super().__init__(what, scene, full, periods, period, work)
        self.condensed: Condensed | None = None
        #: Relative change of the orbit by doubling the vectors, where it is known.
        self.change: float | None = None
        sliders = full.sliders
        if condensable(full):
            before = None if earlier is None else earlier.condensed
            if vectors is None:
                vectors = first_count(full) if before is None else before.vectors.shape[1]
            self.condensed = condensed(full, vectors, before)
            self.change = None if earlier is None else earlier.change
        self.system = system = full if self.condensed is None else self.condensed.system
        #: The system as runs take it. In `system` sliders are further rows behind those of the contacts.
        self.given = system
        if sliders is not None:
            from vofem.integrators.event_driven.sliders import with_sliders

            self.system = system = with_sliders(full)
        shared = earlier is not None and share_modes(system, earlier.system)
        self.space = modes_of(system, self.work.runs)
        n = self.space.size
        self.reference: Shooting = self if earlier is None else earlier.reference
        self.frame: Array | None = None
        laws, others = (len(one.space.contacts) for one in (self, self.reference))
        if laws != others:
            raise MethodError(
                f"{what}: the scene has {laws} contacts and sliders, and {others} at another value of the parameter; "
                "build the same ones for all values, with a wide gap where a contact is not to act"
            )
        if not shared and self.reference is not self:
            if self.reference.space.size != n:
                raise MethodError(
                    f"{what}: the scene has {n} degrees of freedom, and {self.reference.space.size} at another value "
                    "of the parameter; build the same mesh for all values"
                )
            self.frame = self.space.shapes.T @ self._in_own_vectors(self.reference.space.shapes)
        elif shared and earlier is not None:
            self.frame = earlier.frame
        self.size = 2 * n

    @property
    def duration(self) -> float:
        """Duration of the whole orbit in s."""
        return 2.0 * np.pi * self.periods / self.loads.omega

    def _in_own_vectors(self, shapes: Array) -> Array:
        """Return momenta of the reference's modes over the degrees of freedom of the system, shape (m, n)."""
        mine, theirs = self.condensed, self.reference.condensed
        if mine is None or theirs is None or mine.vectors is theirs.vectors:
            return np.asarray(self.system.mass @ shapes)
        return np.asarray(mine.vectors.T @ (mine.full.mass @ (theirs.vectors @ shapes)))

    @cached_property
    def course(self) -> Course:
        """Follows motions along given segments."""
        return Course(self.system, self.duration, self.work.runs, self.given.sliders)

    @cached_property
    def least(self) -> float:  # type: ignore[override]
        """Least size of modal displacements to which changes are compared: a share of those that sliders can hold."""
        sliders = self.course.sliders
        if sliders is None:
            return 0.0
        status = np.full(len(self.space.contacts), OPEN, dtype=np.int64)
        status[sliders.first :] = PINNED
        kept, moves = self.course.stuck(status), np.linalg.pinv(self.space.contacts[sliders.first :])
        assert kept is not None
        return _HELD * float(np.linalg.norm(moves @ np.linalg.pinv(kept.reaction @ moves, rcond=FREE) @ sliders.static))

    # -- unknowns and modal states --------------------------------------------------------------------

    def to_modes(self, unknowns: Array) -> tuple[Array, Array]:
        """Return modal displacement and velocity, each (n,), of unknowns (2n,)."""
        z, v = np.split(self.modal(unknowns), 2)
        return z, v

    def to_unknowns(self, z: Array, v: Array) -> Array:
        """Return the unknowns, shape (2n,), of a modal state."""
        return self.unmodal(np.concatenate([z, v]))

    def modal(self, states: Array) -> Array:
        """Return modal states, shape (2n,) or (2n, k), of states in unknowns."""
        if self.frame is None:
            return states
        return np.concatenate([self.frame @ part for part in np.split(states, 2)])

    def unmodal(self, states: Array) -> Array:
        """Return states in unknowns, shape (2n,) or (2n, k), of modal states."""
        if self.frame is None:
            return states
        return np.concatenate([np.linalg.solve(self.frame, part) for part in np.split(states, 2)])

    def from_state(self, state: State) -> Array:
        """Return the unknowns of a state over the free degrees of freedom."""
        if self.condensed is not None:
            state = self.condensed.project(state)
        return self.to_unknowns(*modal_state(self.system, self.space, state))

    def state(self, unknowns: Array) -> State:
        """Return the state over the free degrees of freedom."""
        z, v = self.to_modes(unknowns)
        state = State(self.space.shapes @ z, self.space.shapes @ v)
        return state if self.condensed is None else self.condensed.lift(state)

    def modal_row(self, row: Array) -> Array:
        """Return a row over the free degrees of freedom, shape (m,), in modes, shape (n,)."""
        row = row if self.condensed is None else row @ self.condensed.vectors
        return np.asarray(row @ self.space.shapes)

    def in_vectors(self, count: int) -> Shooting:
        """Return the problem of a large system in another number of vectors."""
        found = Shooting(self.what, self.scene, self.periods, period=self.period, work=self.work, vectors=count)
        found.centred = self.centred
        return found

    # -- guesses --------------------------------------------------------------------------------------

    def from_rest(self) -> Array:
        """Return the unknowns of the periodic motion with all contacts open."""
        n = self.space.size
        status = np.full(self.space.contacts.shape[0], OPEN, dtype=np.int64)
        period = np.array([self.loads.period])
        path = self.course.along(0.0, np.zeros(2 * n), [status], period, np.eye(2 * n), np.zeros((1, 2 * n)))
        self.work.flows += 1
        return self.outside(self.unmodal(np.linalg.lstsq(np.eye(2 * n) - path.columns, path.ends[0], rcond=1e-12)[0]))

    def outside(self, unknowns: Array) -> Array:
        """Return the unknowns of a guess without bodies inside rigid stops: they stand at these stops."""
        laws = self.system.contacts
        if laws is None or not laws.rigid.any():
            return unknowns
        z, v = self.to_modes(unknowns)
        inside = np.flatnonzero(laws.rigid & (self.space.contacts @ z > laws.gap))
        if not inside.size:
            return unknowns
        rows = self.space.contacts[inside]
        return self.to_unknowns(z - np.linalg.pinv(rows) @ (rows @ z - laws.gap[inside]), v)

    def from_orbit(self, orbit: Any) -> Array:
        """Return the unknowns of an orbit, of the last period of a `Result`, or of anything a run can start from."""
        source = _at_phase(orbit, self.loads.period) if isinstance(orbit, Result) else orbit
        initial = Initial(f"{self.what}: guess", self.scene.bodies, source, by_name=True)
        return self.from_state(self.scene.initial_state(initial))

    # -- equations ------------------------------------------------------------------------------------

    def run(
        self,
        unknowns: Array,
        phase: float = 0.0,
        status: Sequence[int] | None = None,
        length: float | None = None,
        *,
        check: bool = False,
    ) -> Flow:
        """Return the flow over an orbit from a state at a phase of the loads in rad, counted; see `Work.checks`.

        `status`: of the contacts there; by default it follows from the state.
        `length`: in rad of the loads; by default that of the orbit.
        Raises `ConvergenceError` if contacts chatter or the motion diverges.
        """
        self.work.begin()
        self.work.flows += not check
        self.work.checks += check
        z, v = self.to_modes(unknowns)
        if not (np.all(np.isfinite(z)) and np.all(np.isfinite(v))):
            raise ConvergenceError("the iteration diverged: a state is not finite")
        time = phase / self.loads.omega
        start = Start(time, z, v, None if status is None else np.array(status, dtype=np.int64))
        try:
            stop = time + (self.duration if length is None else length / self.loads.omega)
            return flow(self.given, start, stop, counters=self.work.runs)
        except (EventStormError, ArgumentError) as error:
            # A state inside a rigid stop is refused as one of a scene is.
            raise ConvergenceError(str(error)) from error

    def orbit(self, unknowns: Array, evaluation: Any) -> PeriodicOrbit:
        """Return the orbit of a solution."""
        return self.orbit_of(unknowns, evaluation, lambda: float(evaluation.uncertainty))

    def orbit_of(
        self, unknowns: Array, evaluation: Any, decided: Callable[[], float], *, autonomous: bool = False
    ) -> PeriodicOrbit:
        """Return the orbit of a solution, whose stability is not decided within a distance from the unit circle."""
        scene, duration, few, change = self.scene, self.duration, self.condensed, self.change
        state, kept = self.state(unknowns), None if few is None else few.truncation(duration, change)
        remarks = []
        if evaluation.missed > CLOSES:
            left = f"{evaluation.missed:.1e}"
            remarks.append(f"a run over one period magnifies rounding: it repeats to {left} of the motion only")
        return PeriodicOrbit(
            OrbitSource(
                scene=lambda: scene,
                motion=lambda: evaluation,
                result=lambda: orbit_result(scene, state, duration, few, change),
                multipliers=lambda: evaluation.multipliers,
                uncertainty=decided,
                truncation=lambda: kept,
            ),
            "shooting",
            self.loads.omega,
            self.periods,
            residual=evaluation.closing,
            remarks=remarks,
            unknowns=np.array(unknowns),
            autonomous=autonomous,
            start=state,
        )

    def change_after(self, count: int, unknowns: Array, evaluation: Any) -> float:
        """Return by how much a solution changes in so many periods of the loads, over the size of the motion."""
        chart = evaluation.chart
        later = chart.at_phase(self, evaluation, chart.anchor + 2.0 * np.pi * count)
        return relative(self.modal(later - evaluation.y[: self.size]), evaluation.sizes)


def shooting_refusal(scene: Scene) -> str | None:
    """Return why shooting cannot treat a scene, and what can, or None."""
    system = scene.model.system
    sliders = system.sliders
    reason = None if sliders is None else sliders.orbit_refusal()
    reason = reason or flow_refusal("shooting", system, "method='harmonic_balance'")
    bent = with_corners(system)
    if reason is None and bent:
        return f"{bent} has corners or jumps, and shooting takes sums of Sine and Constant. Use harmonic balance"
    if reason is None and sliders is not None and system.contacts is not None and system.contacts.rigid.any():
        stop = system.contacts.labels[int(np.argmax(system.contacts.rigid))]
        return (
            f"{sliders.labels[0]} acts beside {stop}, whose impacts move sliders that stick; a search of periodic "
            "orbits does not treat both. Simulate the scene until it has settled, or use a Contact with a large "
            "stiffness and a damper"
        )
    return reason


def flow_refusal(what: str, system: System, other: str = "") -> str | None:
    """Return why something that follows the flow of `event_driven` cannot treat a system, and what can, or None.

    `other`: what can be used instead, as in "method='harmonic_balance'".
    """
    found = obstacle(system)
    if found is not None:
        return f"{what} needs what {EVENT_DRIVEN.name} needs: {found[0]}{other and f'. Use {other}'}"
    if system.contacts is not None and system.contacts.moving is not None:
        return system.contacts.moving_refusal(what)
    if system.size > MOST_UNKNOWNS and not condensable(system):
        instead = other and f", or {other}, whose unknowns are those of the laws alone"
        return (
            f"the scene has {system.size} degrees of freedom, {what} takes at most {MOST_UNKNOWNS} where many "
            f"contacts, loads or dashpots act; use fewer elements{instead}"
        )
    return None


def orbit_result(
    scene: Scene, state: State, duration: float, few: Condensed | None = None, error: float | None = None
) -> Result:
    """Return the run of `event_driven` over one orbit at `TIMES` equal times, in the vectors of a large system."""
    times = np.linspace(0.0, duration, TIMES)
    if few is not None:
        return Result(scene, EVENT_DRIVEN.name, few.solution(state, duration, times, error), start=state)
    plan = Plan(EVENT_DRIVEN.name, duration, times, None, {"truncation": 0.0}, None, state)
    return run_plan(scene, plan, False, None, 60.0, None)


def _at_phase(result: Result, period: float) -> StoredState:
    """Return the state of a run at its last whole number of periods of the loads; that at its end without one."""
    end = result.solution.t_end
    time = np.floor((result.t_start + end) / period * (1.0 + 1e-12)) * period - result.t_start
    if time < 0.0:
        time = end
    q, v = result.solution.sample(np.array([min(time, end)])).last()
    of = result.model.of_body
    return StoredState({body.name: (of(body, q), of(body, v)) for body in result.scene.bodies}, {}, source="Result")
