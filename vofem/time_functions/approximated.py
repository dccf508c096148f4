"""Any callable of time, approximated by closed forms within a stated tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import number, series, whole
from vofem.arrays import Array
from vofem.errors import ArgumentError, ConvergenceError
from vofem.time_functions.base import TimeFunction, as_time_function, order_of
from vofem.time_functions.moments import straight, wave
from vofem.time_functions.piece import Piece

#: Phase that the slower harmonic of a piece covers, rad: a small one makes the fit lose digits, a large one makes it
#: of second order in the length of the piece from some accuracy on.
_PHASE = 0.2

#: Where a piece takes and checks its values, as fractions of its length.
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(6) / 5)
_CHECKS = np.array([0.03, 0.17, 0.41, 0.62, 0.79, 0.96])

#: The largest error of a piece over that at the points of check.
_SAFETY = 2.0

#: Parts into which the time is cut before any look at the function.
_FIRST = 16

#: Equally spaced times at which the function is evaluated beside those of the pieces.
_SAMPLES = 8192


def _basis(tau: Array, length: Any) -> Array:
    """Return 1, tau/h, and cos, sin of one and of two harmonics of a piece of length h, shape (..., 6)."""
    x = tau / length
    angle = _PHASE * x
    return np.stack(
        [np.ones_like(x), x, np.cos(angle), np.sin(angle), np.cos(2.0 * angle), np.sin(2.0 * angle)], axis=-1
    )


_TAKE = _basis(_NODES, 1.0)
_CHECK = _basis(_CHECKS, 1.0)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Approximated(TimeFunction):
    """A callable of time, approximated by closed forms on pieces, within a tolerance on [0, t_end].

    A piece is ``c0 + c1 tau`` plus two slow harmonics, which can be integrated in
    closed form. It interpolates the function at six points, among them its ends.
    A piece is halved until it agrees with the function at six other points within
    the tolerance. This is an estimate of the error and not a bound. Jumps are
    located to the resolution of time and become breakpoints. The function is also
    evaluated at 8192 equally spaced times. A feature that is narrower than their
    distance may be missed, and the notes of a run say so; name its edges in
    `breaks` to resolve it.

    Parameters
    ----------
    function : callable of t
        Takes one time in s and returns a finite number in the unit of the load.
    t_end : float
        End of the approximation in s. A longer run is refused.
    tolerance : float
        Largest error, relative to the largest magnitude of the function.
    absolute : float
        Absolute error in the unit of the load that is allowed in addition.
    breaks : array_like, shape (k,)
        Times in s of known corners, jumps and short features. They save pieces.
    max_pieces : int
        Largest number of pieces.

    Attributes
    ----------
    name : str
        Name of the callable, which itself is not kept.
    error : float
        Estimate of the largest error, in the unit of the load.
    starts : ndarray, shape (n,)
        Times in s at which the pieces begin.
    lengths : ndarray, shape (n,)
        Durations of the pieces in s.
    coefficients : ndarray, shape (n, 6)
        Coefficients of 1, of tau/length, and of cosine and sine of the first and the second harmonic.

    Raises
    ------
    LoadError
        If the function raises, or returns something that is not a finite number; the message says when.
    ConvergenceError
        If the tolerance is not reached with `max_pieces` pieces.

    Examples
    --------
    >>> import math
    >>> import vofem as vf
    >>> gust = vf.Approximated(lambda t: math.exp(-((t - 3.0) ** 2)), t_end=10.0, tolerance=1e-9)
    >>> load = vf.PointLoad(vf.Mass(1.0, stiffness=1.0), gust)
    """

    written_out = False

    name: str
    t_end: float
    tolerance: float
    absolute: float
    error: float
    starts: Array
    lengths: Array
    coefficients: Array

    def __init__(
        self,
        function: Any,
        t_end: float,
        tolerance: float,
        *,
        absolute: float = 0.0,
        breaks: ArrayLike = (),
        max_pieces: int = 20_000,
    ) -> None:
        if not callable(function):
            raise ArgumentError(f"Approximated: function is {function!r}, expected a callable of t")
        original = as_time_function(function)
        self._set("name", repr(original))
        self._set("t_end", number("Approximated: t_end", t_end, positive=True))
        self._set("tolerance", number("Approximated: tolerance", tolerance, positive=True))
        self._set("absolute", number("Approximated: absolute", absolute, minimum=0))
        if self.tolerance < 1e-13:
            raise ArgumentError(
                f"Approximated: tolerance is {self.tolerance:g}, expected 1e-13 or more: below is rounding"
            )
        max_pieces = whole("Approximated: max_pieces", max_pieces)
        known = series("Approximated: breaks", breaks) if np.size(breaks) else np.empty(0)
        starts, coefficients, error = self._cover(original, known, int(max_pieces))
        self._set("starts", starts)
        self._set("lengths", np.diff(np.append(starts, self.t_end)))
        self._set("coefficients", coefficients)
        self._set("error", error)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"Approximated({self.name}, {self.starts.size} pieces, error {self.error:.2g})"

    def _cover(self, function: TimeFunction, known: Array, most: int) -> tuple[Array, Array, float]:
        """Return the starts of the pieces, their coefficients (n, 6) and the largest error found."""
        grid = self.t_end * np.arange(_FIRST + 1) / _FIRST
        edges = np.unique(np.concatenate([grid, known[(known > 0.0) & (known < self.t_end)]]))
        waiting = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
        resolution = 4.0 * float(np.spacing(self.t_end))
        times = self.t_end * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        samples = times, function(times)
        fits = [_fit(function, *piece, *samples) for piece in waiting]
        largest = max(fit[2] for fit in fits)
        done: list[tuple[float, Array, float]] = []
        stack = list(zip(waiting, fits, strict=True))
        while stack:
            (left, right), (coefficients, error, size) = stack.pop()
            largest = max(largest, size)
            if error <= self.absolute + self.tolerance * largest:
                done.append((left, coefficients, error))
                continue
            if right - left <= resolution:
                # A jump, narrowed down to the resolution of time.
                done.append((left, np.array([float(function(left)), 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0))
                continue
            if len(done) + len(stack) + 2 > most:
                raise ConvergenceError(
                    f"Approximated: {self.name} needs more than max_pieces = {most} pieces to reach the "
                    f"tolerance {self.tolerance:g} on [0, {self.t_end:g}] s; "
                    f"near t = {left:g} s the error is {error:.2g}. "
                    "Noise and jumps are the usual causes: name corners and jumps by breaks, or raise tolerance"
                )
            middle = 0.5 * (left + right)
            for part in ((left, middle), (middle, right)):
                stack.append((part, _fit(function, *part, *samples)))
        done.sort(key=lambda piece: piece[0])
        starts, rows, errors = zip(*done, strict=True)
        return np.array(starts), np.array(rows), max(errors)

    def _locate(self, t: ArrayLike) -> tuple[NDArray[np.int64], Array]:
        times = np.asarray(t, dtype=float)
        if np.any(times < 0.0) or np.any(times > self.t_end * (1.0 + 1e-12)):
            worst = float(times.min() if np.any(times < 0.0) else times.max())
            raise ArgumentError(
                f"{self!r} was asked for t = {worst:g} s, but ends at {self.t_end:g} s; build it with a larger t_end"
            )
        index = np.maximum(np.searchsorted(self.starts, times, side="right") - 1, 0)
        return index, times - self.starts[index]

    def __call__(self, t: ArrayLike) -> Array:
        """Return the approximate values at times t in [0, t_end]."""
        return self.derivative(t, 0)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the exact derivative of the approximation; it loses an order of accuracy each time."""
        order = order_of(order)
        index, tau = self._locate(t)
        c, length = self.coefficients[index], self.lengths[index]
        result = c[..., 0] + c[..., 1] * tau / length if order == 0 else np.zeros(np.shape(tau))
        if order == 1:
            result = result + c[..., 1] / length
        for k in (1, 2):
            w = k * _PHASE / length
            amplitude = (c[..., 2 * k] - 1j * c[..., 2 * k + 1]) * (1j * w) ** order
            result = result + (amplitude * np.exp(1j * w * tau)).real
        return np.asarray(result)

    def breakpoints(self, t_end: float) -> Array:
        """Return the starts of the pieces in (0, t_end)."""
        if t_end > self.t_end * (1.0 + 1e-12):
            raise ArgumentError(f"{self!r} ends at {self.t_end:g} s, before {t_end:g} s; build it with a larger t_end")
        return self.starts[(self.starts > 0.0) & (self.starts < t_end)]

    @property
    def sample_spacing(self) -> float:
        """Distance in s of the times at which the callable was evaluated."""
        return self.t_end / _SAMPLES

    def shortest(self, t_end: float) -> float:
        """Return a few times the shortest piece; jumps, which are narrowed down, do not count."""
        lengths = self.lengths[self.lengths > 1e-6 * self.t_end]
        return float(4.0 * np.min(lengths)) if lengths.size else np.inf

    def corners(self, left: float, right: float) -> Array:
        """Return the starts of the pieces in (left, right)."""
        first = np.searchsorted(self.starts, left, side="right")
        return self.starts[first : np.searchsorted(self.starts, right, side="left")]

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments of parts of pieces, in closed form."""
        index, tau = self._locate(0.5 * (left + right))
        c, length, h = self.coefficients[index], self.lengths[index], right - left
        moments = straight(c[:, 0] + c[:, 1] * tau / length, c[:, 1] / length, h)
        for k in (1, 2):
            w = k * _PHASE / length
            amplitude = (c[:, 2 * k] - 1j * c[:, 2 * k + 1]) * np.exp(1j * w * tau)
            m0, m1, m2 = wave(0.5 * w * h)
            moments += np.stack([m0 * amplitude.real, -m1 * amplitude.imag, m2 * amplitude.real])
        return moments

    def piece(self, t0: float) -> Piece:
        """Return the closed form that holds from t0 to the next breakpoint."""
        index, tau = self._locate(t0)
        c, length, shift = self.coefficients[index], float(self.lengths[index]), float(tau)
        harmonics = []
        for k in (1, 2):
            w = k * _PHASE / length
            harmonics.append((w, complex(c[2 * k], -c[2 * k + 1]) * complex(np.exp(1j * w * shift))))
        return Piece(tuple(harmonics), float(c[0] + c[1] * shift / length), float(c[1] / length))


def _fit(function: TimeFunction, left: float, right: float, times: Array, given: Array) -> tuple[Array, float, float]:
    """Return coefficients, error at the points of check and size of the values on one piece.

    The values `given` at those of the `times` that lie on the piece are compared too.
    """
    # The value at the right end is that before a jump there.
    inside = np.minimum(left + (right - left) * _NODES, np.nextafter(right, left))
    values, checks = function(inside), function(left + (right - left) * _CHECKS)
    coefficients = np.asarray(np.linalg.solve(_TAKE, values), dtype=float)
    error = _SAFETY * float(np.max(np.abs(_CHECK @ coefficients - checks)))
    size = float(max(np.max(np.abs(values)), np.max(np.abs(checks))))
    part = slice(np.searchsorted(times, left), np.searchsorted(times, right))
    if part.stop > part.start:
        off = _basis((times[part] - left) / (right - left), 1.0) @ coefficients - given[part]
        error, size = max(error, float(np.max(np.abs(off)))), max(size, float(np.max(np.abs(given[part]))))
    return coefficients, error, size
