"""Loads that travel along a beam, as functions of time on its degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from vofem.bodies.base import Array
from vofem.bodies.path import TravellingPoint
from vofem.time_functions import Constant, Piece, Pulse, TimeFunction, parts_of
from vofem.time_functions.moments import sampled

#: Samples in the shortest time of a load.
_FINE = 0.2


class TravellingLoad(TimeFunction):
    """The share of loads that travel along one beam in the force on one of its degrees of freedom.

    The shape functions of an element are cubics of x, so at constant speed the share of a constant force is a cubic of
    time between two nodes.

    `dof`: number of the degree of freedom among those of the beam.
    `riders`: the places of the loads, and their forces in N.
    """

    written_out = False
    travels = True
    obstacle = "it travels with an acceleration, or with a force that varies other than by pulses"

    def __init__(self, dof: int, riders: Sequence[tuple[TravellingPoint, TimeFunction]]) -> None:
        self.dof, self.riders = dof, tuple(riders)

    def __repr__(self) -> str:
        return f"{len(self.riders)} travelling loads"

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether all speeds are constant, and all forces constant or pulses."""
        return all(
            point.path.acceleration == 0.0 and all(isinstance(part, (Constant, Pulse)) for part in parts_of(force))
            for point, force in self.riders
        )

    def _weights(self, point: TravellingPoint, t: Array, derivative: int) -> Array:
        """Return the weights of the degree of freedom at times t, shape (k,)."""
        dofs, weights = point.cubics(t, derivative, ahead=True)
        return np.asarray(np.sum(np.where(dofs == self.dof, weights, 0.0), axis=1))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        times = np.asarray(t, dtype=float)
        flat = times.ravel()
        total = np.zeros(flat.size)
        for point, force in self.riders:
            weights = self._weights(point, flat, 0)
            mine = np.flatnonzero(weights)
            if mine.size:
                total[mine] += force(flat[mine]) * weights[mine]
        return total.reshape(times.shape)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return a derivative of the polynomials."""
        times = np.asarray(t, dtype=float)
        known = self.polynomials(times.ravel())
        return known[order].reshape(times.shape) if order < 4 else np.zeros(times.shape)

    def polynomials(self, t0: Array) -> Array:
        """Return value and derivatives of the cubics from many times on, shape (4, k)."""
        found = np.zeros((4, t0.size))
        for point, force in self.riders:
            values = force(t0)
            for order, row in enumerate(found):
                row += values * point.path.speed**order * self._weights(point, t0, order)
        return found

    def piece(self, t0: float) -> Piece:
        """Return the cubic that holds from t0 on."""
        return Piece((), *self.polynomials(np.array([t0]))[:, 0].tolist())

    def breakpoints(self, t_end: float) -> Array:
        """Return the times at which a load appears, passes a node, or its force changes its course."""
        known = [point.crossings(t_end) for point, _ in self.riders]
        return np.unique(np.concatenate([*known, *(force.breakpoints(t_end) for _, force in self.riders)]))

    def shortest(self, t_end: float) -> float:
        """Return the shortest time in which a load passes an element, or its force changes."""
        found = []
        for point, force in self.riders:
            fastest = float(
                np.max(np.abs(point.path.velocity(np.array([point.path.begin, max(t_end, point.path.begin)]))))
            )
            passed = float(point.body.element_lengths.min()) / fastest if fastest > 0.0 else np.inf
            found += [passed, force.shortest(t_end)]
        return min(found)

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments by quadrature that is exact for constant forces."""
        if not left.size:
            return np.empty((3, 0))
        changes = min(force.shortest(float(np.max(right))) for _, force in self.riders)
        return sampled(self, left, right, min(width, _FINE * changes))
