"""A run with its arguments checked, from the start or from where it was stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import MethodError
from vofem.integrators.base import ProbeRows, ProbeSamples, Solution
from vofem.integrators.registry import method_named
from vofem.progress import Progress, Watcher
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.start_time import model_at
from vofem.system import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What is to be run, arguments checked.

    Attributes
    ----------
    method : str
    t_end : float
        In s.
    times : ndarray, optional
    dt : float, optional
        In s.
    options : dict
    probes : ProbeRows, optional
    start : State, optional
        What the run begins with instead of the scene's initial state.
    t_start : float
        Time of the loads at which the run begins, s.
    forgotten : tuple of str
        Names of springpots whose past is not carried on.
    """

    method: str
    t_end: float
    times: Array | None
    dt: float | None
    options: dict[str, Any]
    probes: ProbeRows | None
    start: State | None = None
    t_start: float = 0.0
    forgotten: tuple[str, ...] = ()


def run_plan(
    scene: Scene,
    plan: Plan,
    progress: Progress,
    save: Callable[[dict[str, Any]], None] | None,
    every: float,
    snapshot: dict[str, Any] | None,
) -> Result:
    """Run a plan from the start or from a snapshot, watched as asked for."""
    from vofem.integrators.coarse import unresolved_contacts

    method = method_named(plan.method)
    model = model_at(scene.model, plan.t_start)
    start = scene.initial_state() if plan.start is None else plan.start
    reason = method.refusal(model.system)
    if reason is not None:
        raise MethodError(reason)
    arguments = dict(plan.options)
    if method.steps:
        arguments["dt"] = plan.dt
    if method.records:
        arguments["probes"] = plan.probes
    with Watcher(plan.t_end, progress, save, every) as watcher:
        solution = method.run(
            model.system, start, plan.t_end, plan.times,
            watch=None if watcher.idle else watcher, resume=snapshot, **arguments,
        )  # fmt: skip
    solution.notes.extend(unresolved_contacts(model.system))
    if plan.forgotten and snapshot is None:
        solution.notes.append(
            f"springpots: Springpot {plan.forgotten[0]!r} begins without the past that it has in the earlier run, at "
            "rest in its place; vofem.resume carries it on"
        )
    recorded = _recorded(plan.probes, solution)
    return Result(scene, plan.method, solution, recorded, model=model, t_start=plan.t_start, start=plan.start)


def _recorded(probes: ProbeRows | None, solution: Solution) -> ProbeSamples | None:
    """Return what a run has recorded at points; without steps, their motion at its times."""
    if probes is None:
        return None
    record = solution.probes
    if record is None:
        samples = solution.sample(solution.times)
        motion = (np.asarray(samples.along(probes.rows, kind)) for kind in "qva")
        record = ProbeSamples(probes.names, solution.times, *motion)
    return record
