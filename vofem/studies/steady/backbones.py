"""Nonlinear normal modes of conservative scenes: `backbone`.

If a free oscillation of a conservative scene comes to rest twice in a period, the motion is the same forwards and
backwards in time. It is therefore computed over half a period, from rest to rest. The unknowns are the displacement at
rest and half the period. The equations say that all velocities vanish again and that the energy has the given value.

G. Kerschen, M. Peeters, J. C. Golinval, A. F. Vakakis, Mech. Syst. Signal Process. 23 (2009) 170,
doi:10.1016/j.ymssp.2008.04.002.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, whole
from vofem.blas import one_thread
from vofem.errors import ArgumentError, ConvergenceError, EventStormError, MethodError
from vofem.integrators.event_driven.flow import Start, flow, modal_state, modes_of
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.laws import CLOSED, OPEN, ContactLaws
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.studies.steady.arclength import LostCurveError, until_positive
from vofem.studies.steady.branch import Branch, BranchCounters, Orbits
from vofem.studies.steady.condensed import GOOD, Condensed, condensed_result, reduced
from vofem.studies.steady.counters import Work
from vofem.studies.steady.newton import direction
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.shooting import orbit_result, shooting_refusal
from vofem.system import State, System

Array = NDArray[np.float64]

#: Steps of Newton's method, the residual that is small enough, and what counts as rounding where it stops shrinking.
_STEPS, _TOLERANCE, _ROUNDING = 12, 1e-14, 1e-11

#: First, largest and least step of the logarithm of the energy.
_FIRST, _LARGEST, _LEAST = 0.02, 0.3, 1e-6

#: Number of vectors of a large system for each mode below the one that is followed.
_EACH_MODE = 4

#: First fraction of the contacts' stiffness if contacts touch at rest, and the factor by which it grows.
_SOFT, _HARDER = 1e-3, 2.0


@dataclass(frozen=True)
class _Rest:
    """Half a free oscillation.

    Attributes
    ----------
    z : ndarray, shape (n,)
        Modal displacement at rest.
    half : float
        Half the period, s.
    """

    z: Array
    half: float

    @property
    def y(self) -> Array:
        return np.append(self.z, self.half)


@dataclass(frozen=True)
class _Level:
    """The measure of the size of an oscillation: its energy, or the displacement of one degree of freedom at rest.

    Attributes
    ----------
    dof : int
        Number of the degree of freedom; -1 for the energy.
    """

    dof: int

    def of(self, search: _Search, z: Array, *, linear: bool = False) -> tuple[float, Array]:
        """Return the level of a modal displacement at rest and its derivative, (n,), without contacts if `linear`."""
        system, space = search.system, search.space
        if self.dof >= 0:
            row = search.shapes[self.dof]
            value = float(row @ z)
            return abs(value), row * np.sign(value)
        energy, slope = 0.5 * float(space.stiffness @ z**2), space.stiffness * z
        laws = system.contacts
        if laws is not None and not linear:
            s = space.contacts @ z - laws.gap
            status = np.where(s > 0.0, CLOSED, OPEN)
            energy += float(laws.closed_potential(s, status))
            slope = slope + laws.force(s, np.zeros_like(s), status) @ space.contacts
        return energy, slope


@one_thread
def backbone(
    scene: Scene, mode: int, energies: ArrayLike | None = None, *, amplitudes: ArrayLike | None = None
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
        Amplitudes in m, given instead of energies. The amplitude is the largest displacement of any degree of freedom
        at the instant of rest.

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
        raise ArgumentError("backbone: give either energies or amplitudes, and not both")
    levels = np.atleast_1d(array("backbone: energies or amplitudes", energies if amplitudes is None else amplitudes))
    if levels.ndim != 1 or not levels.size or np.any(levels <= 0.0):
        raise ArgumentError(f"backbone: energies or amplitudes are {levels!r}, expected positive numbers")
    system = scene.model.system
    _check(scene, system)
    work = Work()
    mode = whole("backbone: mode", mode)
    few = reduced(system, _EACH_MODE * mode)
    search = _Search(system if few is None else few.system, work, few)
    number = _mode_number(search.space, mode, system)
    found: dict[float, _Rest] = {}
    now, kind = search.linear(number, float(levels.min()), amplitudes is not None)
    failed: ConvergenceError | None = None
    for level in np.unique(levels).tolist():
        try:
            now = search.path(now, kind, level)
        except ConvergenceError as error:
            failed = error
            break
        found[level] = now
    search, found = search.settled(found, kind)
    levels = np.array([level for level in levels.tolist() if level in found])
    counters = BranchCounters(points=levels.size, flows=work.flows, eigensolves=work.runs.eigensolves)
    orbits = [search.orbit(scene, found[level]) for level in levels.tolist()]
    counters.flows = work.flows
    values = [search.energy(found[level].z) for level in levels.tolist()]
    branch = Branch(np.array(values), Orbits([lambda o=o: o for o in orbits]), [], counters)  # type: ignore[misc]
    if failed is not None:
        failed.branch = branch  # type: ignore[attr-defined]
        raise failed
    return branch


def _check(scene: Scene, system: System) -> None:
    """Raise where a scene is not conservative."""
    reason = shooting_refusal(scene)
    if reason is not None:
        raise MethodError(f"backbone: {reason.split('. Use ')[0].split('; use')[0]}")
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
    """Finds free oscillations of a system, or of a large one in a few vectors."""

    def __init__(self, system: System, work: Work, few: Condensed | None = None) -> None:
        self.system, self.work, self.few = system, work, few
        self.space: ModalSpace = modes_of(system, work.runs)
        #: Displacements of all degrees of freedom in modes, shape (N, n).
        self.shapes: Array = self.space.shapes if few is None else few.vectors @ self.space.shapes
        self.rotation = system.rotation if few is None else few.full.rotation
        #: Relative change of the oscillations by doubling the vectors.
        self.change: float | None = None

    def energy(self, z: Array) -> float:
        """Return the energy of a displacement at rest, J."""
        return _Level(-1).of(self, z)[0]

    def state(self, z: Array) -> State:
        """Return the state at rest over all degrees of freedom."""
        q: Array = self.shapes @ z
        return State(q, np.zeros(q.size))

    def settled(self, found: dict[float, _Rest], kind: _Level) -> tuple[_Search, dict[float, _Rest]]:
        """Return the oscillations in so many vectors that twice as many change them little."""
        search = self
        while found and search.few is not None:
            more = search.few.more()
            finer_system = None if more is None else reduced(search.few.full, more)
            if finer_system is None:
                break
            finer, better, change = _Search(finer_system.system, self.work, finer_system), {}, 0.0
            for level, one in found.items():
                state = search.state(one.z)
                in_finer = modal_state(finer.system, finer.space, finer_system.project(state))[0]
                try:
                    better[level] = finer.solved(_Rest(in_finer, one.half), kind, level)
                except ConvergenceError:
                    return search, found
                apart = search.few.change(state, finer.state(better[level].z))
                change = max(change, apart, abs(better[level].half / one.half - 1.0))
            search.change = change
            if change <= GOOD:
                break
            search, found = finer, better
            search.change = change
        return search, found

    def linear(self, number: int, level: float, by_amplitude: bool) -> tuple[_Rest, _Level]:
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
        dof = -1
        if by_amplitude:
            sizes = np.where(self.rotation, 0.0, np.abs(self.shapes[:, number]))
            dof = int(np.argmax(sizes))
        kind = _Level(dof)
        unit, _ = kind.of(self, shape, linear=True)
        size = level / unit if by_amplitude else float(np.sqrt(level / unit))
        start = _Rest(size * shape, np.pi / frequency)
        if laws is None:
            return start, kind
        # The mode swings to both sides.
        farthest = np.min(np.where(space.contacts[:, number] != 0.0, laws.gap, np.inf))
        reach = float(np.min(reached))
        if size * (1.0 + 1e-9) < reach:
            return start, kind
        if farthest > 0.0:
            return _Rest(0.999 * reach * shape, start.half), kind
        return self._hardened(start, kind, level), kind

    def _hardened(self, start: _Rest, kind: _Level, level: float) -> _Rest:
        """Return an oscillation with contacts that touch at rest. The contacts are soft at first and then stiffened."""
        share, now = _SOFT, start
        factor = _HARDER
        while True:
            laws = self.system.contacts
            assert laws is not None
            softer = _Search(replace_contacts(self.system, laws.scaled(share)), self.work, self.few)
            try:
                found = softer.solved(now, kind, level)
            except ConvergenceError:
                if factor < 1.0 + 1e-4 or now is start:
                    raise
                share /= factor
                factor = 1.0 + 0.3 * (factor - 1.0)
                share = min(share * factor, 1.0)
                continue
            now = found
            if share == 1.0:
                return now
            share = min(share * factor, 1.0)

    def path(self, now: _Rest, kind: _Level, level: float) -> _Rest:
        """Return the oscillation at a level, followed from another one."""
        here, goal = np.log(kind.of(self, now.z)[0]), np.log(level)
        before: tuple[float, Array] | None = None
        step = _FIRST
        if goal <= here + 1e-15:
            return self.solved(now, kind, level)
        while True:
            ahead = min(here + step, goal)
            guess = now.y
            if before is not None:
                guess = guess + (guess - before[1]) * (ahead - here) / (here - before[0])
            else:
                # In proportion to the square root of the energy, or to the amplitude.
                guess[:-1] *= np.exp((ahead - here) * (0.5 if kind.dof < 0 else 1.0))
            try:
                found = self.solved(_Rest(guess[:-1], float(guess[-1])), kind, float(np.exp(ahead)))
                if abs(found.half / now.half - 1.0) > 0.1 or _far(found.z, now.z):
                    raise ConvergenceError("the oscillation changes too much in one step")
            except ConvergenceError as error:
                step *= 0.3
                if step < _LEAST:
                    return self._past_turns(now, before, kind, level, error)
                continue
            before, now, here = (here, now.y), found, ahead
            if ahead == goal:
                return now
            step = min(1.6 * step, _LARGEST)

    def _past_turns(
        self, now: _Rest, before: tuple[float, Array] | None, kind: _Level, level: float, error: ConvergenceError
    ) -> _Rest:
        """Return the oscillation at a level beyond a place where the backbone turns in its level, by arclength."""

        def level_of(y: Array) -> float:
            return kind.of(self, y[:-1])[0] / level - 1.0

        towards = now.y - before[1] if before is not None else now.y * np.append(np.ones(self.space.size), 0.0)
        try:
            first, last = until_positive(self.speeds, level_of, now.y, towards)
            a, b = level_of(first), level_of(last)
            guess = first + (last - first) * a / (a - b)
            return self.solved(_Rest(guess[:-1], float(guess[-1])), kind, level)
        except ConvergenceError as lost:
            here = kind.of(self, now.z)[0]
            beyond = f"{error}; and beyond that level {lost}"
            if isinstance(lost, LostCurveError):
                top, end = (level * (1.0 + level_of(y)) for y in (lost.farthest, lost.last))
                beyond = (
                    f"the backbone turns near {top:.9g}, at {np.pi / lost.farthest[-1]:.9g} rad/s, and was followed on "
                    f"to {end:.9g}, at {np.pi / lost.last[-1]:.9g} rad/s; {lost}"
                )
            what = "energy" if kind.dof < 0 else "amplitude"
            raise ConvergenceError(
                f"backbone: by its {what} followed up to {here:.9g}, and not to {level:.9g}: {beyond}. Ask for levels "
                "below; those that were found are in the attribute branch of this error"
            ) from lost

    def solved(self, guess: _Rest, kind: _Level, level: float) -> _Rest:
        """Return the oscillation at a level near a guess."""
        y, n = guess.y, self.space.size
        best, kept = np.inf, y
        for _ in range(_STEPS):
            if not np.all(np.isfinite(y)) or y[-1] <= 0.0:
                break
            speeds, slopes = self.speeds(y)
            value, slope = kind.of(self, y[:n])
            residual = np.append(speeds, value / level - 1.0)
            error = float(np.max(np.abs(residual)))
            if error < best:
                best, kept = error, y
            elif best <= _ROUNDING:
                break
            if error <= _TOLERANCE:
                break
            matrix = np.zeros((n + 1, n + 1))
            matrix[:n] = slopes
            matrix[n, :n] = slope / level
            y = y - direction(matrix, residual)
        if best > _ROUNDING:
            raise ConvergenceError(f"Newton's method left a residual of {best:.2e}")
        return _Rest(kept[:n], float(kept[-1]))

    def speeds(self, y: Array) -> tuple[Array, Array]:
        """Return the modal velocities after half a period over the speed of the motion, and their derivative.

        Parameters
        ----------
        y : ndarray, shape (n + 1,)
            Modal displacement at rest, and half the period in s.

        Returns
        -------
        ndarray, shape (n,), and ndarray, shape (n, n + 1)
        """
        n = self.space.size
        begin = np.zeros((2 * n, n))
        begin[:n] = np.eye(n)
        start = Start(0.0, y[:n], np.zeros(n))
        self.work.flows += 1
        try:
            one = flow(self.system, start, float(y[-1]), derivative=begin, counters=self.work.runs)
        except EventStormError as error:
            raise ConvergenceError(str(error)) from error
        assert one.monodromy is not None
        _, speed = one.sizes
        slopes = np.concatenate([one.monodromy[n:], one.rate(at_start=False)[n:, None]], axis=1) / speed
        return one.velocity / speed, slopes

    def orbit(self, scene: Scene, rest: _Rest) -> PeriodicOrbit:
        """Return the orbit of an oscillation, from rest at the side that is farther from the stops."""
        n, space = self.space.size, self.space
        z = rest.z
        one = flow(self.system, Start(0.0, z, np.zeros(n)), rest.half, counters=self.work.runs)
        if self.system.contacts is not None:
            gap = self.system.contacts.gap
            if np.max(space.contacts @ one.displacement - gap) < np.max(space.contacts @ z - gap):
                z = one.displacement
        period = 2.0 * rest.half
        full = flow(self.system, Start(0.0, z, np.zeros(n)), period, derivative=np.eye(2 * n), counters=self.work.runs)
        self.work.flows += 2
        assert full.monodromy is not None
        size_z, size_v = full.sizes
        residual = max(np.linalg.norm(full.displacement - z) / size_z, np.linalg.norm(full.velocity) / size_v)
        state, few, change = self.state(z), self.few, self.change
        left_out = None if few is None else few.truncation(period, change)

        def result() -> Result:
            if few is None:
                return orbit_result(scene, state, period)
            return condensed_result(scene, few, state, period, change)

        return PeriodicOrbit(
            scene,
            "shooting",
            np.pi / rest.half,
            1,
            multipliers=np.linalg.eigvals(full.monodromy).astype(complex),
            residual=float(residual),
            result=result,
            truncation=left_out,
            notes=() if left_out is None else (left_out.what,),
            unknowns=np.concatenate([z, np.zeros(n)]),
            start=state,
            autonomous=True,
            decided=lambda: _UNDECIDED,
        )


#: A family of orbits has a double multiplier 1, known to the square root of rounding only.
_UNDECIDED = 1e-6


def _far(a: Array, b: Array) -> bool:
    """Return whether two displacements differ in direction by more than a step may."""
    cosine = float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b))
    return cosine < 0.9


def replace_contacts(system: System, contacts: ContactLaws) -> System:
    """Return a system with other contacts and the same modes; it shares nothing else that was computed."""
    laws: list[Any] = [group for group in system.laws if group is not system.contacts]
    changed = replace(system, laws=(contacts, *laws))
    known = system.cache.get("modal space", None, lambda: None)
    changed.cache.get("modal space", None, lambda: known)
    return changed
