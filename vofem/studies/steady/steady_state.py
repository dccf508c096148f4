"""One steady state of a scene: `periodic`."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Any

import numpy as np

from vofem._validate import choice, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ConvergenceError
from vofem.scene import Scene, as_scene
from vofem.studies.steady.condensed import GOOD
from vofem.studies.steady.family import METHODS, Family, Interval, chosen, problem_of
from vofem.studies.steady.follow import Quiet
from vofem.studies.steady.near import orbit_near
from vofem.studies.steady.newton import Solved, solved
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.rebuild import like_guess
from vofem.studies.steady.shooting import Shooting, relative

#: Largest number of periods of the loads in a transient.
MOST_PERIODS = 200

#: Relative change over an orbit below which Newton's method is tried, and the factor by which it must fall before the
#: next trial.
_TRY, _AGAIN = 1e-2, 0.1

#: Steps of Newton's method in a trial, and the largest distance to its solution, in changes over an orbit.
_STEPS, _FAR = 2, 200.0

#: Least share of the loads from which orbits are followed, and the most orbits from there to the whole loads.
_LEAST, _WAY = 0.01, 500

#: Factor by which a motion is larger than that of an orbit from rest where it has no bound.
_UNBOUNDED = 1e10


@one_thread
def periodic(
    scene: Scene,
    *,
    period: float | None = None,
    periods: int = 1,
    guess: Any = None,
    method: str = "auto",
    harmonics: int | None = None,
) -> PeriodicOrbit:
    """Return a steady state of a scene: a periodic orbit, with its stability.

    Without a guess, shooting simulates a motion from rest until its states at the beginnings of periods settle, at most
    for 200 periods of the loads. Newton's method then finds the exact orbit. The orbit is an attractor, but not
    necessarily the only one. If the motion does not settle, Newton's method starts from the response with all contacts
    open. Where that fails too, an orbit under smaller loads is followed up to the whole loads. A note says so.

    Parameters
    ----------
    scene : Scene
        The scene. For shooting its loads must be sums of `Sine` and `Constant`.
    period : float, optional
        Period of the loads in s. The default is their common period.
    periods : int
        Number of periods of the loads after which the orbit repeats: k for a subharmonic of order k.
    guess : PeriodicOrbit, Result or anything that ``simulate(initial=)`` takes, optional
        The motion from which the search starts. If it is a run, its state at the last full period of the loads is
        taken.
    method : {"auto", "shooting", "harmonic_balance"}
        "shooting" is exact; it accepts the scenes that event_driven accepts. "harmonic_balance" also accepts other
        laws. "auto" takes shooting if it accepts the scene and `harmonics` is not given, otherwise harmonic balance.
    harmonics : int, optional
        Number of harmonics for harmonic balance. The default is 25 for each period of the loads.

    Returns
    -------
    PeriodicOrbit

    Raises
    ------
    ArgumentError
        For arguments out of range, or loads that are not periodic.
    MethodError
        If the method cannot treat the scene.
    ConvergenceError
        If no orbit is found. The message describes what happened and what to try.
    """
    as_scene("periodic", scene)
    choice("periodic: method", method, METHODS)
    periods = whole("periodic: periods", periods)
    scene = like_guess(scene, guess)
    method = chosen(scene, method, harmonics)
    problem = problem_of("periodic", scene, method, periods, period=period, harmonics=harmonics)
    problem, found, notes = first_orbit("periodic", problem, guess)
    orbit = problem.orbit(found.unknowns, found.evaluation)
    orbit.notes.extend(notes)
    return orbit


def first_orbit(what: str, problem: Any, guess: Any) -> tuple[Any, Solved, tuple[str, ...]]:
    """Return an orbit of a problem from a guess or from rest, its minimal period checked, and notes about it.

    The problem is the given one. For a large system it may be one with more vectors, if the orbit needs them.

    Raises `ConvergenceError` if none is found, or one that repeats earlier than after the given number of periods.
    """
    problem = as_guess(problem, guess)
    notes: tuple[str, ...] = ()
    if guess is None and isinstance(problem, Shooting):
        found, notes = _from_rest(what, problem)
    else:
        try:
            if isinstance(problem, Shooting):
                found = orbit_near(problem, None, orbit=guess)
            else:
                found = solved(problem.evaluate, problem.from_rest() if guess is None else problem.from_orbit(guess))
        except ConvergenceError as error:
            origin = "rest" if guess is None else "the guess"
            raise ConvergenceError(
                f"{what}: no orbit was found from {origin}. {error}. Try a guess that is closer, such as the orbit of "
                "a scene that differs less, or vofem.continuation from there"
            ) from error
    shortest = problem.shortest_period(found.unknowns, found.evaluation)
    if shortest < problem.periods:
        raise ConvergenceError(
            f"{what}: an orbit over {problem.periods} periods of the loads was asked for, and the one found repeats "
            f"after {shortest}. Ask for periods={shortest}, or give a guess nearer to an orbit over {problem.periods}: "
            "vofem.continuation finds one by branch.switch at a period doubling"
        )
    if isinstance(problem, Shooting):
        _refuse_unbounded(what, problem, found.evaluation.sizes)
        problem, found, more = _with_enough_vectors(problem, found)
        notes += more
    return problem, found, notes


def _refuse_unbounded(what: str, problem: Shooting, sizes: tuple[float, float]) -> None:
    """Raise where a motion without damping is so large that what the loads do in an orbit is lost in its rounding."""
    if problem.system.damped:
        return
    driven = problem.run(problem.outside(np.zeros(problem.size)), check=True).sizes
    if any(size > _UNBOUNDED * one > 0.0 for size, one in zip(sizes, driven, strict=True)):
        raise ConvergenceError(
            f"{what}: no orbit was found. Its motion is unbounded: a load acts at a natural frequency of a structure "
            "without damping. Add damping, such as ModalDamping, or choose another frequency"
        )


def as_guess(problem: Any, guess: Any) -> Any:
    """Return the problem of a large system with as many vectors as were needed for the orbit that is the guess."""
    few = problem.condensed if isinstance(problem, Shooting) else None
    known = guess.truncation if isinstance(guess, PeriodicOrbit) and guess.method == "shooting" else None
    if few is None or known is None or guess.unknowns is None:
        return problem
    count = guess.unknowns.size // 2
    if count + known.modes != few.full.size or not known.error <= GOOD:
        return problem
    problem = problem if count == few.vectors.shape[1] else problem.in_vectors(count)
    problem.change = known.error
    return problem


def _with_enough_vectors(problem: Shooting, found: Solved) -> tuple[Shooting, Solved, tuple[str, ...]]:
    """Return an orbit of a large system, and notes. Vectors are added until twice as many change it little."""
    notes: tuple[str, ...] = ()
    if problem.condensed is None or problem.change is not None:
        return problem, found, notes
    for few in problem.condensed.doubled():
        finer = problem.in_vectors(few.vectors.shape[1])
        state = problem.state(found.unknowns)
        better = orbit_near(finer, finer.from_state(state))
        problem.change = few.change(state, finer.state(better.unknowns))
        if problem.change <= GOOD:
            return problem, found, ()
        notes = (
            f"half as many vectors give displacements that differ by {problem.change:.1e} of themselves; more are "
            "not taken, so trust no more digits. With more damping an orbit needs fewer vectors",
        )
        problem, found = finer, better
    return problem, found, notes


def _from_rest(what: str, problem: Shooting) -> tuple[Solved, tuple[str, ...]]:
    """Return the orbit that a motion from rest settles on, or one that belongs to the linear response, with a note.

    Raises `ConvergenceError` if no orbit is found in any way.
    """
    x = problem.outside(np.zeros(problem.size))
    level, change = _TRY, np.inf
    for _ in range(max(1, MOST_PERIODS // problem.periods)):
        one = problem.run(x)
        after = problem.to_unknowns(one.displacement, one.velocity)
        before, change = change, relative(after - x, one.sizes)
        if not np.isfinite(change):
            break
        if change <= level and change <= before:
            found = _tried(problem, after, change, one.sizes)
            if found is not None:
                return found, ()
            level = _AGAIN * change
        x = after
    seen = f"after {MOST_PERIODS} periods from rest the motion still changes by {change:.2g} of itself over an orbit"
    failed = []
    for source, found_from in (("the linear response", _linear), ("smaller loads", _raised)):
        try:
            found = found_from(problem)
        except ConvergenceError as error:
            failed.append(f"from {source} {error}")
            continue
        return found, (f"{seen}, so this orbit was found from {source}; motions need not settle on it",)
    regular = (
        "another start, at which the motion is regular, such as one where no contact is touched"
        if what == "continuation"
        else "follow a branch from where the motion is regular with vofem.continuation"
    )
    raise ConvergenceError(
        f"{what}: no orbit was found. {seen}: a subharmonic or chaotic motion, or little damping; "
        f"{', and '.join(failed)}. Try more periods (periods=2, 3, ...), a guess= such as a run with more damping, or "
        f"{regular}"
    )


def _linear(problem: Shooting) -> Solved:
    """Return an orbit near the response with all contacts open."""
    return orbit_near(problem, problem.from_rest())


def _raised(problem: Shooting) -> Solved:
    """Return the orbit in which the orbits under a share of the loads end that begin as the linear response."""

    def build(share: float) -> Scene:
        model = problem.scene.model
        loads = tuple(replace(one, function=one.function * share) for one in model.system.loads)
        system = replace(model.system, loads=loads)
        system.share(model.system)
        return problem.scene.compiled_as(replace(model, system=system))

    family = Family("periodic", build, Interval(0.0, 1.0), "shooting", problem.periods, work=problem.work)
    share = 1.0
    family.begin_with(problem, 1.0)
    first: Any = None
    while share > _LEAST and (first is None or first.evaluation.chart.switches):
        # Where contacts switch there may be several orbits; the linear response is alone.
        share *= 0.5
        with contextlib.suppress(ConvergenceError):
            first = _linear(family.at(share))
    if first is None:
        raise ConvergenceError(f"down to {share:.2g} of the loads no orbit is found")
    walk = Quiet(family, most=_WAY)
    walk.follow(walk.begin(first.unknowns, share))
    if walk.interrupted:
        raise KeyboardInterrupt
    if walk.points[-1].value != 1.0:
        raise ConvergenceError(f"the orbits end at {walk.points[-1].value:.3g} of the loads")
    return orbit_near(problem, walk.points[-1].unknowns())


def _tried(problem: Shooting, x: Array, change: float, sizes: tuple[float, float]) -> Solved | None:
    """Return the orbit that the transient approaches, or None where Newton's method does not find it from here."""
    try:
        found = orbit_near(problem, x, _STEPS)
    except ConvergenceError:
        return None
    multipliers = found.evaluation.multipliers
    assert multipliers is not None
    size = np.abs(multipliers)
    leading = float(size.max()) if size.size else 0.0
    if leading > 1.0 + 1e-9:
        return None
    # The slowest multiplier determines how many times the change over an orbit remains.
    reach = _FAR * change / max(1.0 - leading, 1e-2)
    return found if relative(found.unknowns - x, sizes) <= reach else None
