"""Complex modes of oscillators that a few dampers couple, in a time that grows with the square of their number.

The quadratic eigenproblem is ``(s^2 + s C + diag(p)) x = 0`` with ``C = diag(d) + R' diag(w) R``, where R has few rows.
A mode by itself has ``D_j(s) = s^2 + s d_j + p_j``. One mode j is set aside, that of the largest entry in the vector.
Then a root obeys the scalar equation

    D_j + s r_j' diag(w) nu = 0,    nu = (I + s G diag(w))^-1 r_j,    G = sum over i != j of r_i r_i' / D_i,

and its vector is ``x_j = 1, x_i = -s r_i' diag(w) nu / D_i``. Nothing is divided by the small ``D_j``, so that weakly
coupled modes keep their digits. All roots are improved at once by Newton's method with the terms of Ehrlich and Aberth,
which prevent two roots from converging to the same one.

Under damping in proportion to the stiffness, ``d = a0 + a1 p``, modes of high frequency creep with a root near
``-1/a1``. These roots are close to each other, but their distances from ``-1/a1`` differ as much as the frequencies do.
Roots near it are therefore written as this distance, and ``D_j = s (s + a0) + p_j (1 + a1 s)`` is evaluated without
cancellation.

O. Aberth, Math. Comput. 27 (1973) 339, doi:10.2307/2005621; F. Tisseur, K. Meerbergen, SIAM Review 43 (2001) 235,
doi:10.1137/S0036144500381988.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_EPS = float(np.finfo(float).eps)

#: Iterations of all roots after which a full eigenproblem is cheaper. If dampers are not much stronger than the
#: distances of frequencies, four to eight suffice.
_MOST_ITERATIONS = 15

#: Step of a root over its offset, below which it is rounding if it no longer falls.
_STALLED = 1e-12

#: Share of its size by which every start is moved off the real axis, as a pair of real roots may become complex.
_APART = 1e-6

#: Least coupling of a mode, over the largest one, in the choice of the mode that is set aside.
_UNCOUPLED = 1e-10

#: Size of ``1 + a1 s`` below which a root is written as its distance from ``-1/a1``.
_NEAR = 0.5

#: Imaginary part over the root below which it is rounding.
_REAL = 256.0 * _EPS


class CoupledDamping(NamedTuple):
    """A damping matrix ``diag(own) + rows' diag(weights) rows``.

    Attributes
    ----------
    own : ndarray, shape (n,)
        Damping of every mode by itself, 1/s.
    rows : ndarray, shape (k, n)
    weights : ndarray, shape (k,)
        Weights of the coupling terms, 1/s, of either sign.
    proportional : (float, float), optional
        a0 in 1/s and a1 in s where ``own = a0 + a1 p`` of the squared frequencies p.
    """

    own: Array
    rows: Array
    weights: Array
    proportional: tuple[float, float] | None = None

    def part(self, motions: NDArray[np.int64]) -> CoupledDamping:
        """Return the damping of some of the motions."""
        return self._replace(own=self.own[motions], rows=self.rows[:, motions])

    def matrix(self) -> Array:
        """Return the damping matrix, shape (n, n)."""
        return np.asarray(np.diag(self.own) + (self.rows.T * self.weights) @ self.rows)


class _Roots(NamedTuple):
    """Some numbers s, each as a distance from zero or from ``-1/a1``, near which overdamped modes accumulate.

    Attributes
    ----------
    offset : ndarray of complex, shape (m,)
    near : ndarray of bool, shape (m,)
        Whether the offset is the distance from ``-1/a1``.
    a1 : float
        Damping in proportion to the stiffness, s; 0 where there is none.
    """

    offset: Complex
    near: NDArray[np.bool_]
    a1: float

    @property
    def s(self) -> Complex:
        """The numbers themselves."""
        return np.where(self.near, self.offset - 1.0 / self.a1, self.offset) if self.a1 else self.offset

    @property
    def lag(self) -> Complex:
        """``1 + a1 s``, without cancellation."""
        return np.where(self.near, self.a1 * self.offset, 1.0 + self.a1 * self.offset)

    def some(self, which: NDArray[np.int64]) -> _Roots:
        """Return some of the numbers."""
        return _Roots(self.offset[which], self.near[which], self.a1)

    def minus(self, others: _Roots) -> Complex:
        """Return the differences from other numbers, shape (m, number of others)."""
        apart = np.subtract.outer(self.offset, others.offset)
        if self.a1:
            apart -= np.subtract.outer(self.near.astype(float), others.near.astype(float)) / self.a1
        return apart


class _Equations(NamedTuple):
    """The scalar equations of some roots, shape (m,), and what their vectors are computed from."""

    mode: NDArray[np.int64]
    inverse: Complex
    nu: Complex
    value: Complex
    slope: Complex
    others: Complex


def coupled_modes(p: Array, damping: CoupledDamping) -> tuple[Complex, Complex] | None:
    """Return roots and vectors of ``(s^2 + s C + diag(p)) x = 0``, or None where the iteration does not find them all.

    Parameters
    ----------
    p : ndarray, shape (n,)
        Squared frequencies, positive, in 1/s^2.
    damping : CoupledDamping

    Returns
    -------
    roots : ndarray of complex, shape (m,)
        One of each pair of conjugate roots, that with the positive imaginary part; then all real ones.
    vectors : ndarray of complex, shape (n, m)
    """
    with np.errstate(all="ignore"):
        roots = _roots(p, damping)
        if roots is None:
            return None
        at, s = _equations(roots, p, damping), roots.s
        pull = (damping.rows.T @ (damping.weights * at.nu).T).T
        vectors = -s[:, None] * pull * at.inverse
        vectors[np.arange(s.size), at.mode] = 1.0
    return (s, np.ascontiguousarray(vectors.T)) if np.all(np.isfinite(vectors)) else None


def _first(p: Array, damping: CoupledDamping) -> _Roots:
    """Return the roots of all modes by themselves, two of each, shape (2n,)."""
    coupled = damping.weights @ damping.rows**2
    own = damping.own + coupled
    turn = np.sqrt((0.25 * own**2 - p).astype(complex))
    first = -0.5 * own - np.where(own < 0.0, -turn, turn)
    roots = np.concatenate([first, p / first])
    near = np.zeros(roots.size, dtype=bool)
    a0, a1 = damping.proportional or (0.0, 0.0)
    if a1:
        # The distance t from -1/a1 obeys t^2 + b t + c = 0.
        b, c = a1 * p + a0 + coupled - 2.0 / a1, (1.0 / a1 - a0 - coupled) / a1
        slow = np.flatnonzero((turn.imag == 0.0) & (b > 0.0) & (b**2 > 4.0 * c))
        distance = -2.0 * c[slow] / (b[slow] + np.sqrt(b[slow] ** 2 - 4.0 * c[slow]))
        taken = np.abs(a1 * distance) < _NEAR
        near[p.size + slow[taken]] = True
        roots[p.size + slow[taken]] = distance[taken]
    return _Roots(roots * (1.0 + _APART * np.exp(1j * np.arange(2 * p.size))), near, a1)


def _roots(p: Array, damping: CoupledDamping) -> _Roots | None:
    """Return one of each pair of conjugate roots and the real ones, or None."""
    n = p.size
    roots = _first(p, damping)
    moving, left = np.arange(2 * n), _MOST_ITERATIONS * 2 * n
    before = np.full(2 * n, np.inf)
    while moving.size:
        left -= moving.size
        if left < 0:
            return None
        here = roots.some(moving)
        at = _equations(here, p, damping)
        apart = here.minus(roots)
        apart[np.arange(moving.size), moving] = np.inf
        step = at.value / (at.slope + at.value * (at.others - np.sum(1.0 / apart, axis=1)))
        roots.offset[moving] = here.offset - step
        if not np.all(np.isfinite(roots.offset)):
            return None
        share = np.abs(step) / np.abs(here.offset)
        # Near critical damping rounding may keep a root moving. The caller compares rows and columns.
        going = (share > 4.0 * _EPS) & ((share > _STALLED) | (share < 0.25 * before[moving]))
        before[moving] = share
        moving = moving[going]
    real = np.abs(roots.offset.imag) <= _REAL * np.abs(roots.offset)
    upper = ~real & (roots.offset.imag > 0.0)
    if 2 * np.sum(upper) + np.sum(real) != 2 * n:
        return None
    roots.offset[real] = roots.offset[real].real
    return roots.some(np.concatenate([np.flatnonzero(upper), np.flatnonzero(real)]))


def _equations(roots: _Roots, p: Array, damping: CoupledDamping) -> _Equations:
    """Return the scalar equations at some numbers s, shape (m,).

    Their values and slopes in s, and the logarithmic derivatives of the rest of the characteristic polynomial.
    """
    own, rows, weights, proportional = damping
    s = roots.s
    if proportional is not None:
        impedance = (s * (s + proportional[0]))[:, None] + p * roots.lag[:, None]
    else:
        impedance = s[:, None] * (s[:, None] + own) + p
    count, each = weights.size, np.arange(s.size)
    # The largest entry of the vector: a mode that hardly couples is set aside for its own root alone.
    coupling = np.sqrt(np.abs(weights) @ rows**2)
    share = (coupling + _UNCOUPLED * coupling.max()) * (np.abs(s)[:, None] ** 2 + p)
    mode = np.argmax(share / np.abs(impedance), axis=1)
    here = impedance[each, mode]
    inverse = 1.0 / impedance
    inverse[each, mode] = 0.0
    change = inverse * (2.0 * s[:, None] + own)
    # The symmetric matrices G and their derivatives, of which each pair of rows is one column.
    first, second = np.triu_indices(count)
    pairs = (rows[first] * rows[second]).T
    place = np.empty((count, count), dtype=np.int64)
    place[first, second] = place[second, first] = np.arange(first.size)
    compliance, rate = _product(inverse, pairs)[:, place], -_product(inverse * change, pairs)[:, place]
    wide = s[:, None, None]
    solve = np.linalg.inv(np.eye(count) + wide * compliance * weights)
    turned = solve @ ((compliance + wide * rate) * weights)
    mine = rows[:, mode].T
    nu = (solve @ mine[:, :, None])[:, :, 0]
    damping = np.sum(mine * weights * nu, axis=1)
    damping_rate = -np.sum(mine * weights * (turned @ nu[:, :, None])[:, :, 0], axis=1)
    return _Equations(
        mode,
        inverse,
        nu,
        here + s * damping,
        2.0 * s + own[mode] + damping + s * damping_rate,
        np.sum(change, axis=1) + np.trace(turned, axis1=1, axis2=2),
    )


def _product(left: Complex, right: Array) -> Complex:
    """Return the product of a complex with a real matrix, as two real ones: numpy's own takes far longer."""
    return np.asarray(left.real @ right + 1j * (left.imag @ right))
