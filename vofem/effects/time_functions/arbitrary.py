"""Plain callables of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.effects.time_functions.base import TimeFunction
from vofem.effects.time_functions.piece import Piece
from vofem.errors import ArgumentError, LoadError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arbitrary(TimeFunction):
    """A plain callable of t in s, wrapped and watched: a value that is not a finite number raises `LoadError`."""

    function: Callable[[Any], Any]

    closed_form = False
    looked = np.inf

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        times = np.asarray(t, dtype=float)
        values = np.array([self._value(time) for time in times.ravel()])
        return values.reshape(times.shape)

    def _value(self, t: float) -> float:
        try:
            value = self.function(float(t))
        except Exception as error:
            raise LoadError(
                f"load function {self._name} raised {type(error).__name__}: {error} at t = {t:g} s; it must take one "
                "time in s and return a number"
            ) from error
        try:
            result = float(value)
        except (TypeError, ValueError):
            raise LoadError(
                f"load function {self._name} returned {value!r} at t = {t:g} s, expected a number"
            ) from None
        if not np.isfinite(result):
            raise LoadError(
                f"load function {self._name} returned {result} at t = {t:g} s, expected a finite number; "
                "a division by zero or a table that ends too early is the usual cause"
            )
        return result

    def __repr__(self) -> str:
        return f"function {self._name}"

    @property
    def _name(self) -> str:
        return repr(getattr(self.function, "__name__", self.function))

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Refuse: a plain callable has no known derivative."""
        raise ArgumentError(f"load function {self._name} has no derivative; use Sine, Ramp, Tabulated, ...")

    def piece(self, t0: float) -> Piece:
        """Refuse: a plain callable has no closed form."""
        raise ArgumentError(f"load function {self._name} has no closed form; use Sine, Ramp, Tabulated, ...")
