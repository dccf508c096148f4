"""The fastest method, step and mesh that meet a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem._validate import number
from vofem.integrators.registry import method_named
from vofem.scene import Scene
from vofem.studies.accuracy.bench import Bench, Progress, Source
from vofem.studies.accuracy.study import Run, Setting, Study
from vofem.studies.accuracy.work_precision import applicable, default_steps, expected_seconds

#: Numbers of elements that are tried where none are given, as multiples of those of the scene.
_MULTIPLES = (0.25, 0.5, 1, 2, 4)

#: Most steps of one size that are tried on a mesh.
_TRIES = 8


@dataclass(frozen=True, repr=False)
class Cheapest:
    """The answer of `cheapest`. Print it to read it.

    Attributes
    ----------
    run : Run, optional
        The fastest run that meets the tolerance; None if no run does.
    tolerance : float
        The tolerance, relative to the largest displacement.
    study : Study
        All runs that were made, and what was left out.
    """

    run: Run | None
    tolerance: float
    study: Study

    def __repr__(self) -> str:
        found = "no run" if self.run is None else f"{self.run.setting} on {self.run.setting.elements} elements"
        return f"Cheapest({found}, tolerance={self.tolerance:g}, {self.study!r})"

    def __str__(self) -> str:
        """Return the advice."""
        return self.study.advice(self.tolerance)


def cheapest(
    scene: Scene | Callable[[int], Scene],
    t_end: float,
    tolerance: float,
    *,
    methods: Iterable[str] | None = None,
    elements: Iterable[int] | None = None,
    point: Any = None,
    samples: int = 1001,
    repeats: int = 3,
    cap: float = 10.0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Cheapest:
    """Find the fastest method, step and mesh whose error stays within a tolerance.

    First the error of each mesh is measured by runs that are exact in time. The
    coarsest mesh whose error is well within the tolerance is tried first. If no
    method meets the tolerance on it, the next finer one is tried. Steps are
    refined, guided by the observed error, until a run meets the tolerance or
    takes longer than the fastest run that does.

    Parameters
    ----------
    scene : Scene or callable of the number of elements
    t_end : float
        Duration of the runs in s.
    tolerance : float
        Largest error of the displacement of the point, relative to its largest displacement.
    methods, point, samples, repeats, cap, workers, progress
        As for `work_precision`.
    elements : iterable of int, optional
        Numbers of elements to choose from. The default is a quarter to four times
        the scene's own number. It must be given if `scene` is a callable.

    Returns
    -------
    Cheapest

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """
    tolerance = number("cheapest: tolerance", tolerance, positive=True)
    bench = Bench("cheapest", scene, t_end, elements, point, samples, repeats, cap, workers, progress)
    chosen = applicable(bench.source, methods)
    meshes = bench.meshes or _around(bench.source)
    bench.prepare(meshes)
    assert bench.reference is not None
    allowed = tolerance * bench.reference.scale
    fine_enough = [n for n in meshes if bench.space_error(n) <= allowed] or meshes[-1:]
    best: Run | None = None
    for n in fine_enough:
        for method in chosen:
            found = filter(None, (best, _search(bench, method, n, allowed, best)))
            best = min(found, key=lambda run: run.seconds, default=None)
        if best is not None:
            break
    return Cheapest(best, tolerance, bench.study())


def _around(source: Source) -> list[int]:
    if not source.own:
        return [0]
    wanted = {int(m * source.own) for m in _MULTIPLES if float(m * source.own).is_integer()}
    return sorted(n for n in wanted if n >= 1 and source.can_have(n))


def _search(bench: Bench, method: str, elements: int, allowed: float, best: Run | None) -> Run | None:
    """Return the run with the largest step found that meets the tolerance; stop once it is slower than another one."""
    if not method_named(method).steps:
        run = bench.measure(Setting(method, elements))
        return run if run is not None and run.judged <= allowed else None
    dt, before = default_steps(bench.source, method, elements, bench.t_end)[0], None
    for _ in range(_TRIES):
        setting = Setting(method, elements, dt=dt)
        expected = bench.guess(setting) if before is None else expected_seconds(before, setting)
        if before is not None and best is not None and expected > 2.0 * best.seconds:
            return None
        run = bench.measure(setting, expected)
        if run is None:
            return None
        if run.judged <= allowed:
            return run
        # Order 2, with a margin; where it is lower this takes a few more tries.
        ratio = 0.8 * np.sqrt(allowed / run.judged) if np.isfinite(run.judged) else 0.1
        dt, before = dt * float(np.clip(ratio, 0.05, 0.5)), run
    return None
