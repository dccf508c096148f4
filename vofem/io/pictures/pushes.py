"""Loads of a picture: their places and values, and their largest values over the run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.bodies.base import Point
from vofem.bodies.path import place_at
from vofem.effects import DistributedLoad, Gravity, PointLoad, PointMoment
from vofem.errors import VofemError
from vofem.scene import Scene
from vofem.time_functions import as_time_function

#: Arrows of a distributed load.
_ARROWS = 9


@dataclass(frozen=True)
class Push:
    """A load at the time of a picture."""

    kind: str  #: "force", "moment", "line" (a load along a beam), or "weight".
    points: tuple[Point, ...]  #: Points on which the load acts; empty for the weight.
    #: Values in N, N m or N/m, positive upward. For the weight it is g in m/s^2, positive downward. Shape (n_points,).
    values: Array
    largest: float  #: Largest magnitude over the run, of all points.


def pushes(scene: Scene, times: Array, run: Array) -> list[tuple[Push, ...]]:
    """Return the loads at some times of the loads, with their largest values over the times of the run.

    A load whose values at these times are not known, which may occur for a run from a file, is left out.
    """
    found: list[list[Push]] = [[] for _ in times]
    for effect in scene.effects:
        try:
            parts = _of(effect, times, run)
        except VofemError:
            continue
        for k, push in enumerate(parts):
            if push is not None:
                found[k].append(push)
    return [tuple(some) for some in found]


def _of(effect: Any, times: Array, run: Array) -> list[Push | None]:
    """Return the loads of an effect at some times, None where they are not on the beam; nothing if it is no load."""
    if isinstance(effect, Gravity):
        return [Push("weight", (), np.array([effect.g]), abs(effect.g)) for _ in times]
    if not isinstance(effect, (PointLoad, PointMoment, DistributedLoad)):
        return []
    f = as_time_function(effect.f)
    now = np.asarray(f(times), dtype=float)
    most = float(np.max(np.abs(np.append(np.asarray(f(run), dtype=float), now)), initial=0.0))
    if isinstance(effect, DistributedLoad):
        beam: Beam = effect.beam
        x = np.linspace(beam.nodes[0], beam.nodes[-1], _ARROWS)
        p = effect.along(x)
        points = tuple(beam.at(float(place)) for place in x)
        return [Push("line", points, p * value, most * float(np.max(np.abs(p), initial=0.0))) for value in now]
    kind = "moment" if isinstance(effect, PointMoment) else "force"
    places = [place_at(effect.point, t) for t in times.tolist()]
    return [
        None if place is None else Push(kind, (place,), np.array([value]), most)
        for place, value in zip(places, now, strict=True)
    ]
