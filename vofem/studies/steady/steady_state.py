"""One steady state of a scene: `periodic`."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem._validate import choice, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ConvergenceError
from vofem.kernels.choice import by_need
from vofem.scene import Scene, as_scene
from vofem.studies.steady.condensed import GOOD
from vofem.studies.steady.following.family import METHODS, Family, Interval, chosen, problem_of
from vofem.studies.steady.following.follow import Quiet
from vofem.studies.steady.newton import Solved, solved
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.segments.near import orbit_near
from vofem.studies.steady.segments.rebuild import like_guess
from vofem.studies.steady.segments.shooting import CLOSES, Shooting, relative
from vofem.studies.steady.segments.signature import signature_of

if TYPE_CHECKING:
    from vofem.studies.steady.harmonic.balance import HarmonicBalance

#: Largest number of periods of the loads in a transient.
MOST_PERIODS = 200

#: Relative change over an orbit below which Newton's method is tried, and the factor by which it must fall before the
#: next trial.
_TRY, _AGAIN = 1e-2, 0.1

#: Steps of Newton's method in a trial, and the largest distance to its solution, in changes over an orbit.
_STEPS, _FAR = 2, 200.0

#: Places at which a motion that does not settle comes back nearly, from which orbits are searched.
_RETURNS = 12

#: Shares of the loads from which orbits are followed, and the most orbits from there to the whole loads.
_SHARES, _WAY = tuple(0.5**k for k in range(8)), 500

#: Largest distance of an orbit from a transient that has settled, as a share of it.
_SETTLED = 0.05

#: Factor by which a motion is larger than that of an orbit from rest where it has no bound.
_UNBOUNDED = 1e10


@one_thread
@by_need("steady states")
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
    open. Where that fails too, an orbit under smaller loads is followed up to the whole loads, and last Newton's method
    starts from where the motion nearly repeats. A note says so.
    Harmonic balance starts from the linear response, then from smaller loads, and last from a transient.

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
        taken. Harmonic balance takes the first two alone.
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
            found = _from_response(problem) if guess is None else _near(problem, None, guess)
        except ConvergenceError as error:
            origin = "rest" if guess is None else "the guess"
            raise ConvergenceError(
                f"{what}: no orbit was found from {origin}. {error}. Try a guess that is closer, such as the orbit of "
                "a scene that differs less, or vofem.continuation from there"
            ) from error
    shortest = problem.shortest_period(found.unknowns, found.evaluation)
    if shortest < problem.periods:
        count = problem.periods
        how = (
            f"branch.switch finds one at a period doubling of a branch over {count // 2} periods"
            if count % 2 == 0
            else f"an orbit of vofem.backbone at 1/{count} of the frequency of the loads may be one"
        )
        raise ConvergenceError(
            f"{what}: an orbit over {count} periods of the loads was asked for, and the one found repeats after "
            f"{shortest}. Ask for periods={shortest}, or give a guess nearer to an orbit over {count}: {how}"
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


#: Why a motion may not settle.
_MANY = ": a subharmonic or chaotic motion, little damping, or a body without springs that drifts"


def _from_rest(what: str, problem: Shooting) -> tuple[Solved, tuple[str, ...]]:
    """Return the orbit that a motion from rest settles on, or one that belongs to the linear response, with a note.

    Raises `ConvergenceError` if no orbit is found in any way.
    """
    x, passed = problem.outside(np.zeros(problem.size)), list[tuple[float, Array]]()
    level, change, seen = _TRY, np.inf, ""
    for _ in range(max(1, MOST_PERIODS // problem.periods)):
        one = problem.run(x)
        after = problem.to_unknowns(one.displacement, one.velocity)
        before, change = change, relative(after - x, one.sizes)
        if not np.isfinite(change):
            break
        if change <= level and change <= before:
            try:
                signature_of(problem, one)
            except ConvergenceError as error:
                seen = f"from rest {error}; a contact damper ends chatter, and so may acts_on='penetration'"
                break
            found = _tried(problem, after, change, one.sizes)
            if found is not None:
                return found, ()
            level = _AGAIN * change
        passed.append((change, x))
        x = after
    many = "" if seen or change <= CLOSES else _MANY
    seen = seen or (
        f"after {MOST_PERIODS} periods from rest the motion still changes by {change:.2g} of itself over an orbit"
        if change > CLOSES
        else "the motion from rest repeats, and Newton's method finds no orbit with its switches"
    )
    try:
        found, source = _raised(problem)
        return found, (f"{seen}, so this orbit was found from {source}; motions need not settle on it",)
    except ConvergenceError as error:
        failed = str(error)
    # A chaotic motion comes near to orbits that are not stable, again and again.
    for _, start in sorted(passed, key=itemgetter(0))[:_RETURNS]:
        with suppress(ConvergenceError):
            found = orbit_near(problem, start)
            if problem.shortest_period(found.unknowns, found.evaluation) == problem.periods:
                where = "where the motion nearly repeats; motions need not settle on it"
                return found, (f"{seen}, so this orbit was found {where}",)
    raise ConvergenceError(
        f"{what}: no orbit was found. {seen}{many}; {failed}. Try more "
        "periods (periods=2, 3, ...), a guess= such as a run with more damping, or follow a branch with "
        "vofem.continuation from where the motion is regular, such as where no contact is touched"
    )


def _from_response(problem: HarmonicBalance) -> Solved:
    """Return the orbit by harmonic balance from the linear response or smaller loads, or else from a transient."""
    try:
        return _raised(problem)[0]
    except ConvergenceError:
        return _near(problem, problem.transient)


def _near(problem: Any, start: Array | None, guess: Any = None) -> Solved:
    """Return the orbit near some unknowns, or near a guess."""
    if isinstance(problem, Shooting):
        return orbit_near(problem, start, orbit=guess)
    return solved(problem.evaluate, problem.from_orbit(guess) if start is None else start)


def _raised(problem: Any) -> tuple[Solved, str]:
    """Return the orbit near the linear response, or that in which the orbits under a share of the loads end; and which.

    By harmonic balance a transient comes in between.

    Raises `ConvergenceError` if there is none.
    """

    def build(share: float) -> Scene:
        model = problem.scene.model
        loads = tuple(replace(one, function=one.function * share) for one in model.system.loads)
        system = replace(model.system, loads=loads)
        system.share(model.system)
        return problem.scene.compiled_as(replace(model, system=system))

    method, harmonics = ("shooting", None) if isinstance(problem, Shooting) else ("harmonic_balance", problem.harmonics)
    interval = Interval(_SHARES[-1], 1.0)
    family = Family(problem.what, build, interval, method, problem.periods, harmonics, problem.work, problem.period)
    family.begin_with(problem, 1.0)
    begun, failed = None, ""
    for share in _SHARES:
        try:
            found = _near(family.at(share), family.at(share).from_rest())
        except ConvergenceError as error:
            failed = failed or str(error)
            if share == 1.0 and method == "harmonic_balance" and (settled := _settled(problem)) is not None:
                return settled, "a transient"
            continue
        if share == 1.0:
            return found, "the linear response"
        begun = found.unknowns, share, found.evaluation
        # Where contacts switch there may be several orbits; the linear response is alone.
        if method != "shooting" or not found.evaluation.chart.switches:
            break
    if begun is None:
        raise ConvergenceError(f"from the linear response {failed}, and down to {share:.2g} of the loads none is found")
    walk = Quiet(family, most=_WAY)
    walk.follow(walk.begin(*begun))
    if walk.interrupted:
        raise KeyboardInterrupt
    if walk.points[-1].value != 1.0:
        end = walk.points[-1].value
        raise ConvergenceError(
            f"from the linear response {failed}, and from smaller loads they end at {end:.3g} of them"
        )
    return _near(problem, walk.points[-1].unknowns()), "smaller loads"


def _settled(problem: HarmonicBalance) -> Solved | None:
    """Return the orbit on which a motion from rest has settled, which costs less than smaller loads; None if none."""
    with suppress(ConvergenceError):
        start = problem.transient
        found = _near(problem, start)
        if np.linalg.norm(found.unknowns - start) <= _SETTLED * np.linalg.norm(start):
            return found
    return None


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
    # The slowest multiplier determines how many times the change over an orbit remains; what rests does not change.
    reach = max(_FAR * change / max(1.0 - leading, 1e-2), CLOSES)
    return found if relative(found.unknowns - x, sizes) <= reach else None
