"""What moves the coordinates of laws beside the structure: the bases that it stands on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.time_functions import Shifted, TimeFunction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moving:
    """Offsets ``g(t)`` of coordinates ``u = b.q + g(t)``, as sums of functions of time.

    Attributes
    ----------
    functions : tuple of TimeFunction
    weights : ndarray, shape (n_laws, n_functions)
    """

    functions: tuple[TimeFunction, ...]
    weights: Array

    def at(self, times: ArrayLike) -> Array:
        """Return the offsets at times, shape (n_laws, *times.shape)."""
        values = np.array([function(times) for function in self.functions])
        return np.asarray(np.tensordot(self.weights, values, 1))

    def rate(self, times: ArrayLike) -> Array:
        """Return the rates of the offsets at times, shape (n_laws, *times.shape)."""
        values = np.array([function.derivative(times) for function in self.functions])
        return np.asarray(np.tensordot(self.weights, values, 1))

    def shifted(self, start: float) -> Moving:
        """Return the offsets for a run that begins at a time in s."""
        return replace(self, functions=tuple(Shifted(function, start) for function in self.functions))


def gathered(parts: Sequence[Sequence[tuple[Any, float]]]) -> Moving | None:
    """Return the offsets of laws from the functions and factors of each, or None where no law has any."""
    functions = tuple(dict.fromkeys(function for part in parts for function, _ in part))
    if not functions:
        return None
    weights = np.zeros((len(parts), len(functions)))
    for row, part in zip(weights, parts, strict=True):
        for function, factor in part:
            row[functions.index(function)] += factor
    return Moving(functions, weights)
