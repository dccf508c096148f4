"""The number of multipliers outside the unit circle, and functions that are zero when one crosses it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Complex
from vofem.errors import ConvergenceError
from vofem.studies.steady.following.point import Point

#: A function of an orbit whose value changes its sign at a special point.
Test = Callable[[Point], float]

#: Imaginary part of a multiplier, over its modulus, up to which it counts as real.
_REAL = 1e-12

#: Distance of a complex pair from the unit circle that is rounding: without damping all pairs lie on the circle.
ON_CIRCLE = 1e-8

#: Distance from 1 below which the product of two multipliers counts as 1.
_RECIPROCAL = 1e-12

#: Modulus of a multiplier below which it counts as far inside of the unit circle, wherever it is, and the largest one.
_FADED, _VAST = 0.05, 1e300


class Census(NamedTuple):
    """Numbers of multipliers outside the unit circle."""

    plus: int  #: Number of real multipliers above 1.
    minus: int  #: Number of real multipliers below -1.
    pairs: int  #: Number of pairs of complex multipliers.


def multipliers(point: Point) -> Complex:
    """Return the multipliers of a point; raise `ConvergenceError` where they are not known."""
    values = point.evaluation.multipliers
    if values is None:
        raise ConvergenceError("the multipliers of an orbit are not known")
    return np.asarray(values)


def _real(values: Complex) -> NDArray[np.bool_]:
    return np.abs(values.imag) <= _REAL * np.maximum(np.abs(values), 1e-300)


def _beyond(values: Complex) -> NDArray[np.bool_]:
    return np.abs(values) > np.where(_real(values), 1.0, 1.0 + ON_CIRCLE)


def census(point: Point) -> Census | None:
    """Return the numbers of multipliers beyond the unit circle, or None where multipliers are not known."""
    if point.evaluation.multipliers is None:
        return None
    return counts_of(multipliers(point))


def counts_of(values: Complex) -> Census:
    """Return the numbers of multipliers beyond the unit circle."""
    real = _real(values)
    pairs = int(np.sum(~real & _beyond(values))) // 2
    return Census(int(np.sum(real & (values.real > 1.0))), int(np.sum(real & (values.real < -1.0))), pairs)


def logarithms(point: Point) -> Complex:
    """Return the logarithms of the multipliers; their real parts vanish on the unit circle, and are bounded.

    There are none where multipliers are not known.
    """
    values = point.evaluation.multipliers
    if values is None:
        return np.zeros(0, dtype=complex)
    sizes = np.abs(values)
    return np.where(sizes > _FADED, np.log(np.clip(sizes, _FADED, _VAST)) + 1j * np.angle(values), np.log(_FADED))


def matched(these: Complex, others: Complex) -> Complex:
    """Return other logarithms in the order in which they are nearest to these, with the nearest of their angles."""
    from scipy.optimize import linear_sum_assignment

    apart = others - these[:, None]
    apart.imag -= 2.0 * np.pi * np.round(apart.imag / (2.0 * np.pi))
    rows, columns = linear_sum_assignment(np.abs(apart))
    return np.asarray(these + apart[rows, columns])


def critical(values: Complex, kind: str) -> list[int]:
    """Return the numbers of the multipliers that are on the unit circle at a special point: one, or a pair."""
    if kind != "neimark_sacker":
        return [int(np.argmin(np.abs(values - (-1.0 if kind == "period_doubling" else 1.0))))]
    away = np.where(_real(values), np.inf, np.abs(np.abs(values) - 1.0))
    first = int(np.argmin(away))
    return [first, int(np.argmin(np.abs(values - values[first].conj())))]


def orientation(point: Point) -> float:
    """Return the sign of the determinant of the Jacobian matrix; it changes where one real multiplier passes 1."""
    return float(np.linalg.slogdet(point.evaluation.jacobian)[0])


def turning(point: Point) -> float:
    """Return the rate at which the parameter changes along the branch; it vanishes where the branch turns."""
    return float(point.tangent[-1])


def real_at(at: float) -> Test:
    """Return the test of a real multiplier at 1 or -1: a product over all multipliers, large ones scaled down."""

    def test(point: Point) -> float:
        values = multipliers(point)
        # Beside grazings they may be infinite, and the test is not decided.
        with np.errstate(invalid="ignore"):
            factors = (1.0 - at * values) / np.hypot(1.0, np.abs(values))
        return float(np.prod(factors).real)

    return test


def pair(point: Point) -> float:
    """Return how far the complex pair that is nearest to the unit circle lies outside of it."""
    values = multipliers(point)
    size = np.abs(values[~_real(values)])
    if not size.size:
        raise ConvergenceError("the pair has become real")
    return float(size[np.argmin(np.abs(size - 1.0))] - 1.0)


def pair_on_circle(point: Point, within: float = ON_CIRCLE) -> bool:
    """Return whether a complex pair lies on the unit circle, as most do without damping; `pair` is then rounding."""
    values = multipliers(point)
    return bool(np.min(np.abs(np.abs(values[~_real(values)]) - 1.0), initial=1.0) <= within)


def collision(point: Point) -> float:
    """Return the test of two pairs that meet on the unit circle and leave it, as without damping.

    With z = a + 1/a of a multiplier a, all z of such pairs are real, and two that meet become complex. Their squared
    difference changes its sign.
    """
    values = multipliers(point)
    upper = values[~_real(values) & (values.imag > 0.0)]
    z = upper + 1.0 / upper
    squares = np.square(np.subtract.outer(z, z)[np.triu_indices(z.size, 1)]).real
    if not squares.size:
        raise ConvergenceError("the pair has become real")
    return float(squares.min())


def pairs_at_one(reference: Point) -> Test:
    """Return the test of a complex pair on the unit circle: the product of all ``1 - a b`` of two multipliers a, b.

    It is as smooth as the monodromy matrix, also where a pair becomes real. It vanishes as well where a real multiplier
    is the reciprocal of another one, which is no special point. Values are divided by that at a reference. They are NaN
    where they would be rounding, as in conservative scenes.
    """

    def size(point: Point) -> tuple[float, float]:
        values = multipliers(point)
        with np.errstate(invalid="ignore"):
            products = np.multiply.outer(values, values)[np.triu_indices(values.size, 1)]
            factors = (1.0 - products) / np.hypot(1.0, np.abs(products))
        away = np.abs(factors)
        if not np.min(away, initial=1.0) > _RECIPROCAL:
            return np.nan, 0.0
        return float(np.sign(np.prod(factors / away).real)), float(np.sum(np.log(away)))

    scale = size(reference)[1]

    def test(point: Point) -> float:
        sign, logarithm = size(point)
        return float(sign * np.exp(min(logarithm - scale, 600.0)))

    return test


def determinant(reference: Point) -> Test:
    """Return the test of a multiplier at 1 where multipliers are not known: the determinant of the Jacobian matrix."""
    scale = float(np.linalg.slogdet(reference.evaluation.jacobian)[1])

    def test(point: Point) -> float:
        sign, size = np.linalg.slogdet(point.evaluation.jacobian)
        return float(sign * np.exp(min(size - scale, 600.0)))

    return test


def counted(which: int, middle: float) -> Test:
    """Return the test of one of several multipliers that pass the unit circle close to each other, or at one place.

    Its sign says whether more multipliers than a given number lie outside the circle. Its size is the distance of the
    nearest one from the circle.

    `which`: entry of `Census`.
    `middle`: the given number, which lies between two whole numbers.
    """

    def test(point: Point) -> float:
        values, known = multipliers(point), census(point)
        assert known is not None
        size = np.abs(values)
        away = np.abs(size[~_real(values)] - 1.0) if which == 2 else np.abs(1.0 - (1.0, -1.0)[which] * values)
        return float(np.copysign(np.min(away, initial=1.0), known[which] - middle))

    return test
