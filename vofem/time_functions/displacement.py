"""Displacements of bases, whose accelerations are functions of time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.time_functions.base import TimeFunction, order_of
from vofem.time_functions.piece import Piece


@dataclass(frozen=True)
class Displacement(TimeFunction):
    """A displacement in m, of which the acceleration and the values at t = 0 are known.

    Where the acceleration is a line, as between two times of a table, the displacement is a cubic of time; where it is
    a sine, so is the displacement, beside a line.

    Attributes
    ----------
    acceleration : TimeFunction
        In m/s^2, of closed form.
    displacement, velocity : float
        At t = 0, in m and m/s.
    """

    acceleration: TimeFunction
    displacement: float
    velocity: float
    _known: list[tuple[float, Array, Array]] = field(default_factory=list, init=False, compare=False, repr=False)

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether the acceleration has a closed form."""
        return self.acceleration.closed_form

    def _straight(self, t0: Array) -> Array | None:
        """Return value and slope of the acceleration from times on, (2, n); None where it is not straight."""
        known = self.acceleration.polynomials(t0)
        return None if known is None or np.any(known[2:]) else known[:2]

    def _states(self, until: float) -> tuple[Array, Array]:
        """Return times at which pieces begin, (k,), and displacement and velocity there, (2, k), up to a time in s."""
        if not self._known or self._known[0][0] < until:
            end = max(2.0 * until, 1.0)
            edges = np.concatenate([[0.0], self.acceleration.breakpoints(end)])
            straight = self._straight(edges)
            if straight is not None:
                h, (c, s) = np.diff(edges), straight[:, :-1]
                velocity = self.velocity + np.concatenate([[0.0], np.cumsum(h * (c + h * s / 2.0))])
                way = h * (velocity[:-1] + h * (c / 2.0 + h * s / 6.0))
                states = np.stack([self.displacement + np.concatenate([[0.0], np.cumsum(way)]), velocity])
            else:
                states = np.empty((2, edges.size))
                states[:, 0] = self.displacement, self.velocity
                for k, h in enumerate(np.diff(edges).tolist()):
                    states[:, k + 1] = _at(_twice(self.acceleration.piece(float(edges[k])), *states[:, k]), np.array(h))
            self._known[:] = [(end, edges, states)]
        return self._known[0][1:]

    def _values(self, t: ArrayLike) -> Array:
        """Return displacement and velocity at times t, shape (2, *t.shape)."""
        times = np.asarray(t, dtype=float)
        flat = times.ravel()
        edges, states = self._states(float(np.max(flat, initial=0.0)))
        place = np.clip(np.searchsorted(edges, flat, side="right") - 1, 0, None)
        late, (d, v), result = flat - edges[place], states[:, place], np.empty((2, flat.size))
        straight = self._straight(edges[place])
        if straight is not None:
            c, s = straight
            result[0] = d + late * (v + late * (c / 2.0 + late * s / 6.0))
            result[1] = v + late * (c + late * s / 2.0)
        else:
            for k in np.unique(place).tolist():
                mine = place == k
                result[:, mine] = _at(_twice(self.acceleration.piece(float(edges[k])), *states[:, k]), late[mine])
        return result.reshape(2, *times.shape)

    def __call__(self, t: ArrayLike) -> Array:
        """Return the displacements at times t, m."""
        return np.asarray(self._values(t)[0])

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return displacement, velocity, acceleration, and so on, by order."""
        if order_of(order) < 2:
            return np.asarray(self._values(t)[order])
        return self.acceleration.derivative(t, order - 2)

    def breakpoints(self, t_end: float) -> Array:
        """Return the breakpoints of the acceleration."""
        return self.acceleration.breakpoints(t_end)

    def shortest(self, t_end: float) -> float:
        """Return the time of the acceleration."""
        return self.acceleration.shortest(t_end)

    def piece(self, t0: float) -> Piece:
        """Return the piece of the acceleration, integrated twice."""
        return _twice(self.acceleration.piece(t0), *self._values(t0).tolist())


def _twice(piece: Piece, value: float, rate: float) -> Piece:
    """Return the second integral of a piece whose polynomial has degree 1, with value and rate at t0."""
    constant = value + sum(a.real / w**2 for w, a in piece.harmonics)
    slope = rate - sum(a.imag / w for w, a in piece.harmonics)
    waves = tuple((w, -a / w**2) for w, a in piece.harmonics)
    return Piece(waves, constant, slope, piece.constant, piece.slope)


def _at(piece: Piece, tau: Array) -> Array:
    """Return value and rate of a piece at times tau from its start, shape (2, *tau.shape)."""
    value = piece.constant + tau * (piece.slope + tau * (piece.curvature / 2.0 + tau * piece.jerk / 6.0))
    rate = piece.slope + tau * (piece.curvature + tau * piece.jerk / 2.0)
    for w, a in piece.harmonics:
        wave = a * np.exp(1j * w * tau)
        value, rate = value + wave.real, rate - w * wave.imag
    return np.stack([value, rate])
