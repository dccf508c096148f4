"""Quantities of a run that a study file can ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.result import Result


def _amplitude(values: Array) -> float:
    return 0.5 * float(np.ptp(values))


def _largest(values: Array) -> float:
    return float(np.abs(values).max())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


#: Of the displacement of a point at the stored times, in m: how the numbers are drawn together.
OF_POINTS: dict[str, Callable[[Array], float]] = {
    "amplitude": _amplitude,
    "largest": _largest,
    "mean": lambda values: float(np.mean(values)),
    "rms": _rms,
    "maximum": lambda values: float(np.max(values)),
    "minimum": lambda values: float(np.min(values)),
    "final": lambda values: float(values[-1]),
}

#: Of a contact by its name: closings as a number, forces in N, the share of time during which it is closed.
OF_CONTACTS = ("closings", "peak_force", "rms_force", "closed_share")

#: Of the run as a whole.
OF_RUNS = ("balance_error", "segments")


@dataclass(frozen=True)
class Measure:
    """One quantity of a run."""

    kind: str  #: One of `OF_POINTS`, `OF_CONTACTS` or `OF_RUNS`.
    of: Any  #: A point, or the name of a contact; None for the run.

    def value(self, result: Result, after: float) -> float:
        """Return the quantity over the stored times from `after` on, in s."""
        times = result.times
        late = times >= after
        if self.kind in OF_POINTS:
            return OF_POINTS[self.kind](result.displacement(self.of)[late])
        if self.kind in OF_CONTACTS:
            contact = result.contacts[self.of]
            if self.kind == "closings":
                return float(np.count_nonzero(contact.closings >= after))
            if self.kind == "closed_share":
                return float(np.mean(contact.closed[late]))
            force = contact.force[late]
            return _largest(force) if self.kind == "peak_force" else _rms(force)
        return float(result.energy.balance_error if self.kind == "balance_error" else result.counters.steps)
