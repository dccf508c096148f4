"""Runs that begin at another time of their loads than zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import Model
from vofem.system import System
from vofem.time_functions import Shifted, as_time_function

Array = NDArray[np.float64]


def model_at(model: Model, t_start: float) -> Model:
    """Return a model whose loads and varying orders are those from a time on, in s; the same one for 0.

    What has been computed of the system serves for both, because it does not depend on time.
    """
    if t_start == 0.0:
        return model
    return replace(model, system=_shifted(model.system, t_start))


def _shifted(system: System, t_start: float) -> System:
    loads = tuple(replace(load, function=Shifted(as_time_function(load.function), t_start)) for load in system.loads)
    shifted = replace(system, loads=loads, laws=tuple(group.shifted(t_start) for group in system.laws))
    shifted.share(system)
    return shifted
