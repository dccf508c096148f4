"""Tables of values over time."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.parameters import Numbers, declared, rule
from vofem.time_functions.base import PiecewiseStraight, inside, order_of


@declared(frozen=True, eq=False)
class Tabulated(PiecewiseStraight):
    """A table of values over time, interpolated linearly, and constant before the first and after the last time.

    Raises
    ------
    ArgumentError
        If shapes differ, times do not increase, or a slope is beyond the range of double precision.
    """

    t: Annotated[Array, Numbers("s", "Times, strictly increasing.")]
    values: Annotated[Array, Numbers("the unit of the load", "Values at these times.")]
    _slopes: Array = field(init=False)

    @rule("t", "values")
    def _straight_lines(self) -> None:
        times, values = self.t, self.values
        if times.ndim != 1 or times.shape != values.shape:
            raise ArgumentError(
                f"Tabulated: t has shape {times.shape} and values {values.shape}, expected two equal shapes (n,)"
            )
        if np.any(np.diff(times) <= 0):
            k = int(np.argmax(np.diff(times) <= 0))
            raise ArgumentError(
                f"Tabulated: t must increase strictly, found {times[k]:g} s followed by {times[k + 1]:g} s"
            )
        with np.errstate(over="ignore"):
            slopes = np.diff(values) / np.diff(times)
        if not np.all(np.isfinite(slopes)):
            k = int(np.argmin(np.isfinite(slopes)))
            raise ArgumentError(
                f"Tabulated: between {times[k]:g} s and {times[k + 1]:g} s the values go from {values[k]:g} to "
                f"{values[k + 1]:g}, a slope beyond the range of double precision; expected a smaller change or times "
                "farther apart. For a jump use Pulse or Ramp"
            )
        object.__setattr__(self, "_slopes", np.concatenate([[0.0], slopes, [0.0]]))

    def __repr__(self) -> str:
        return f"Tabulated({self.t.size} values, {self.t[0]:g} to {self.t[-1]:g} s)"

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return np.interp(np.asarray(t, dtype=float), self.t, self.values)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the slope of the interval that starts at or holds t."""
        if order_of(order) == 0:
            return self(t)
        interval = np.searchsorted(self.t, np.asarray(t, dtype=float), side="right")
        return self._slopes[interval] if order == 1 else np.zeros(np.shape(t))

    def breakpoints(self, t_end: float) -> Array:
        """Return the times of the table."""
        return inside(self.t, t_end)

    def corners(self, left: float, right: float) -> Array:
        """Return the times of the table in (left, right)."""
        first, last = np.searchsorted(self.t, left, side="right"), np.searchsorted(self.t, right, side="left")
        return self.t[first:last]
