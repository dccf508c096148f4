"""What moves the coordinates of laws beside the structure: bases that it stands on, and points that travel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.arrays import Array
from vofem.time_functions import Shifted, TimeFunction

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class Track(Protocol):
    """A point that travels, as `vofem.bodies.TravellingPoint` offers it."""

    body: Any

    def cubics(self, t: Array, derivative: int = 0) -> tuple[NDArray[np.int64], Array]:
        """Return degrees of freedom and weights of a derivative of the displacement by x, each (k, 4)."""

    def velocity(self, t: Array) -> Array:
        """Return the speed along the body at times t, m/s."""

    def road(self, t: Array) -> Array:
        """Return the height of the road above the axis at times t, m."""

    def road_rate(self, t: Array) -> Array:
        """Return the rate at which this height changes, m/s."""

    def present(self, t: Array) -> NDArray[np.bool_]:
        """Return whether there is anything below the point at times t."""

    def inside(self, t: Array) -> NDArray[np.bool_]:
        """Return whether the point is on the body at times t."""

    def jumps(self, start: float, stop: float) -> Array:
        """Return the times at which the point steps onto the body, or off it, where that is not held, s."""

    def describe(self) -> str:
        """Return body and path."""


@dataclass(frozen=True)
class Rider:
    """The part of a law's coordinate that travels: ``sign (b(t).q + r(t))``, r being the height of the road."""

    track: Track
    sign: float
    body: csr_matrix  #: The body's degrees of freedom from the unknowns, shape (size, n).
    start: float = 0.0  #: Time in s at which the run begins.

    def rows(self, times: Array) -> csr_matrix:
        """Return the rows b at times, csr_matrix (k, n)."""
        return self._rows(times, 0)

    def rates(self, times: Array) -> csr_matrix:
        """Return the rates of the rows at times, csr_matrix (k, n)."""
        from scipy.sparse import diags

        return (diags(self.track.velocity(self.start + times)) @ self._rows(times, 1)).tocsr()

    def _rows(self, times: Array, derivative: int) -> csr_matrix:
        from scipy.sparse import csr_matrix

        columns, weights = self.track.cubics(self.start + times, derivative)
        ends = 4 * np.arange(times.size + 1)
        found = csr_matrix((weights.ravel(), columns.ravel(), ends), shape=(times.size, self.body.shape[0]))
        return (self.sign * (found @ self.body)).tocsr()

    def road(self, times: Array) -> Array:
        """Return the share of the road in the coordinate at times, m."""
        return self.sign * self.track.road(self.start + times)

    def road_rate(self, times: Array) -> Array:
        """Return its rate, m/s."""
        return self.sign * self.track.road_rate(self.start + times)

    def present(self, times: Array) -> NDArray[np.bool_]:
        """Return whether the law finds anything at times."""
        return self.track.present(self.start + times)

    def inside(self, times: Array) -> NDArray[np.bool_]:
        """Return whether the point is on its body at times."""
        return self.track.inside(self.start + times)

    def jumps(self, end: float) -> Array:
        """Return the times until the end of the run at which its point steps onto the body, or off it, s."""
        return self.track.jumps(self.start, self.start + end) - self.start


@dataclass(frozen=True)
class Moving:
    """What coordinates of laws have beside ``b.q``: offsets ``g(t)`` as sums of functions of time, and what travels."""

    functions: tuple[TimeFunction, ...]
    weights: Array  #: Shape (n_laws, n_functions).
    riders: dict[int, Rider]  #: By the number of the law.

    def at(self, times: ArrayLike) -> Array:
        """Return the offsets at times, shape (n_laws, *times.shape)."""
        return self._sum([function(times) for function in self.functions], times)

    def rate(self, times: ArrayLike) -> Array:
        """Return the rates of the offsets at times, shape (n_laws, *times.shape)."""
        return self._sum([function.derivative(times) for function in self.functions], times)

    def _sum(self, values: list[Array], times: ArrayLike) -> Array:
        known = np.array(values).reshape(len(values), *np.shape(times))
        return np.asarray(np.tensordot(self.weights, known, 1))

    def added(self, q: Array, times: Array) -> Array:
        """Return what coordinates have beside the rows at rest, (n_laws, n_times), for q of shape (n, n_times).

        It is NaN where a law finds nothing.
        """
        found = self.at(times)
        for law, rider in self.riders.items():
            travels = np.asarray(rider.rows(times).multiply(q.T).sum(axis=1)).ravel() + rider.road(times)
            found[law] += np.where(rider.present(times), travels, np.nan)
        return found

    def added_rates(self, q: Array, v: Array, times: Array) -> Array:
        """Return what rates of coordinates have beside the rows at rest, (n_laws, n_times); 0 where nothing is."""
        found = self.rate(times)
        for law, rider in self.riders.items():
            own = rider.rows(times).multiply(v.T).sum(axis=1) + rider.rates(times).multiply(q.T).sum(axis=1)
            found[law] += np.where(rider.present(times), np.asarray(own).ravel() + rider.road_rate(times), 0.0)
        return found

    def shifted(self, start: float) -> Moving:
        """Return the same for a run that begins at a time in s."""
        riders = {law: replace(rider, start=rider.start + start) for law, rider in self.riders.items()}
        return replace(self, functions=tuple(Shifted(function, start) for function in self.functions), riders=riders)

    def ordered(self, order: NDArray[np.int64]) -> Moving:
        """Return the same for unknowns in another order."""
        riders = {law: replace(rider, body=rider.body[:, order].tocsr()) for law, rider in self.riders.items()}
        return replace(self, riders=riders)


def gathered(laws: Sequence[Any]) -> Moving | None:
    """Return what moves some laws, by their attributes `moving` and `rider`; None where nothing does."""
    parts = [law.moving for law in laws]
    riders = {k: law.rider for k, law in enumerate(laws) if law.rider is not None}
    functions = tuple(dict.fromkeys(function for part in parts for function, _ in part))
    if not functions and not riders:
        return None
    weights = np.zeros((len(parts), len(functions)))
    for row, part in zip(weights, parts, strict=True):
        for function, factor in part:
            row[functions.index(function)] += factor
    return Moving(functions, weights, riders)
