"""Branches of steady states along a parameter: `continuation`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vofem._validate import choice, number, whole
from vofem.errors import ArgumentError
from vofem.progress import Progress
from vofem.scene import Scene
from vofem.studies.steady.branch import Branch, BranchCounters
from vofem.studies.steady.branch_progress import branch_progress
from vofem.studies.steady.family import Family
from vofem.studies.steady.follow import LARGEST, Follower
from vofem.studies.steady.methods import METHODS
from vofem.studies.steady.point import Interval
from vofem.studies.steady.sheets import branch_of
from vofem.studies.steady.steady_state import first_orbit


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
    progress: Progress = None,
) -> Branch:
    """Follow a branch of periodic orbits along a parameter, through its folds, by pseudo-arclength.

    The first orbit is found at `start`, from the guess or from rest as in `vofem.periodic`. The branch is followed
    until it leaves the interval between `start` and `stop`. Folds, period doublings, Neimark-Sacker points, branch
    points and, by shooting, grazings are located on the way. Ctrl-C ends the walk; what was found is returned, and a
    note says so.

    Parameters
    ----------
    build : callable
        Returns the scene at a value of the parameter: bodies and effects of the same names, on the same mesh. It is
        also called for values a millionth of the interval away from points of the branch, for derivatives.
    start, stop : float
        Values of the parameter.
    periods : int
        How many periods of the loads an orbit takes.
    guess : PeriodicOrbit, Result or anything that ``simulate(initial=)`` takes, optional
        For the first orbit.
    method : {"auto", "shooting", "harmonic_balance"}
        As in `vofem.periodic`.
    harmonics : int, optional
        Of harmonic balance.
    max_step : float
        Largest step along the branch: changes of the orbit over its size and of the parameter over the interval,
        squared and summed. Steps adapt to the branch and are mostly shorter.
    max_points : int
        After so many orbits the walk ends, and a note says so.
    progress : bool or callable, optional
        A bar on the standard error stream, as in `vofem.simulate`; a function is called with the value reached and
        `stop`.

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
        If no orbit is found at `start`.
    """
    if not callable(build):
        raise ArgumentError(f"continuation: build is {build!r}, expected a function that returns a Scene at a value")
    start, stop = number("continuation: start", start), number("continuation: stop", stop)
    if start == stop:
        raise ArgumentError(f"continuation: start and stop are both {start:g}; expected an interval, or vofem.periodic")
    choice("continuation: method", method, METHODS)
    periods = whole("continuation: periods", periods)
    max_points = whole("continuation: max_points", max_points)
    max_step = number("continuation: max_step", max_step, positive=True)
    family = Family("continuation", build, method, periods, harmonics)
    interval = Interval(start, stop)
    problem = family.at(start)
    problem, found, notes = first_orbit("continuation", problem, guess)
    family.begin_with(start, problem)
    counters = BranchCounters(search_flows=family.work.flows)
    walker = Follower(family, interval, counters, largest=max_step, most=max_points)
    with branch_progress(interval, progress) as report:
        track = walker.follow(walker.begin(found.unknowns, start), report=report)
    counters.eigensolves = family.work.runs.eigensolves
    track.notes[:0] = notes
    return branch_of(track, family, walker)
