"""Complex modes of oscillators that a few dampers couple, in a time that grows with the square of their number.

The quadratic eigenproblem is ``(s^2 + s C + diag(p)) x = 0`` with ``C = diag(d) + R' diag(w) R``, where R has few rows.
A mode by itself has ``D_j(s) = s^2 + s d_j + p_j``. One mode j is set aside, that of the largest entry in the vector.
Then a root obeys the scalar equation

    D_j + s r_j' diag(w) nu = 0,    nu = (I + s G diag(w))^-1 r_j,    G = sum over i != j of r_i r_i' / D_i,

and its vector is ``x_j = 1, x_i = -s r_i' diag(w) nu / D_i``. Nothing is divided by the small ``D_j``, so that weakly
coupled modes keep their digits. All roots are improved at once by Newton's method with the terms of Ehrlich and Aberth,
which prevent two roots from converging to the same one.

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

#: Iterations after which a full eigenproblem is cheaper. If dampers are not much stronger than the distances of
#: frequencies, four to eight suffice.
_MOST_ITERATIONS = 15

#: Share of its size by which every start is moved off the real axis, as a pair of real roots may become complex.
_APART = 1e-6

#: Least coupling of a mode, over the largest one, in the choice of the mode that is set aside.
_UNCOUPLED = 1e-10

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
    """

    own: Array
    rows: Array
    weights: Array

    def part(self, motions: NDArray[np.int64]) -> CoupledDamping:
        """Return the damping of some of the motions."""
        return CoupledDamping(self.own[motions], self.rows[:, motions], self.weights)

    def matrix(self) -> Array:
        """Return the damping matrix, shape (n, n)."""
        return np.asarray(np.diag(self.own) + (self.rows.T * self.weights) @ self.rows)


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
        at = _equations(roots, p, damping)
        pull = (damping.rows.T @ (damping.weights * at.nu).T).T
        vectors = -roots[:, None] * pull * at.inverse
        vectors[np.arange(roots.size), at.mode] = 1.0
    return (roots, np.ascontiguousarray(vectors.T)) if np.all(np.isfinite(vectors)) else None


def _roots(p: Array, damping: CoupledDamping) -> Complex | None:
    """Return one of each pair of conjugate roots and the real ones, or None."""
    n = p.size
    own = damping.own + damping.weights @ damping.rows**2
    turn = np.sqrt((0.25 * own**2 - p).astype(complex))
    first = -0.5 * own - np.where(own < 0.0, -turn, turn)
    roots = np.concatenate([first, p / first]) * (1.0 + _APART * np.exp(1j * np.arange(2 * n)))
    moving = np.arange(2 * n)
    for _ in range(_MOST_ITERATIONS):
        s = roots[moving]
        at = _equations(s, p, damping)
        apart = s[:, None] - roots[None, :]
        apart[np.arange(moving.size), moving] = np.inf
        step = at.value / (at.slope + at.value * (at.others - np.sum(1.0 / apart, axis=1)))
        roots[moving] = s - step
        if not np.all(np.isfinite(roots)):
            return None
        moving = moving[np.abs(step) > 4.0 * _EPS * np.abs(s)]
        if not moving.size:
            break
    else:
        return None
    real = np.abs(roots.imag) <= _REAL * np.abs(roots)
    upper = ~real & (roots.imag > 0.0)
    if 2 * np.sum(upper) + np.sum(real) != 2 * n:
        return None
    return np.concatenate([roots[upper], roots[real].real])


def _equations(s: Complex, p: Array, damping: CoupledDamping) -> _Equations:
    """Return the scalar equations at some numbers s, shape (m,).

    Their values and slopes in s, and the logarithmic derivatives of the rest of the characteristic polynomial.
    """
    own, rows, weights = damping
    count, each = weights.size, np.arange(s.size)
    impedance = s[:, None] * (s[:, None] + own) + p
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
