"""Runs that begin at another time of their loads than zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import Model
from vofem.effects.time_functions import Shifted, as_time_function
from vofem.system import SpringpotLaws, System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShiftedOrder:
    """The order of a springpot as a run sees it that begins at `start`, in s."""

    order: Callable[[Array], Any]
    start: float

    def __call__(self, t: Array) -> Any:
        """Return the orders at times t, shape (n,)."""
        return self.order(self.start + np.asarray(t, dtype=float))


def model_at(model: Model, t_start: float) -> Model:
    """Return a model whose loads and varying orders are those from a time on, in s; the same one for 0.

    What has been computed of the system serves for both, because it does not depend on time.
    """
    if t_start == 0.0:
        return model
    return replace(model, system=_shifted(model.system, t_start))


def _shifted(system: System, t_start: float) -> System:
    loads = tuple(replace(load, function=Shifted(as_time_function(load.function), t_start)) for load in system.loads)
    pots = system.springpots
    if pots is not None:
        laws = tuple(
            replace(law, order=ShiftedOrder(law.order, t_start)) if callable(law.order) else law for law in pots.laws
        )
        pots = SpringpotLaws(pots.rows, laws)
    shifted = replace(system, loads=loads, springpots=pots)
    shifted.share(system)
    return shifted
