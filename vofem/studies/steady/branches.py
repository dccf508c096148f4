"""Branches of steady states along a parameter: `continuation`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vofem._validate import choice, number, whole
from vofem.blas import one_thread
from vofem.doubtful import undamped
from vofem.errors import ArgumentError, ConvergenceError
from vofem.kernels.choice import by_need
from vofem.kernels.mode import compiling_first
from vofem.progress import COMPILING, Progress, TerminalBar
from vofem.scene import Scene
from vofem.studies.steady.branch import Branch
from vofem.studies.steady.following.family import METHODS, Family, Interval
from vofem.studies.steady.following.follow import LARGEST, REPORTED, Follower
from vofem.studies.steady.following.sheets import branch_of
from vofem.studies.steady.problem import OutOfTime
from vofem.studies.steady.segments.near import in_the_middle
from vofem.studies.steady.segments.shooting import Shooting
from vofem.studies.steady.steady_state import first_orbit

#: Least time in s for the search of the first orbit, if there is a limit.
_SEARCHED = 60.0


@one_thread
@by_need("steady states", small=False)
def continuation(
    build: Callable[[float], Scene],
    start: float,
    stop: float,
    *,
    periods: int = 1,
    guess: Any = None,
    method: str = "auto",
    harmonics: int | None = None,
    max_step: float = LARGEST,
    max_points: int = 5000,
    max_seconds: float | None = None,
    progress: Progress = None,
) -> Branch:
    """Follow a branch of periodic orbits along a parameter, through its folds, by pseudo-arclength.

    The first orbit is found at `start`, from the guess or from rest as in `vofem.periodic`. The branch is followed
    until it leaves the interval between `start` and `stop`. Folds, period doublings, Neimark-Sacker points, branch
    points and, by shooting, grazings are located on the way. Ctrl-C ends the continuation. The part of the branch that
    was found is returned, and a note says so. What `build` raises inside the interval is passed on; the attribute
    `branch` of this error is what was found.

    Parameters
    ----------
    build : callable
        Returns the scene at a value of the parameter. All scenes have bodies and effects of the same names on the same
        mesh. It need not have scenes beyond the interval: where it raises an error there, a shorter step is taken.
    start, stop : float
        Values of the parameter between which the branch is followed.
    periods : int
        Number of periods of the loads after which an orbit repeats.
    guess : PeriodicOrbit, Result or anything that ``simulate(initial=)`` takes, optional
        The motion from which the search for the first orbit starts. Harmonic balance takes the first two alone.
    method : {"auto", "shooting", "harmonic_balance"}
        As in `vofem.periodic`.
    harmonics : int, optional
        Number of harmonics for harmonic balance. The default is 25 for each period of the loads.
    max_step : float
        Largest step along the branch. Its length is the root of the summed squares of the changes of the orbit, divided
        by its size, and of the parameter, divided by the interval. Steps adapt to the branch and are mostly shorter.
    max_points : int
        Largest number of orbits. If it is reached, the continuation ends, and a note says so.
    max_seconds : float, optional
        Time in s after which the continuation ends; the part of the branch that was found is returned, with a note. The
        search of the first orbit may take as long before, or a minute if that is longer.
    progress : bool or callable, optional
        Whether a progress bar is shown, as in `vofem.simulate`. A function is called with the value reached and `stop`.

    Returns
    -------
    Branch

    Raises
    ------
    ArgumentError
        For arguments out of range.
    MethodError
        If the method cannot treat the scene.
    ConvergenceError
        If no orbit is found at `start`, or not in time.
    """
    if not callable(build):
        raise ArgumentError(f"continuation: build is {build!r}, expected a function that returns a Scene at a value")
    start, stop = number("continuation: start", start), number("continuation: stop", stop)
    if Interval(start, stop).empty:
        raise ArgumentError(
            f"continuation: start and stop are both {start:.15g}; expected an interval, or vofem.periodic"
        )
    choice("continuation: method", method, METHODS)
    periods = whole("continuation: periods", periods)
    max_points = whole("continuation: max_points", max_points)
    max_step = number("continuation: max_step", max_step, positive=True)
    if max_seconds is not None:
        max_seconds = number("continuation: max_seconds", max_seconds, positive=True)
    family = Family("continuation", build, Interval(start, stop), method, periods, harmonics)
    problem = family.at(start)
    problem.centred = False
    with TerminalBar(("continuation", REPORTED), progress, 1.0, "") as bar:
        if compiling_first():
            bar.update(0.0, COMPILING.format("steady states"), at_once=True)
        searched = None if max_seconds is None else max(max_seconds, _SEARCHED)
        try:
            with family.work.within(searched):
                problem, found, notes = first_orbit("continuation", problem, guess)
        except OutOfTime:
            raise ConvergenceError(
                f"continuation: no orbit was found at {start:.9g} within {searched:g} s. Raise max_seconds, or give a "
                "guess= such as a run that has settled"
            ) from None
    if isinstance(problem, Shooting):
        found = in_the_middle(problem, found)
    family.begin_with(problem, start)
    walker = Follower(family, largest=max_step, most=max_points, seconds=max_seconds)
    walker.notes += [*notes, *undamped(problem.scene.model.system)]
    try:
        walker.follow(walker.begin(found.unknowns, start, found.evaluation), progress=progress)
    except Exception as error:
        # Mostly of `build`, at one of many values.
        if len(walker.points) > 1:
            error.branch = branch_of(walker)  # type: ignore[attr-defined]
            error.add_note("What was found of the branch until then is in the attribute branch of this error.")
        raise
    return branch_of(walker)
