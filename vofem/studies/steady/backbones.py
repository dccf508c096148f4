"""Nonlinear normal modes of conservative scenes: `backbone`.

If a free oscillation of a conservative scene comes to rest twice in a period, the motion is the same forwards and
backwards in time. It is therefore computed over half a period, from rest to rest. The unknowns are the displacement at
rest and half the period. The equations say that all velocities vanish again and that the energy has the given value.

G. Kerschen, M. Peeters, J. C. Golinval, A. F. Vakakis, Mech. Syst. Signal Process. 23 (2009) 170,
doi:10.1016/j.ymssp.2008.04.002.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import TINY, array, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ArgumentError, ConvergenceError, EventStormError, MethodError
from vofem.integrators.event_driven.flow import Start, flow, modal_state, modes_of, share_modes
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.kernels.choice import by_need
from vofem.laws import CLOSED, OPEN
from vofem.scene import Scene, as_scene
from vofem.studies.steady.branch import Branch, BranchCounters
from vofem.studies.steady.condensed import GOOD, Condensed, reduced
from vofem.studies.steady.following.family import Interval
from vofem.studies.steady.following.follow import Quiet
from vofem.studies.steady.following.point import ORIGIN, Point, point_at
from vofem.studies.steady.newton import Evaluation, raised, solved
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.problem import Work
from vofem.studies.steady.segments.near import signature_at
from vofem.studies.steady.segments.shooting import Shooting, flow_refusal
from vofem.system import State, System

#: Steps of Newton's method, and the residual that is small enough.
_STEPS, _TOLERANCE = 12, 1e-14

#: First, largest and least step of the logarithm of the level, and the first step by arclength.
_FIRST, _LARGEST, _LEAST, _SHORT = 0.02, 0.3, 1e-6, 1e-4

#: Number of vectors of a large system for each mode below the one that is followed.
_EACH_MODE = 4

#: Difference of the amplitudes on both sides, as a share of them, up to which they are the same.
_KEPT = 1e-9

#: Cosine of the angle below which the ways from one instant of rest to the other are opposite at two oscillations.
_OPPOSITE = -0.99

#: First fraction of the contacts' stiffness if contacts touch at rest, and the largest step of its logarithm.
_SOFT, _HARDER = 1e-3, np.log(2.0)


@one_thread
@by_need("steady states", small=False)
def backbone(
    scene: Scene,
    mode: int,
    energies: ArrayLike | None = None,
    *,
    amplitudes: ArrayLike | None = None,
    max_points: int = 1000,
) -> Branch:
    """Return a nonlinear normal mode of a conservative scene: free oscillations at some energies or amplitudes.

    Parameters
    ----------
    scene : Scene
        A scene without loads and dampers. Its initial state does not matter.
    mode : int
        Number of the vibration mode, with all contacts open, from which the backbone begins; 1 is the lowest.
    energies : array_like, shape (k,), optional
        Energies of the oscillations in J, positive.
    amplitudes : array_like, shape (k,), optional
        Amplitudes in m, given instead of energies. The amplitude is the displacement at the instant of rest of one
        degree of freedom: the translation that is largest in the shape of the mode, the first one of equal ones. Where
        contacts change the shape, others may move farther.
    max_points : int
        Largest number of orbits that are computed beyond a turn of the backbone, on the way to a level.

    Returns
    -------
    Branch
        One orbit for each energy or amplitude, in the given order. `Branch.omega` is in rad/s and `Branch.energy` in J.
        All orbits begin at the instant of rest that is farthest from the stops; `Branch.q0(point)` is the displacement
        in m at this instant.

    Raises
    ------
    ArgumentError
        If an energy or amplitude is not positive, or the scene has no such mode.
    MethodError
        If the scene is not conservative.
    ConvergenceError
        If the backbone cannot be followed to a level; the message says how far it came and where it turned. The
        attribute `branch` of the error is the Branch of the levels below.
    """
    as_scene("backbone", scene)
    if (energies is None) == (amplitudes is None):
        both = "neither is" if energies is None else "both are"
        raise ArgumentError(f"backbone: give either energies or amplitudes; {both} given")
    levels = np.atleast_1d(array("backbone: energies or amplitudes", energies if amplitudes is None else amplitudes))
    if levels.ndim != 1 or not levels.size or np.any(levels < TINY):
        raise ArgumentError(
            f"backbone: energies or amplitudes are {levels!r}, expected positive numbers of at least {TINY:g}"
        )
    max_points = whole("backbone: max_points", max_points)
    system = scene.model.system
    _check(system)
    work = Work()
    mode = whole("backbone: mode", mode)
    few = reduced(system, _EACH_MODE * mode)
    search = _Search(system if few is None else few.system, work, few)
    number = _mode_number(search.space, mode, system)
    now = search.linear(number, float(levels.min()), amplitudes is not None)
    found: dict[float, Array] = {}
    failed: ConvergenceError | None = None
    for level in np.unique(levels).tolist():
        try:
            found[level] = now = search.path(now, level, max_points)
        except ConvergenceError as error:
            failed = error
            break
    search, found = search.settled(found)
    levels = np.array([level for level in levels.tolist() if level in found])
    counters = BranchCounters(points=levels.size, flows=work.flows, eigensolves=work.runs.eigensolves)
    orbits = [search.orbit(scene, found[level]) for level in levels.tolist()]
    counters.flows = work.flows
    values = [search.energy(found[level][:-1])[0] for level in levels.tolist()]
    branch = Branch(values=np.array(values), orbits=orbits, special=[], counters=counters)
    if failed is not None:
        failed.branch = branch  # type: ignore[attr-defined]
        raise failed
    return branch


def _check(system: System) -> None:
    """Raise where a scene is not conservative."""
    if system.sliders is not None:
        raise MethodError(system.sliders.refusal("backbone"))
    reason = flow_refusal("backbone", system)
    if reason is None and system.contacts is not None:
        reason = system.contacts.rigid_refusal("backbone")
    if reason is not None:
        raise MethodError(reason)
    what = ""
    if system.loads:
        what = system.loads[0].name
    elif system.damped:
        what = "damping"
    elif system.contacts is not None and np.any(system.contacts.damping > 0.0):
        what = f"the damper of {system.contacts.labels[int(np.argmax(system.contacts.damping > 0.0))]}"
    if what:
        raise MethodError(
            f"backbone: the scene has {what}, and nonlinear normal modes are free oscillations of conservative scenes; "
            "leave it out, or follow forced orbits with vofem.continuation"
        )


def _mode_number(space: ModalSpace, mode: int, system: System) -> int:
    vibrations = np.flatnonzero(space.stiffness > 0.0)
    if mode > vibrations.size:
        every = system.size - system.rigid.shape[1]
        few = "" if vibrations.size == every else f", of which {vibrations.size} vectors are taken"
        raise ArgumentError(
            f"backbone: mode is {mode}, and the scene has {every} vibration modes{few}; 1 is the lowest"
        )
    return int(vibrations[mode - 1])


class _Search:
    """Finds free oscillations of a system, or of a large one in a few vectors; a family of them over their level.

    `interval`: the levels along which they are followed.
    `dof`: number of the degree of freedom whose displacement at rest is the level of an oscillation; -1 for its energy.
    """

    what: ClassVar[str] = "backbone"
    interval: Interval

    def __init__(self, system: System, work: Work, few: Condensed | None = None, dof: int = -1) -> None:
        self.system, self.work, self.few, self.dof = system, work, few, dof
        self.space: ModalSpace = modes_of(system, work.runs)
        #: Displacements of all degrees of freedom in modes, shape (N, n).
        self.shapes: Array = self.space.shapes if few is None else few.vectors @ self.space.shapes
        self.rotation = system.rotation if few is None else few.full.rotation
        #: Relative change of the oscillations by doubling the vectors.
        self.change: float | None = None

    def energy(self, z: Array, *, linear: bool = False) -> tuple[float, Array]:
        """Return the energy in J of a displacement at rest and its derivative, (n,); without contacts if `linear`."""
        space, laws = self.space, self.system.contacts
        energy, slope = 0.5 * float(space.stiffness @ z**2), space.stiffness * z
        if laws is not None and not linear:
            s = space.contacts @ z - laws.gap
            status = np.where(s > 0.0, CLOSED, OPEN)
            energy += float(laws.closed_potential(s, status))
            slope = slope + laws.force(s, np.zeros_like(s), status) @ space.contacts
        return energy, slope

    def level(self, z: Array, *, linear: bool = False) -> tuple[float, Array]:
        """Return the level of a modal displacement at rest and its derivative, (n,); see `energy`."""
        if self.dof < 0:
            return self.energy(z, linear=linear)
        row = self.shapes[self.dof]
        value = float(row @ z)
        return abs(value), row * np.sign(value)

    def state(self, z: Array) -> State:
        """Return the state at rest over all degrees of freedom."""
        q: Array = self.shapes @ z
        return State(q, np.zeros(q.size))

    def settled(self, found: dict[float, Array]) -> tuple[_Search, dict[float, Array]]:
        """Return the oscillations in so many vectors that twice as many change them little."""
        search = self
        for few in () if self.few is None or not found else self.few.doubled():
            finer, better, change = _Search(few.system, self.work, few, self.dof), {}, 0.0
            for level, one in found.items():
                state = search.state(one[:-1])
                in_finer = modal_state(finer.system, finer.space, few.project(state))[0]
                try:
                    better[level] = finer.solved(np.append(in_finer, one[-1]), level)
                except ConvergenceError:
                    return search, found
                apart = few.change(state, finer.state(better[level][:-1]))
                change = max(change, apart, abs(better[level][-1] / one[-1] - 1.0))
            search.change = change
            if change <= GOOD:
                break
            search, found = finer, better
            search.change = change
        return search, found

    def linear(self, number: int, level: float, by_amplitude: bool) -> Array:
        """Return a linear oscillation of a mode that touches no contact, or else one in which the contacts close."""
        space, laws = self.space, self.system.contacts
        shape = np.zeros(space.size)
        shape[number] = 1.0
        frequency = float(np.sqrt(space.stiffness[number]))
        if laws is not None:
            # On the side that is farther from the stops that the mode reaches first.
            along = space.contacts[:, number]
            reached = np.where(along != 0.0, laws.gap / np.where(along == 0.0, 1.0, np.abs(along)), np.inf)
            first = int(np.argmin(reached))
            shape *= -1.0 if along[first] > 0.0 else 1.0
        if by_amplitude:
            self.dof = int(np.argmax(np.where(self.rotation, 0.0, np.abs(self.shapes[:, number]))))
        unit, _ = self.level(shape, linear=True)
        size = level / unit if by_amplitude else float(np.sqrt(level / unit))
        start = np.append(size * shape, np.pi / frequency)
        if laws is None:
            return start
        # The mode swings to both sides.
        farthest = np.min(np.where(space.contacts[:, number] != 0.0, laws.gap, np.inf))
        reach = float(np.min(reached))
        if size * (1.0 + 1e-9) < reach:
            return start
        if farthest > 0.0:
            return np.append(0.999 * reach * shape, start[-1])
        return self._hardened(start, level)

    def _hardened(self, start: Array, level: float) -> Array:
        """Return an oscillation with contacts that touch at rest. The contacts are soft at first and then stiffened."""
        laws, others = self.system.contacts, [group for group in self.system.laws if group is not self.system.contacts]
        assert laws is not None

        def solve(share: float, guess: Array, now: Array) -> Array:
            system = replace(self.system, laws=(laws.scaled(np.exp(share)), *others))
            share_modes(system, self.system)
            return _Search(system, self.work, self.few, self.dof).solved(guess, level)

        first = float(np.log(_SOFT))
        reached, found = raised(solve, [(first - _HARDER, start)], 0.0, _HARDER, least=_LEAST, largest=_HARDER)[-1]
        if reached < 0.0:
            raise ConvergenceError(
                f"no free oscillation was found whose contacts touch at rest: stiffened from {_SOFT:g} of their "
                f"stiffness on, contacts reached {np.exp(max(reached, first)):.3g} of it. At levels below that of the "
                "equilibrium, in which the contacts press, there is none: ask for higher ones"
            )
        return found

    def path(self, now: Array, level: float, most: int) -> Array:
        """Return the oscillation at a level, followed from another one.

        Steps in the level pass by the narrow tongues of internal resonances, into which the backbone itself leads.
        Where the level turns it is followed by arclength.
        """
        here, goal = float(np.log(self.level(now[:-1])[0])), float(np.log(level))
        if goal <= here + 1e-15:
            return self.solved(now, level)

        def solve(place: float, guess: Array, before: Array) -> Array:
            found = self.solved(guess, float(np.exp(place)))
            one, other = found[:-1], before[:-1]
            apart = one @ other < 0.9 * np.linalg.norm(one) * np.linalg.norm(other)
            if apart or abs(found[-1] / before[-1] - 1.0) > 0.1:
                raise ConvergenceError("the oscillation changes too much in one step")
            return found

        track = raised(solve, [(here, now)], goal, _FIRST, least=_LEAST, largest=_LARGEST, grow=1.6)
        if track[-1][0] == goal:
            return track[-1][1]
        now = track[-1][1]
        towards = now - track[-2][1] if len(track) > 1 else now * np.append(np.ones(self.space.size), 0.0)
        scales = np.append(np.full(now.size - 1, np.linalg.norm(now[:-1])), now[-1])
        family: Any = self
        self.interval = Interval(0.0, level)
        walker = _Arc(family, most=most, noun="backbone")
        here = self.level(now[:-1])[0]
        first = point_at(family, ORIGIN, np.append(now, here), np.append(towards / scales, 0.0))
        walker.follow(first, _SHORT)
        if walker.interrupted:
            raise KeyboardInterrupt
        if walker.points[-1].value != level:
            raise _not_reached(walker.points, "energy" if self.dof < 0 else "amplitude", level, walker.notes[-1])
        return self.solved(walker.points[-1].y[:-1], level)

    def solved(self, guess: Array, level: float) -> Array:
        """Return the oscillation at a level near a guess: displacement at rest and half the period, shape (n + 1,)."""
        return solved(_AtLevel(self, level).evaluate, guess, _STEPS, tolerance=_TOLERANCE).unknowns

    def of(self, y: Array) -> _AtLevel:
        """Return the equations at the level of a point, which is the last of its coordinates."""
        return _AtLevel(self, float(y[-1]))

    def orbit(self, scene: Scene, rest: Array) -> PeriodicOrbit:
        """Return the orbit of an oscillation, from rest at the side that is farther from the stops.

        An amplitude that is met on the other side alone, as where a stop presses at rest, is that of the begin.
        """
        z, half = rest[:-1], float(rest[-1])
        laws, rows = self.system.contacts, self.space.contacts
        if laws is not None:
            self.work.flows += 1
            other = flow(self.system, Start(0.0, z, np.zeros_like(z)), half, counters=self.work.runs).displacement
            asked, there = self.level(z)[0], self.level(other)[0]
            kept = self.dof < 0 or abs(there - asked) <= _KEPT * asked
            if kept and np.max(rows @ other - laws.gap) < np.max(rows @ z - laws.gap):
                z = other
        count = None if self.few is None else self.few.vectors.shape[1]
        problem = Shooting("backbone", scene, period=2.0 * half, work=self.work, vectors=count)
        problem.change = self.change
        unknowns = problem.from_state(self.state(z))
        chart, y = signature_at(problem, unknowns)
        evaluation = chart.evaluate(problem, y).stripped()
        return problem.orbit_of(unknowns, evaluation, lambda: _UNDECIDED, autonomous=True)


class _Arc(Quiet):
    """Follows a backbone beyond a turn."""

    _way: Array | None = None  #: From one instant of rest to the other at the last point, see `_apart`.

    def _closed(self, now: Point, after: Point) -> bool:
        """Return whether the backbone has come back to its first oscillation, or turned into itself.

        It does the latter where both instants of rest are one, as in a higher mode at an even internal resonance:
        beyond are the oscillations that lead there, half a period later.
        """
        one = self._apart(now) if self._way is None else self._way
        self._way = other = self._apart(after)
        self._over = bool(one @ other < _OPPOSITE * np.linalg.norm(one) * np.linalg.norm(other))
        if self._over:
            self.notes.append(
                f"at {after.value:.9g} both instants of rest have become one, in a higher mode at an internal "
                "resonance; beyond are the same oscillations, half a period later"
            )
        return self._over or super()._closed(now, after)

    def _apart(self, point: Point) -> Array:
        """Return the modal displacement from one instant of rest to the other, shape (n,)."""
        search: Any = self.family
        search.work.flows += 1
        z, half = point.y[:-2], float(point.y[-2])
        return flow(search.system, Start(0.0, z, np.zeros_like(z)), half).displacement - z


#: A family of orbits has a double multiplier 1, known to the square root of rounding only.
_UNDECIDED = 1e-6


@dataclass(frozen=True)
class _Evaluation(Evaluation):
    """The equations of a free oscillation."""

    #: Velocities after half a period over the speed of the motion, and one minus the wanted level over the level, shape
    #: (n + 1,).
    residual: Array
    jacobian: Array  #: Shape (n + 1, n + 1).
    scales: Array  #: Shape (n + 1,).
    multipliers: ClassVar[None] = None

    @property
    def error(self) -> float:
        """The largest entry of the residual."""
        return float(np.max(np.abs(self.residual)))


@dataclass(frozen=True)
class _AtLevel:
    """The free oscillations at a level as roots of equations."""

    search: _Search
    level: float
    least: ClassVar[float] = 0.0

    @property
    def size(self) -> int:
        """Number of displacements, whose size is that of the motion; half the period is one more unknown."""
        return self.search.space.size

    def evaluate(self, unknowns: Array, *, derivative: bool = True) -> _Evaluation:
        """Return the equations at a modal displacement at rest and half the period in s, shape (n + 1,)."""
        search, z, half, n = self.search, unknowns[:-1], float(unknowns[-1]), unknowns.size - 1
        if not np.all(np.isfinite(unknowns)) or half <= 0.0:
            raise ConvergenceError("the iteration diverged: half the period is not positive")
        search.work.flows += 1
        try:
            one = flow(
                search.system, Start(0.0, z, np.zeros(n)), half,
                derivative=np.eye(2 * n, n), counters=search.work.runs,
            )  # fmt: skip
        except EventStormError as error:
            raise ConvergenceError(str(error)) from error
        assert one.monodromy is not None
        _, speed = one.sizes
        value, slope = search.level(z)
        if not value > 0.0:
            raise ConvergenceError("the oscillation has vanished")
        slopes = np.concatenate([one.monodromy[n:], one.rate[n:, None]], axis=1) / speed
        jacobian = np.concatenate([slopes, np.append(slope * self.level / value**2, 0.0)[None, :]])
        residual = np.append(one.velocity / speed, 1.0 - self.level / value)
        return _Evaluation(residual, jacobian, np.append(np.full(n, np.linalg.norm(z)), half))


def _not_reached(points: list[Point], what: str, level: float, why: str) -> ConvergenceError:
    """Return the error of a backbone that does not come to a level."""
    changes = np.diff([point.value for point in points])
    turns = np.flatnonzero(changes[:-1] * changes[1:] < 0.0)
    end, turned = points[-1], ""
    # The walk by levels may have ended at the turn itself.
    top = points[0] if changes.size and changes[0] < 0.0 else points[int(turns[0]) + 1] if turns.size else end
    if top is not end:
        turned = (
            f"the backbone turns near {top.value:.9g}, at {np.pi / top.y[-2]:.9g} rad/s, and was followed on to "
            f"{end.value:.9g}, at {np.pi / end.y[-2]:.9g} rad/s; "
        )
    return ConvergenceError(
        f"backbone: by its {what} followed up to {points[0].value:.9g}, and not to {level:.9g}: {turned}{why}. Ask for "
        "levels below; those that were found are in the attribute branch of this error"
    )
