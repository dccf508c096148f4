"""Runs a scene in one way after another, and measures each against the reference."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from vofem._validate import listed, number, whole
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError, VofemError
from vofem.integrators.methods import EVENT_DRIVEN
from vofem.integrators.registry import without_second_run
from vofem.kernels.mode import compiled
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.simulate.simulation import simulate
from vofem.studies.accuracy.exact import Exact, Question, exact, rounding, simulated
from vofem.studies.accuracy.quantities import Observed, compare, observe
from vofem.studies.accuracy.spread import spread
from vofem.studies.accuracy.study import LeftOut, Reference, Run, Setting, Study
from vofem.studies.accuracy.timing import best_time, machine
from vofem.studies.remesh import can_have, element_count, remeshed

#: Called with the number of parts of a study that are done, their total number, and a name of the next part.
Progress = Callable[[int, int, str], None]

#: The reference has so many times the elements of the finest mesh studied.
_FINER = 4

#: Least time of a step for every unknown, s. Runs that would take far too long by it are not started.
_LEAST = 1e-8


class Source:
    """A scene on any mesh, by `remeshed` or by a function of the number of elements."""

    def __init__(self, given: Scene | Callable[[int], Scene], elements: int | None = None) -> None:
        self._scenes: dict[int, Scene] = {}
        self._build: Callable[[int], Scene] | None = None
        if isinstance(given, Scene):
            self._base = given
            self.own = element_count(given)
            self._scenes[self.own] = given
        elif callable(given):
            if elements is None:
                raise ArgumentError("elements is missing: a function that builds the scene is given them")
            self._build, self.own = given, elements
        else:
            as_scene("accuracy", given)

    def scene(self, elements: int) -> Scene:
        """Return the scene with so many elements."""
        if elements not in self._scenes:
            if self._build is None:
                self._scenes[elements] = remeshed(self._base, elements)
            else:
                self._scenes[elements] = as_scene(f"what build({elements}) returned", self._build(elements))
        return self._scenes[elements]

    def can_have(self, elements: int) -> bool:
        """Return whether there is a mesh of so many elements."""
        return self._build is not None or can_have(self._base, elements)


class Bench:
    """Reference and runs of one scene; `what` is the function that was called, for messages.

    The arguments are those of `work_precision`. `meshes` are the numbers of elements that the caller asks for, in
    order, or None.
    """

    def __init__(
        self, what: str, scene: Scene | Callable[[int], Scene], t_end: float, elements: Iterable[int] | None,
        point: Any, samples: int, repeats: int, cap: float, workers: int, progress: Progress | None,
    ) -> None:  # fmt: skip
        self.t_end = number(f"{what}: t_end", t_end, positive=True)
        self.repeats, self.workers = whole(f"{what}: repeats", repeats), whole(f"{what}: workers", workers)
        self.cap = number(f"{what}: cap", cap, positive=True)
        what_of = f"{what}: elements"
        self.meshes = None if elements is None else sorted({whole(what_of, n) for n in listed(elements)})
        if self.meshes == []:
            raise ArgumentError(f"{what_of} is empty, expected numbers of elements; leave it out for a default")
        self.source = Source(scene, self.meshes[0] if self.meshes else None)
        times = np.linspace(0.0, self.t_end, whole(f"{what}: samples", samples, 2))
        own = self.source.scene(self.source.own)
        point = default_point(own, self.t_end) if point is None else as_point(f"{what}: point", point)
        self.question = Question(self.t_end, times, point, self.cap)
        self._progress = progress
        self.runs: list[Run] = []
        self.left_out: list[LeftOut] = []
        self.reference: Reference | None = None
        self._target: Observed | None = None
        self._exact: dict[int, Exact] = {}
        self._assembly: dict[int, float] = {}
        self._warm: set[tuple[str, bool]] = set()

    @property
    def closed_form(self) -> bool:
        """Whether a method without errors of steps can run the scene."""
        return EVENT_DRIVEN.refusal(self.source.scene(self.source.own).model.system) is None

    def prepare(self, meshes: Iterable[int]) -> None:
        """Compute the reference, and on every mesh the run that is exact in time."""
        meshes = sorted(set(meshes))
        wanted = list(meshes)
        finest = meshes[-1]
        if finest:
            # A run with half of the elements of the reference gives an estimate of its error.
            factor = _FINER if self.closed_form else 2
            wanted += [n for n in (finest * factor // 2, finest * factor) if n not in wanted]
        new = [n for n in wanted if n not in self._exact]
        for done, n in enumerate(new):
            self.report(done, len(new), f"assembling {n} elements" if n else "assembling")
            begin = time.perf_counter()
            _ = self.source.scene(n).model
            self._assembly[n] = time.perf_counter() - begin
        jobs = [(self.source.scene(n), self.question) for n in new]
        self.report(0, len(jobs), "reference")
        for done, (index, found) in enumerate(spread(exact, jobs, self.workers)):
            self._exact[new[index]] = found
            self.report(done + 1, len(jobs), "reference")
        self._choose_reference(max(self._exact))

    def _choose_reference(self, finest: int) -> None:
        best = self._exact[finest]
        floor, horizon = best.error, best.horizon
        coarser = max((n for n in self._exact if n < finest), default=None)
        if coarser is not None:
            horizon = min(horizon, self._exact[coarser].horizon)
            apart = compare(self._exact[coarser].observed, best.observed, horizon).largest
            # Order 2 in the element length; mostly it is higher, and the estimate too large.
            ratio = (finest / coarser) ** 2
            floor = float(np.nansum([floor, apart / (ratio - 1.0)]))
        mesh = f" on {finest} elements" if finest else ""
        size = float(np.max(np.abs(best.observed.history)))
        self.reference = Reference(best.how + mesh, finest, floor, size, horizon)
        self._target = best.observed

    def space_error(self, elements: int) -> float:
        """Return the error of a mesh alone, m: exact in time, against the reference."""
        assert self.reference is not None
        assert self._target is not None
        return compare(self._exact[elements].observed, self._target, self.reference.horizon).largest

    def guess(self, setting: Setting) -> float:
        """Return the least that a run will take, s, before any other of its kind is known."""
        if setting.dt is None:
            return 0.0
        return self.t_end / setting.dt * self.source.scene(setting.elements).model.system.size * _LEAST

    def measure(self, setting: Setting, expected: float = 0.0) -> Run | None:
        """Run in one way, and keep what came of it; None where it was left out.

        `expected`: seconds that the run will take by what is known of others.
        """
        found: Run | LeftOut
        if expected > self.cap:
            found = LeftOut(setting, f"it would take some {expected:.2g} s, the cap is {self.cap:g} s")
        else:
            try:
                found = self._measure(setting)
            except VofemError as error:
                found = LeftOut(setting, f"{type(error).__name__}: {error}")
        if isinstance(found, LeftOut):
            self.left_out.append(found)
            return None
        self.runs.append(found)
        return found

    def _measure(self, setting: Setting) -> Run:
        assert self.reference is not None
        assert self._target is not None
        scene, horizon = self.source.scene(setting.elements), self.reference.horizon

        def run(scene: Scene, question: Question) -> Result:
            # The history belongs to what is timed: some methods compute it when it is asked for.
            result = _simulate(scene, question, setting)
            result.displacement(question.point)
            return result

        self._warm_up(scene, setting)
        seconds, result = best_time(lambda: run(scene, self.question), self.repeats, self.cap)
        observed, on_mesh = observe(result, self.question.point), self._exact[setting.elements]
        return Run(
            setting=setting,
            unknowns=scene.model.system.size,
            seconds=seconds,
            assembly=self._assembly[setting.elements],
            counters=dict(vars(result.counters)),
            total=compare(observed, self._target, horizon),
            time=compare(observed, on_mesh.observed, min(horizon, on_mesh.horizon)),
            space=self.space_error(setting.elements),
            rounding=rounding(scene, self.question, observed, horizon, run),
        )

    def _warm_up(self, scene: Scene, setting: Setting) -> None:
        """Have kernels compiled, or loaded, before the clock starts."""
        key = setting.method, setting.tol is not None
        if key in self._warm:
            return
        self._warm.add(key)
        short = self.t_end / 1000.0 if setting.dt is None else min(2.0 * setting.dt, self.t_end)
        result = _simulate(scene, replace(self.question, t_end=short, times=np.array([0.0, short])), setting)
        result.displacement(self.question.point)

    def report(self, done: int, total: int, what: str) -> None:
        """Report the number of parts that are done, their total number, and a name of the next part."""
        if self._progress is not None:
            self._progress(done, total, what)

    def study(self) -> Study:
        """Return all that was found, observed orders included."""
        assert self.reference is not None
        point = self.question.point.describe()
        runs = tuple(_with_orders(self.runs))
        return Study(point, self.t_end, self.reference, runs, tuple(self.left_out), machine())


def _simulate(scene: Scene, question: Question, setting: Setting) -> Result:
    method = setting.method
    return simulated(scene, question, method, dt=setting.dt, tol=setting.tol, **without_second_run(method))


def _with_orders(runs: list[Run]) -> Iterable[Run]:
    """Give the runs with their orders in dt, each against the run with the next larger step on its mesh."""
    for run in runs:
        setting = run.setting
        larger = [
            (other.setting.dt, other.time.rms) for other in runs
            if other.setting.method == setting.method and other.setting.elements == setting.elements
            and setting.dt is not None and other.setting.dt is not None and other.setting.dt > 1.01 * setting.dt
        ]  # fmt: skip
        if larger and setting.dt is not None:
            dt, error = min(larger, key=lambda one: one[0])
            known = min(error, run.time.rms) > 0.0
            order = float(np.log(error / run.time.rms) / np.log(dt / setting.dt)) if known else float("nan")
            run = replace(run, order=order)
        yield run


def default_point(scene: Scene, t_end: float) -> Any:
    """Return the first contact's first point, or the one that moves most in a rough run."""
    if scene.contacts:
        return scene.contacts[0].a
    from vofem.bodies.beam import Beam

    result = simulate(scene, t_end, times=np.linspace(0.0, t_end, 101), progress=False, compiled=compiled())
    points: list[tuple[float, Any]] = []
    for body in scene.bodies:
        if not isinstance(body, Beam):
            points.append((float(np.max(np.abs(result.displacement(body)))), body))
            continue
        size = np.max(np.abs(result.deflection(body.nodes, body=body)), axis=1)
        points.append((float(np.max(size)), body.at(float(body.nodes[int(np.argmax(size))]))))
    return max(points, key=lambda pair: pair[0])[1]
