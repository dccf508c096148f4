"""Runs that are sampled once a period of the loads, after their transient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem._validate import whole
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.initial import StoredState
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.studies.steady.loads import load_period
from vofem.studies.steady.stroboscope import poincare


@dataclass(frozen=True)
class Stroboscope:
    """The times and points at which a run is sampled."""

    #: Points, whose bodies are found by name in every scene; empty for the point of the first contact.
    points: tuple[Any, ...]
    period: float | None  #: Time between two samples in s. The default is the common period of the loads.
    periods: int  #: Number of samples.
    skip: int  #: Periods before the first sample.
    method: str  #: See `vofem.simulate`.

    def samples(self, scene: Scene, initial: Any = None) -> tuple[Array, StoredState]:
        """Return the samples of displacements and velocities, and the state at the last sample.

        Returns `samples` (shape (2, n_points, periods)): displacements, m, and velocities, m/s.
        """
        period = load_period("stroboscope", scene.model.system, self.period).period
        times = period * np.arange(self.skip + 1, self.skip + self.periods + 1)
        result = simulate(scene, float(times[-1]), times=times, initial=initial, method=self.method, progress=False)
        section = poincare(result, period, skip=self.skip + 1)
        samples = [(section.displacement(point), section.velocity(point)) for point in self._of(scene)]
        return np.array(samples).transpose(1, 0, 2), result.as_start()

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Return the names of the points that are sampled."""
        return tuple(point.name for point in self._of(scene))

    def _of(self, scene: Scene) -> tuple[Any, ...]:
        return self.points or (first_point(scene),)


def stroboscope(what: str, points: Any, period: float | None, periods: int, skip: int, method: str) -> Stroboscope:
    """Return the stroboscope that the arguments of a diagram describe, and check them."""
    chosen = () if points is None else tuple(points) if isinstance(points, (tuple, list)) else (points,)
    skipped = whole(f"{what}: skip", skip, least=0)
    return Stroboscope(chosen, period, whole(f"{what}: periods", periods), skipped, method)


def first_point(scene: Scene) -> Any:
    """Return the point of the first contact of a scene.

    Raises `ArgumentError` if there is none.
    """
    if not scene.contacts:
        raise ArgumentError("the scene has no contact whose point could be looked at; give points=")
    return scene.contacts[0].points()[0]


def order_of(samples: Array, tolerance: Array) -> int:
    """Return the number of samples after which they repeat, or 0 if they do not.

    `samples` has shape (..., periods).
    `tolerance` (shape (..., 1)): by which samples may differ, in their unit.
    """
    periods = samples.shape[-1]
    if not np.all(np.isfinite(samples)):
        return 0
    for k in range(1, periods // 2 + 1):
        if np.all(np.abs(samples[..., k:] - samples[..., :-k]) <= tolerance):
            return k
    return 0
