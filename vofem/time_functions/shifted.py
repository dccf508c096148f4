"""Functions of time for runs that begin at a later time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.time_functions.base import TimeFunction, Wrapped, inside
from vofem.time_functions.piece import Piece


@dataclass(frozen=True)
class Shifted(Wrapped):
    """``function(start + t)``: a function of time for a run that begins at the time `start`, in s."""

    function: TimeFunction
    start: float

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return self.function(self.start + np.asarray(t, dtype=float))

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the derivative of the function at the shifted times."""
        return self.function.derivative(self.start + np.asarray(t, dtype=float), order)

    def breakpoints(self, t_end: float) -> Array:
        """Return the function's breakpoints in (start, start + t_end), counted from start.

        Each is the smallest number that, added to start, does not lie before the breakpoint, so that the next piece
        holds there.
        """
        known = self.function.breakpoints(self.start + t_end)
        times = known - self.start
        early = self.start + times < known
        while np.any(early):
            times = np.where(early, np.nextafter(times, np.inf), times)
            early = self.start + times < known
        return inside(times, t_end)

    def polynomials(self, t0: Array) -> Array | None:
        """Return the function's polynomials at the shifted times."""
        return self.function.polynomials(self.start + t0)

    def piece(self, t0: float) -> Piece:
        """Return the function's piece at the shifted time."""
        return self.function.piece(self.start + t0)

    def shortest(self, t_end: float) -> float:
        """Return the shortest time in s, until the end of the run, over which the function changes its course."""
        return self.function.shortest(self.start + t_end)

    def moments(self, left: ArrayLike, right: ArrayLike, width: float = np.inf) -> Array:
        """Return the function's moments over the shifted intervals, shape (3, n)."""
        return self.function.moments(self.start + np.asarray(left), self.start + np.asarray(right), width)
