"""A run with its arguments checked, from the start or from where it was stopped."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.assembly import Model
from vofem.blas import blas_threads
from vofem.doubtful import doubtful
from vofem.errors import MethodError
from vofem.integrators.base import ProbeRows, ProbeSamples
from vofem.integrators.method import Method
from vofem.integrators.registry import method_named
from vofem.kernels.choice import choose
from vofem.kernels.mode import Outgrown, decided, kernels
from vofem.laws.law import FEWEST_IN_BAND
from vofem.progress import COMPILING, Progress, RunProgress
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.methods import cheaper, exact_instead, note_cost
from vofem.system import State, System
from vofem.time_functions import Shifted, as_time_function


@dataclass(frozen=True)
class Plan:
    """The checked arguments of a run."""

    method: str
    t_end: float  #: End of the run, s.
    times: Array | None
    dt: float | None  #: Size of a step, s.
    options: dict[str, Any]
    probes: ProbeRows | None
    start: State | None = None  #: State with which the run begins instead of the scene's initial state.
    t_start: float = 0.0  #: Time of the loads in s at which the run begins.
    forgotten: tuple[str, ...] = ()  #: Names of springpots and sliders whose past is lost.
    compiled: bool | None = None  #: Whether kernels were asked to be compiled; None where nobody has decided.
    ran: bool | None = None  #: Whether they are, once the run has begun.


def run_plan(
    scene: Scene,
    plan: Plan,
    progress: Progress,
    writer: Callable[[Plan], Callable[[dict[str, Any]], None]] | None,
    every: float,
    snapshot: dict[str, Any] | None,
) -> Result:
    """Run a plan from its start or from a snapshot, with progress and checkpoints as asked for.

    `writer`: returns, for the plan as it is run, a function that takes snapshots.
    """
    system = model_at(scene.model, plan.t_start).system
    method = method_named(plan.method)
    reason = method.refusal(system)
    if reason is not None:
        raise MethodError(reason)
    asked = plan.compiled if plan.compiled is not None else decided()
    choice = choose(kind_of_run(method, system), plan.ran or None if asked is None else asked)
    if choice.compiled and plan.ran is False:
        snapshot = None
    hint = ""
    if not method.exact and "tol" in plan.options:
        better = exact_instead(system, plan.t_end, plan.options["tol"])
        hint = f"{better} needs no steps here" if better else ""
    while True:
        planned = replace(plan, compiled=asked, ran=choice.compiled)
        save = None if writer is None else writer(planned)
        first = COMPILING.format(plan.method) if choice.first else ""
        begun = time.thread_time()
        try:
            with (
                RunProgress(plan.t_end, progress, save, every, first, hint) as run_progress,
                kernels(compiled=choice.compiled, patience=choice.patience),
                blas_threads(system.size),
            ):
                result = _run(scene, planned, None if run_progress.idle else run_progress, snapshot)
        except Outgrown:
            # Anew, and not from a snapshot of plain Python: no run mixes what both ways round.
            choice, snapshot = choice.instead(), None
            continue
        if not (result.interrupted and choice.first):
            choice.done(time.thread_time() - begun)
        return result


def model_at(model: Model, t_start: float) -> Model:
    """Return a model whose loads and varying orders begin at a time in s; for 0 the same model.

    Both models share what was computed of the system, because it does not depend on time.
    """
    if t_start == 0.0:
        return model
    system = model.system
    loads = tuple(replace(load, function=Shifted(as_time_function(load.function), t_start)) for load in system.loads)
    shifted = replace(system, loads=loads, laws=tuple(group.shifted(t_start) for group in system.laws))
    shifted.share(system)
    return replace(model, system=shifted)


def kind_of_run(method: Method, system: System) -> str:
    """Return what kernels a run needs, as a name that is the same for all runs that need the same ones.

    All methods that step in time share their kernels. The functions of laws are compiled one by one.
    """
    if method.exact:
        return f"{method.name}, damped" if system.damped else method.name
    if not method.steps or method.special:
        return method.name
    count = sum(len(group) for group in system.laws)
    parts = ["steps", *(["many laws" if count >= FEWEST_IN_BAND else "laws"] if count else [])]
    # Loops hold no formulas of laws, but what springpots need over a step.
    return ", ".join([*parts, *(["springpots"] if not all(group.past_is_kept for group in system.laws) else [])])


def _run(scene: Scene, plan: Plan, observer: RunProgress | None, snapshot: dict[str, Any] | None) -> Result:
    """Run a plan, compiled or not as has been decided."""
    from vofem.integrators.coarse import unresolved_contacts

    method = method_named(plan.method)
    model = model_at(scene.model, plan.t_start)
    start = scene.initial_state() if plan.start is None else plan.start
    arguments = dict(plan.options)
    if method.steps:
        arguments["dt"] = plan.dt
    if method.records:
        arguments["probes"] = plan.probes
    solution = method.run(model.system, start, plan.t_end, plan.times, observer=observer, resume=snapshot, **arguments)
    solution.notes.extend(unresolved_contacts(model.system))
    solution.notes.extend(doubtful(scene.model.system, plan.t_start + plan.t_end))
    if method.exact and "tol" not in plan.options:
        solution.notes.extend(cheaper(model.system, plan.t_end))
    if not method.exact and "tol" in plan.options:
        solution.notes.extend(note_cost(model.system, plan.t_end, plan.options["tol"], solution.counters.steps))
    if plan.forgotten and snapshot is None:
        name, sliders = plan.forgotten[0], model.system.sliders
        solution.notes.append(
            f"springpots: Springpot {name!r} begins without the past that it has in the earlier run, at "
            "rest in its place; vofem.resume carries it on"
            if sliders is None or name not in sliders.names
            else f"sliders: the spring of Friction {name!r} begins relaxed, without the force that it has in the "
            "earlier run; vofem.resume carries it on"
        )
    recorded = solution.probes
    if recorded is None and plan.probes is not None:
        # Without steps, the motion at the times of the run.
        samples = solution.sample(solution.times)
        motion = (np.asarray(samples.along(plan.probes.rows, kind)) for kind in "qva")
        recorded = ProbeSamples(plan.probes.names, solution.times, *motion)
    return Result(
        scene, plan.method, solution, recorded, model=model, t_start=plan.t_start, start=plan.start,
        compiled=plan.ran is not False,
    )  # fmt: skip
