"""Following a curve of n equations in n + 1 unknowns until a function of them becomes positive."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.studies.steady.newton import direction

Array = NDArray[np.float64]

#: First, largest and least step, relative to the unknowns, and the largest number of steps along a curve.
_FIRST, _LARGEST, _LEAST, _MOST = 1e-4, 0.1, 1e-10, 1000

#: Steps of Newton's method at a point, and the residual that is small enough.
_STEPS, _TOLERANCE = 8, 1e-11

#: Cosine of the angle between successive directions below which a step is rejected.
_REFUSED = float(np.cos(np.radians(25.0)))


class LostCurveError(ConvergenceError):
    """Following a curve failed before the function became positive.

    Parameters
    ----------
    what : str
    farthest, last : ndarray, shape (n + 1,)
        The point at which the function was largest, and the last one.
    """

    def __init__(self, what: str, farthest: Array, last: Array) -> None:
        super().__init__(what)
        self.farthest, self.last = farthest, last


def until_positive(
    equations: Callable[[Array], tuple[Array, Array]], function: Callable[[Array], float], start: Array, towards: Array
) -> tuple[Array, Array]:
    """Return two neighbouring points of a curve between which a function becomes positive.

    Parameters
    ----------
    equations : callable
        Returns the residual of the equations at a point, shape (n,), and its derivative, shape (n, n + 1).
    function : callable
        Negative at the start.
    start : ndarray, shape (n + 1,)
        A point of the curve. The last unknown is compared with itself, the others with their common size.
    towards : ndarray, shape (n + 1,)
        Approximate direction in which the curve is followed.

    Returns
    -------
    before, after : ndarray, shape (n + 1,)

    Raises
    ------
    LostCurveError
        If the curve cannot be followed, or the function does not become positive within 1000 steps.
    """
    best = float(function(start))
    where = np.array(start)
    now, step = np.array(start), _FIRST
    tangent = towards / np.linalg.norm(towards / _scales(now)) / _scales(now)
    _, slopes = equations(now)
    tangent = _tangent(slopes, _scales(now), tangent)
    for _ in range(_MOST):
        scales = _scales(now)
        try:
            after, slopes = _corrected(equations, now + step * tangent * scales, scales, tangent)
            following = _tangent(slopes, _scales(after), tangent)
            if following @ tangent < _REFUSED:
                raise ConvergenceError("the curve turns too fast")
        except ConvergenceError as error:
            step *= 0.4
            if step < _LEAST:
                raise LostCurveError("the backbone is lost: it may graze a contact there", where, now) from error
            continue
        value = function(after)
        if value > 0.0:
            return now, after
        if value > best:
            best, where = value, after
        now, tangent, step = after, following, min(1.5 * step, _LARGEST)
    raise LostCurveError(f"it is not reached within {_MOST} steps", where, now)


def _scales(y: Array) -> Array:
    return np.append(np.full(y.size - 1, np.linalg.norm(y[:-1])), abs(y[-1]))


def _tangent(slopes: Array, scales: Array, towards: Array) -> Array:
    """Return the direction of the curve in scaled unknowns, of length 1, on the side of another one."""
    found = np.linalg.svd(slopes * scales)[2][-1]
    return np.asarray(found if found @ towards >= 0.0 else -found)


def _corrected(
    equations: Callable[[Array], tuple[Array, Array]], guess: Array, scales: Array, normal: Array
) -> tuple[Array, Array]:
    """Return the point of the curve on the plane through a guess, and the derivative there."""
    y, least = guess, np.inf
    for _ in range(_STEPS):
        if y[-1] <= 0.0 or not np.all(np.isfinite(y)):
            break
        residual, slopes = equations(y)
        error = float(np.max(np.abs(residual)))
        if error <= _TOLERANCE:
            return y, slopes
        if error > 10.0 * least:
            break
        least = min(least, error)
        matrix = np.concatenate([slopes * scales, normal[None, :]])
        y = y - direction(matrix, np.append(residual, normal @ ((y - guess) / scales))) * scales
    raise ConvergenceError("Newton's method does not converge")
