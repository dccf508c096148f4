"""Loads per length on a beam, and its elastic bedding, collected from the effects of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.bodies.beam import Beam
from vofem.effects.base_motion import BaseMotion
from vofem.effects.foundation import Foundation
from vofem.effects.loads import DistributedLoad, Gravity
from vofem.time_functions import as_time_function


@dataclass(frozen=True)
class LineLoads:
    """Loads per length on a beam."""

    #: Pairs of a function of an array x, which returns N/m, shape (k,), and a function of time.
    loads: list[tuple[Callable[[Array], Array], Callable[[ArrayLike], Any]]]
    #: Functions of an array x, which return the bedding stiffness in N/m per m, shape (k,).
    bedding: list[Callable[[Array], Array]]

    def pressure(self, x: Array, times: Array) -> Array:
        """Return the sum of the loads in N/m, shape (len(x), len(times))."""
        total = np.zeros((x.size, times.size))
        for along, function in self.loads:
            total += np.outer(along(x), np.broadcast_to(np.asarray(function(times), dtype=float), times.shape))
        return total

    def bed(self, x: Array) -> Array:
        """Return the stiffness of all bedding in N/m per m, shape (len(x),)."""
        return sum((stiffness(x) for stiffness in self.bedding), np.zeros(x.size))


def line_loads(effects: Iterable[Any], beam: Beam) -> LineLoads:
    """Return what acts along a beam: distributed loads, weight, base motion and two-sided foundations."""
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
    return LineLoads(loads, bedding)
