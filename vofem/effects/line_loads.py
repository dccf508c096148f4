"""Section forces of a beam that balance the loads along it and its elastic bedding, which are effects of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.bodies.beam import Beam
from vofem.bodies.recovery import recovered_sections
from vofem.effects.base_motion import BaseMotion
from vofem.effects.foundation import Foundation
from vofem.effects.loads import DistributedLoad, Gravity
from vofem.time_functions import as_time_function


def balanced_sections(
    effects: Iterable[Any], beam: Beam, x: ArrayLike, times: Array, q: Array, a: Array | None = None
) -> tuple[Array, Array]:
    """Return bending moment (N m) and shear force (N) that balance loads and, with accelerations, inertia.

    `q`, `a` (shape (beam.size, n_times)): degrees of freedom and their second rates; results are (len(x), n_times).
    """
    loads: list[tuple[Callable[[Array], Array], Callable[[ArrayLike], Any]]] = []
    bedding: list[Callable[[Array], Array]] = []
    for effect in effects:
        match effect:
            case DistributedLoad() if effect.beam is beam:
                loads.append((effect.along, as_time_function(effect.f)))
            case Gravity():
                loads.append((lambda x, g=effect.g: -g * beam.mass_per_length(x), np.ones_like))  # type: ignore[misc]
            case BaseMotion() if effect.body is beam:
                loads.append((lambda x: -beam.mass_per_length(x), as_time_function(effect.acceleration)))
            case Foundation() if effect.beam is beam and not effect.one_sided:
                bedding.append(effect.along)
    values = [np.broadcast_to(np.asarray(function(times), dtype=float), times.shape) for _, function in loads]

    def load(places: Array) -> Array:
        total = np.zeros((places.size, times.size))
        for (along, _), value in zip(loads, values, strict=True):
            total += np.outer(along(places), value)
        eta = beam.field_matrix(places)
        if a is not None:
            total -= beam.mass_per_length(places)[:, None] * (eta @ a)
        if bedding:
            total -= sum((stiffness(places) for stiffness in bedding), np.zeros(places.size))[:, None] * (eta @ q)
        return total + beam.tension * (beam.field_matrix(places, 2) @ q) if beam.tension else total

    return recovered_sections(beam, x, q, load)
