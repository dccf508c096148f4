"""Runs that are exact in time, with estimates of their errors, with which others are compared."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import VofemError
from vofem.integrators.methods import ENERGY_CONSERVING, EVENT_DRIVEN
from vofem.kernels.mode import compiled
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.studies.accuracy.quantities import Observed, observe
from vofem.studies.accuracy.scaled import scaled

#: Above this many degrees of freedom the first run in Ritz vectors takes less time than one in all modes.
_MANY_UNKNOWNS = 300
_TRUNCATION = 1e-9

#: Steps of the first of the runs that check each other where there is no closed form.
_FIRST_STEPS = 2000

#: Fraction of the largest displacement below which a difference that no longer falls is rounding.
_SETTLED = 1e-7

#: Ratio of two successive differences, within which the order 2 counts as observed.
_SECOND_ORDER = (3.0, 5.3)


@dataclass(frozen=True)
class Exact:
    """A run without error in time, or with a known one, on one mesh."""

    observed: Observed
    how: str  #: How it was computed.
    #: Estimated error of the point's displacement on this mesh, m: rounding and truncation, or of the steps.
    error: float
    horizon: float  #: Time in s until which pointwise values are meaningful.


@dataclass(frozen=True)
class Question:
    """The question that every run answers: duration, times of comparison and point."""

    t_end: float  #: End of the run, s.
    times: Array  #: Times of comparison, s, shape (n_times,).
    point: Any
    cap: float  #: Seconds after which no finer run begins where a reference is found by halving steps.


def exact(scene: Scene, question: Question) -> Exact:
    """Return the run of a scene that is exact in time up to an estimated error."""
    if EVENT_DRIVEN.refusal(scene.model.system) is None:
        return _by_events(scene, question)
    return _by_steps(scene, question)


def _by_events(scene: Scene, question: Question) -> Exact:
    result = _event_driven(scene, question)
    growth = result.solution.sensitivity
    horizon = question.t_end if growth is None else growth.horizon()
    observed = observe(result, question.point)
    error, how = rounding(scene, question, observed, horizon, _event_driven), EVENT_DRIVEN.name
    if result.truncation is not None:
        how += f", {result.truncation.vectors} Ritz vectors"
        error += result.truncation.error * float(np.max(np.abs(observed.history)))
    return Exact(observed, how, error, horizon)


def _event_driven(scene: Scene, question: Question) -> Result:
    many = scene.model.system.size > _MANY_UNKNOWNS
    return simulated(scene, question, EVENT_DRIVEN.name, **({"truncation": _TRUNCATION} if many else {}))


def simulated(scene: Scene, question: Question, method: str, **options: Any) -> Result:
    """Return the run of a scene for the times of a question."""
    return simulate(
        scene, question.t_end, method=method, times=question.times, progress=False, compiled=compiled(), **options
    )


def rounding(scene: Scene, question: Question, observed: Observed, horizon: float, run: Any) -> float:
    """Return the largest difference to a run of the same equations with other rounding errors, m; NaN without one.

    `observed`: what the run of the scene itself gave.
    `horizon`: differences beyond it are left aside, s.
    `run`: returns a Result.
    """
    other = scaled(scene)
    if other is None:
        return float("nan")
    history = run(other, question).displacement(question.point)
    return float(np.max(np.abs(history - observed.history)[observed.times <= horizon]))


def _by_steps(scene: Scene, question: Question) -> Exact:
    """Halve the steps of energy_conserving until the time is over or they fail; the last two runs tell the error."""
    steps = _FIRST_STEPS
    last, differences = _stepped(scene, question, steps), [np.inf]
    # The first run may have compiled kernels. This time does not count as time of the study.
    begin, failed = time.perf_counter(), ""
    while True:
        start = time.perf_counter()
        try:
            finer = _stepped(scene, question, 2 * steps)
        except VofemError as why:
            if len(differences) == 1:
                raise
            failed = f" ({2 * steps} steps fail: {why})"
            break
        steps *= 2
        differences.append(float(np.max(np.abs(finer.history - last.history))))
        last = finer
        took = time.perf_counter() - start
        size = float(np.max(np.abs(last.history)))
        rounded = differences[-1] < _SETTLED * size and differences[-1] >= 0.7 * differences[-2]
        # The next run would take twice as long as this one.
        if rounded or time.perf_counter() - begin + 2.0 * took > question.cap:
            break
    ratio = differences[-2] / differences[-1] if differences[-1] > 0.0 else np.inf
    order_two = _SECOND_ORDER[0] <= ratio <= _SECOND_ORDER[1]
    error = differences[-1] / 3.0 if order_two else differences[-1]
    checked = "by Richardson's rule at order 2" if order_two else "by the difference to half as many"
    return Exact(last, f"{ENERGY_CONSERVING.name}, {steps} steps, checked {checked}{failed}", error, question.t_end)


def _stepped(scene: Scene, question: Question, steps: int) -> Observed:
    result = simulated(scene, question, ENERGY_CONSERVING.name, dt=question.t_end / steps, nearby=False)
    return observe(result, question.point)
