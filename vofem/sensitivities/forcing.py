"""The modal force of loads in a segment, and its derivatives: ``Re sum_k (c0 + c1 tau) exp(i w tau)``."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array, Complex
from vofem.parameters import changed
from vofem.time_functions import Piece, Shifted
from vofem.time_functions.base import Scaled, Sum


class Forcing(NamedTuple):
    """A function of time in closed form, ``Re sum_k (c0 + c1 tau) exp(i w tau)``: a number or a vector."""

    omega: Array  #: In rad/s; 0 for a straight line. Shape (k,).
    #: `level`, `growth`: factors c0 and c1 of each wave, shape (k,) or (k, n).
    level: Complex
    growth: Complex

    def at(self, tau: Array | float) -> Any:
        """Return the values at times, which come first in the shape."""
        tau = np.asarray(tau)
        turned = np.exp(1j * np.multiply.outer(tau, self.omega))
        return (turned @ self.level + (tau[..., None] * turned) @ self.growth).real

    def rate(self) -> Forcing:
        """Return the derivative by time."""
        turn = 1j * (self.omega if self.level.ndim == 1 else self.omega[:, None])
        return Forcing(self.omega, self.growth + turn * self.level, turn * self.growth)

    def times(self, matrix: Array) -> Forcing:
        """Return vectors times a matrix, or along a row."""
        return Forcing(self.omega, self.level @ matrix, self.growth @ matrix)

    def plus(self, other: Forcing) -> Forcing:
        """Return the sum with another function of time."""
        return Forcing(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def waves_of(piece: Piece) -> Forcing:
    """Return a piece of a function of time as waves."""
    omega = [0.0, *(w for w, _ in piece.harmonics)]
    level = [complex(piece.constant), *(a for _, a in piece.harmonics)]
    growth = [complex(piece.slope), *(0j for _ in piece.harmonics)]
    return Forcing(np.array(omega), np.array(level), np.array(growth))


def derivative_waves(function: Any, path: tuple[str, ...], t: float) -> Forcing:
    """Return the derivative of a function of time by one of its numbers, as it holds from time t in s on."""
    if isinstance(function, Shifted):
        return derivative_waves(function.function, path, function.start + t)
    if isinstance(function, Sum):
        return derivative_waves(function.terms[int(path[1])], path[2:], t)
    if isinstance(function, Scaled) and len(path) > 1:
        inner = derivative_waves(function.function, path[1:], t)
        return Forcing(inner.omega, function.factor * inner.level, function.factor * inner.growth)
    if path[0] not in ("omega", "phase"):
        # The function is proportional to all other numbers.
        return waves_of(changed(function, **{path[0]: 1.0}).piece(t))
    # The derivative by the phase; that by the frequency grows with time.
    turned = waves_of(changed(function, phase=function.phase + 0.5 * np.pi).piece(t))
    if path == ("phase",):
        return turned
    return Forcing(turned.omega, t * turned.level, turned.level)


def forcing_of(waves: list[Forcing], vectors: list[Array], constant: Array) -> Forcing:
    """Return the sum of functions of time times vectors, and of a constant force; equal frequencies are one."""
    known: dict[float, list[Complex]] = {0.0: [constant.astype(complex), np.zeros(constant.size, dtype=complex)]}
    for wave, vector in zip(waves, vectors, strict=True):
        for w, level, growth in zip(wave.omega.tolist(), wave.level, wave.growth, strict=True):
            parts = known.setdefault(w, [np.zeros(vector.size, dtype=complex), np.zeros(vector.size, dtype=complex)])
            parts[0] = parts[0] + level * vector
            parts[1] = parts[1] + growth * vector
    values = list(known.values())
    return Forcing(np.array(list(known)), np.array([a for a, _ in values]), np.array([b for _, b in values]))
