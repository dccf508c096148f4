"""The functions to which an operator is applied: checked samples on a grid, and their history before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array
from vofem.arrays import Array
from vofem.errors import ArgumentError

Samples = ArrayLike | Callable[[Array], ArrayLike]
History = tuple[ArrayLike, Samples]

#: Deviation from a uniform grid that is taken for rounding, of a step.
_UNIFORM = 1e-9


@dataclass(frozen=True)
class Sampled:
    """A function on a grid."""

    t: Array  #: Increasing, in s; t[0] is the lower limit. Shape (n,).
    values: Array  #: Shape (n,).
    step: float | None  #: Where the grid is uniform.


def sampled(samples: Samples, t: ArrayLike, what: str = "samples", when: str = "t") -> Sampled:
    """Check times and samples, or evaluate a callable; raise `ArgumentError` where they are of no use."""
    times = array(when, t)
    if times.ndim != 1 or len(times) < 2:
        raise ArgumentError(f"{when} has shape {times.shape}, expected one dimension and at least 2 times")
    steps = np.diff(times)
    if not np.all(steps > 0.0):
        k = int(np.argmin(steps > 0.0))
        raise ArgumentError(f"{when} is {times[k]:g} and then {times[k + 1]:g}, expected increasing times")
    given = samples(times) if callable(samples) else samples
    values = array(what, given)
    if values.ndim == 0:  # a constant
        values = np.full(times.shape, values)
    if values.shape != times.shape:
        raise ArgumentError(f"{what} has shape {values.shape}, expected one per time of {when}, {times.shape}")
    step = (times[-1] - times[0]) / (len(times) - 1)
    deviation = np.max(np.abs(times - (times[0] + step * np.arange(len(times)))))
    allowed = _UNIFORM * step + 8.0 * np.finfo(float).eps * np.max(np.abs(times))
    return Sampled(times, values, float(step) if deviation <= allowed else None)


def before(history: History | None, start: float) -> Sampled | None:
    """Check a history ``(times, samples)`` that ends where the samples begin."""
    if history is None:
        return None
    if not (isinstance(history, tuple) and len(history) == 2):
        raise ArgumentError(f"history is {history!r}, expected a pair (times, samples)")
    times, samples = history
    result = sampled(samples, times, "history samples", "history times")
    if abs(result.t[-1] - start) > 1e-9 * (result.t[-1] - result.t[-2]):
        raise ArgumentError(f"the history ends at {result.t[-1]:g} s, expected the lower limit t[0] = {start:g} s")
    return Sampled(np.append(result.t[:-1], start), result.values, result.step)
