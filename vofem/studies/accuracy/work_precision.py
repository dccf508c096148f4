"""Error against wall time, steps and counted work, over methods, steps, tolerances and meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from vofem._validate import choice, listed, number
from vofem.errors import ArgumentError
from vofem.integrators.registry import method_named, method_names
from vofem.integrators.registry import methods as all_methods
from vofem.scene import Scene
from vofem.studies.accuracy.bench import Bench, Progress, Source
from vofem.studies.accuracy.study import Run, Setting, Study

#: Steps in a run, where none are given.
_STEPS = (200, 1000, 5000, 25000)

#: Fractions of the critical step for central differences, where none are given.
_FRACTIONS = (0.9, 0.45)


def work_precision(
    scene: Scene | Callable[[int], Scene],
    t_end: float,
    *,
    methods: Iterable[str] | None = None,
    dt: Iterable[float] | None = None,
    tol: Iterable[float] = (),
    elements: Iterable[int] | None = None,
    point: Any = None,
    samples: int = 1001,
    repeats: int = 3,
    cap: float = 10.0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Study:
    """Measure error against computing time: run a scene in many ways, and compare each with a reference.

    The reference is an event-driven run, which is exact in time, on four times
    the elements of the finest mesh. If event_driven does not apply, it is a run
    of energy_conserving on twice the elements, whose steps are halved until the
    time is over or a run fails, and which is checked by Richardson's rule. The
    error of the reference is estimated from a mesh of half its elements. It is
    the floor below which errors mean nothing.

    The errors of each run are separated. The error of the steps is the difference
    to a run on the same mesh that is exact in time. The error of the mesh is the
    difference of that run to the reference. Rounding is the difference to a run
    of the same equations multiplied by 3.

    Parameters
    ----------
    scene : Scene or callable of the number of elements
        A Scene gets other meshes by `vofem.studies.remesh.remeshed`.
    t_end : float
        Duration of the runs in s.
    methods : iterable of str, optional
        Names of methods. The default is all that can treat the scene.
    dt : iterable of float, optional
        Step sizes in s. The default gives 200 to 25 000 steps, and for
        central_difference fractions of its critical step.
    tol : iterable of float
        Tolerances of energy_conserving.
    elements : iterable of int, optional
        Numbers of elements of all beams together. The default is the scene's own
        number and twice as many. It must be given if `scene` is a callable.
    point : point, optional
        Point whose displacement is compared. The default is that of the first
        contact, or without contacts the point that moves most.
    samples : int
        Number of uniform times at which runs are compared.
    repeats : int
        Number of runs, of which the shortest time counts, after one for warming up.
    cap : float
        Largest time of a run in s. A run that would take longer is left out, and
        the study says so.
    workers : int
        Number of processes for runs that are not timed. Timed runs are made
        alone, in this process. With more than one process, a script must start
        the study under ``if __name__ == "__main__":``.
    progress : callable, optional
        Called with the number of runs done, their total number, and a text.

    Returns
    -------
    Study

    Raises
    ------
    ArgumentError
        For arguments out of range, a mesh that the scene cannot have, or methods none of which applies.

    Notes
    -----
    Times are those of a simulation and of the history of the point at `samples`
    times. The time of assembly is given separately. In a study of a chaotic scene
    pointwise errors are taken only up to the horizon of the reference.
    """
    bench = Bench("work_precision", scene, t_end, elements, point, samples, repeats, cap, workers, progress)
    source, t_end = bench.source, bench.t_end
    meshes = bench.meshes or ([source.own, 2 * source.own] if source.own else [0])
    chosen = applicable(source, methods)
    steps = None if dt is None else [number("work_precision: dt", value, positive=True) for value in listed(dt)]
    tolerances = [number("work_precision: tol", value, positive=True) for value in listed(tol)]
    bench.prepare(meshes)
    # From rough to fine, so that the time of the next is known before it starts.
    series = [
        part
        for n in meshes
        for method in chosen
        for part in _series(source, method, n, t_end, steps, tolerances)
    ]  # fmt: skip
    total, done = sum(len(part) for part in series), 0
    for part in series:
        before: Run | None = None
        for setting in part:
            bench.report(done, total, f"{setting}, {setting.elements} elements")
            expected = bench.guess(setting) if before is None else expected_seconds(before, setting)
            before = bench.measure(setting, expected) or before
            done += 1
    bench.report(total, total, "")
    return bench.study()


def expected_seconds(before: Run, setting: Setting) -> float:
    """Return how long a run will take by what a rougher one on the same mesh has taken."""
    if setting.dt is not None and before.setting.dt is not None:
        return before.seconds * before.setting.dt / setting.dt
    if setting.tol is not None and before.setting.tol is not None:
        # Second order: steps grow like one over the root of the tolerance, those with a switch inside faster.
        return float(before.seconds * np.sqrt(before.setting.tol / setting.tol))
    return 0.0


def _series(
    source: Source, method: str, elements: int, t_end: float, dt: Sequence[float] | None, tol: Sequence[float]
) -> list[list[Setting]]:
    """Return the settings of one method on one mesh, in series from rough to fine."""
    description = method_named(method)
    if not description.steps:
        return [[Setting(method, elements)]]
    steps = list(dt) if dt is not None else default_steps(source, method, elements, t_end)
    series = [[Setting(method, elements, dt=step) for step in sorted(steps, reverse=True)]]
    if description.adaptive and tol:
        series.append([Setting(method, elements, tol=value) for value in sorted(tol, reverse=True)])
    return series


def default_steps(source: Source, method: str, elements: int, t_end: float) -> list[float]:
    """Return steps worth looking at, s."""
    if not method_named(method).conditional:
        return [t_end / count for count in _STEPS]
    from vofem.integrators.critical_step import critical_step

    limit = critical_step(source.scene(elements).model.system, None)
    return [min(fraction * limit, t_end / count) for fraction, count in zip(_FRACTIONS, _STEPS[1:], strict=False)]


def applicable(source: Source, methods: Iterable[str] | None) -> list[str]:
    """Return the methods asked for, or those that can treat the scene."""
    system = source.scene(source.own).model.system
    if methods is None:
        return [method.name for method in all_methods() if method.refusal(system) is None]
    chosen = [choice("methods", name, method_names()) for name in listed(methods)]
    if not chosen:
        raise ArgumentError("methods is empty, expected at least one; leave it out for all that apply")
    return list(dict.fromkeys(chosen))
