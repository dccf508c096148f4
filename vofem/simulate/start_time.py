"""Runs whose loads begin at another time than zero."""

from __future__ import annotations

from dataclasses import replace

from vofem.assembly import Model
from vofem.time_functions import Shifted, as_time_function


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
