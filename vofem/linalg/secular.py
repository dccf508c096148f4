"""Eigensystem of a diagonal matrix plus a rank-one term, to high relative accuracy.

Between neighbouring poles the secular equation ``1 + rho sum c_j^2/(d_j - x) = 0``
has one root. The root is computed as an offset from its nearest pole, so that no
differences of nearly equal numbers occur. The iteration uses a rational function
with two poles, inside a bracket. The vectors come from Loewner's formula, which
makes them orthogonal to working precision.

M. Gu, S. C. Eisenstat, SIAM J. Matrix Anal. Appl. 15 (1994) 1266, doi:10.1137/S089547989223924X;
R.-C. Li, LAPACK Working Note 89 (1993).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_EPS = float(np.finfo(float).eps)

#: Of `refine`: relative distance below which eigenvalues count as close, coupling of two of them below which it is
#: rounding, and change of the vectors above which the guesses are too far off.
_CLOSE, _JOINED, _FAR = 1e-3, 1e-14, 1e-2


@jit
def _root(d: Array, w: Array, k: int, one: float) -> tuple[int, float]:
    """Return (pole, offset) of the k-th root of ``one + sum w_j/(d_j - x)``, all w_j > 0, d ascending.

    `one` is 1 for a spring and 0 for a constraint, the limit of a rigid spring, which has one root less.
    """
    m = d.size
    last = k == m - 1
    if last:
        pole = k
        low, high = 0.0, 0.0
        for j in range(m):
            high += w[j]
        x = 0.5 * high
    else:
        half = 0.5 * (d[k + 1] - d[k])
        f = one
        for j in range(m):
            f += w[j] / ((d[j] - d[k]) - half)
        if f >= 0.0:
            pole, low, high = k, 0.0, half
        else:
            pole, low, high = k + 1, -half, 0.0
        x = 0.5 * (low + high)
    for _ in range(200):
        psi, dpsi, phi, dphi = 0.0, 0.0, 0.0, 0.0
        for j in range(m):
            gap = (d[j] - d[pole]) - x
            t = w[j] / gap
            if j <= k:
                psi += t
                dpsi += t / gap
            else:
                phi += t
                dphi += t / gap
        f = one + psi + phi
        if abs(f) <= _EPS * (one + abs(psi) + abs(phi)):
            return pole, x
        if f < 0.0:
            low = x
        else:
            high = x
        if high - low <= 2.0 * _EPS * max(abs(low), abs(high)):
            return pole, x
        here = (d[k] - d[pole]) - x
        r, s = psi - dpsi * here, dpsi * here * here
        new = np.nan
        if last:
            if one + r > 0.0:
                new = (d[k] - d[pole]) + s / (one + r)
        else:
            there = (d[k + 1] - d[pole]) - x
            a = one + r + phi - dphi * there
            big = dphi * there * there
            b = a * (here + there) + s + big
            c = here * there * f
            disc = b * b - 4.0 * a * c
            if disc >= 0.0:
                q = b + np.sqrt(disc) if b > 0.0 else b - np.sqrt(disc)
                if q != 0.0:
                    new = x + 2.0 * c / q
                    if not low < new < high and a != 0.0:
                        new = x + q / (2.0 * a)
        if not low < new < high:
            if low * high > 0.0:
                new = np.sign(low) * np.sqrt(low * high)
            elif low == 0.0:
                new = 0.01 * high
            else:
                new = 0.01 * low
            if not low < new < high:
                new = 0.5 * (low + high)
        if new == x:
            return pole, x
        x = float(new)
    return pole, x


@jit
def _rotate(d: Array, c: Array, vectors: Array, active: NDArray[np.bool_]) -> bool:
    """Rotate coinciding poles so that one of them takes all of the coupling.

    The poles that are coupled are marked as `active`. Returns whether `vectors` is the identity still.
    """
    norm = 0.0
    for i in range(d.size):
        norm += c[i] * c[i]
    norm = np.sqrt(norm)
    previous = -1
    plain = True
    for i in range(d.size):
        # A rigid motion whose coupling is only rounding stays a rigid motion.
        active[i] = abs(c[i]) > (1e-14 if d[i] == 0.0 else 1e-18) * norm
        if not active[i]:
            continue
        if previous >= 0 and d[i] - d[previous] <= 4.0 * _EPS * max(abs(d[i]), abs(d[previous])):
            r = np.hypot(c[previous], c[i])
            cs, sn = c[i] / r, c[previous] / r
            for row in range(d.size):
                x, y = vectors[row, previous], vectors[row, i]
                vectors[row, previous] = cs * x - sn * y
                vectors[row, i] = sn * x + cs * y
            c[previous], c[i] = 0.0, r
            active[previous] = False
            plain = False
        previous = i
    return plain


@jit
def _exact_coupling(poles: Array, c: Array, origin: Integers, offset: Array, exact: Array) -> None:
    """Fill in the coupling for which the computed roots are exact (Loewner), with the signs of c."""
    m = poles.size
    for j in range(m):
        product = 1.0
        if offset.size == m:
            product = (poles[origin[m - 1]] - poles[j]) + offset[m - 1]
        for k in range(m - 1):
            root = (poles[origin[k]] - poles[j]) + offset[k]
            other = poles[k] - poles[j] if k < j else poles[k + 1] - poles[j]
            product *= root / other
        exact[j] = np.sqrt(abs(product)) * (1.0 if c[j] >= 0.0 else -1.0)


@jit
def _unit_vectors(
    poles: Array, exact: Array, origin: Integers, offset: Array, local: Array, length: Array
) -> None:  # fmt: skip
    """Fill in one unit vector per root as columns, and the signed lengths that they were divided by."""
    for k in range(offset.size):
        total = 0.0
        for j in range(poles.size):
            local[j, k] = exact[j] / ((poles[j] - poles[origin[k]]) - offset[k])
            total += local[j, k] * local[j, k]
        # The diagonal is made positive, so that the vectors of a weak contact are close to the identity.
        length[k] = np.sqrt(total) * (1.0 if local[k, k] > 0.0 else -1.0)
        for j in range(poles.size):
            local[j, k] /= length[k]


@jit
def _solve(
    poles: Array, w: Array, c: Array, origin: Integers, offset: Array, exact: Array, local: Array, length: Array
) -> None:
    """Fill in roots, as poles and offsets from these, coupling, vectors and their lengths.

    There are as many roots as offsets: all for a spring, one less for a constraint.
    """
    for k in range(offset.size):
        origin[k], offset[k] = _root(poles, w, k, 1.0 if offset.size == poles.size else 0.0)
    _exact_coupling(poles, c, origin, offset, exact)
    _unit_vectors(poles, exact, origin, offset, local, length)


class _Coupled(NamedTuple):
    """The eigensystem of the poles that a rank-one term couples; `which` are the numbers of these poles.

    `values` and `vectors` are those of all poles, with the new ones in place. `exact` and `length` are those of
    `_solve`, and `weights` the squared couplings.
    """

    which: Integers
    values: Array
    vectors: Array
    exact: Array
    length: Array
    weights: Array


def _coupled(d: Array, c: Array, rho: float, fewer: int) -> _Coupled:
    """Return the eigensystem with a spring (`fewer` is 0) or with a constraint (1)."""
    values, vectors, c, active = d.copy(), np.eye(d.size), c.copy(), np.zeros(d.size, dtype=np.bool_)
    plain = _rotate(d, c, vectors, active)
    index = np.flatnonzero(active)
    m = index.size
    count = max(m - fewer, 0)
    poles, coupling = d[index], c[index]
    weights = rho * coupling * coupling
    origin, offset, exact = np.empty(count, dtype=np.int64), np.empty(count), np.empty(m)
    local, length = np.empty((m, count)), np.empty(count)
    if m:
        _solve(poles, weights, coupling, origin, offset, exact, local, length)
    columns = index[:count]
    values[columns] = poles[origin] + offset
    if plain:
        vectors[np.ix_(index, columns)] = local
    else:
        vectors[:, columns] = np.take(vectors, index, axis=1) @ local
    return _Coupled(index, values, vectors, exact, length, weights)


def rank_one(d: Array, c: Array, rho: float) -> tuple[Array, Array]:
    """Return eigenvalues and orthogonal eigenvectors of ``diag(d) + rho c c'``, rho > 0.

    Parameters
    ----------
    d : ndarray, shape (n,)
        Ascending, not negative; repeated values are allowed.
    c : ndarray, shape (n,)
    rho : float

    Returns
    -------
    values : ndarray, shape (n,)
        Ascending.
    vectors : ndarray, shape (n, n)
        Columns.
    """
    found = _coupled(d, c, rho, 0)
    order = np.argsort(found.values, kind="stable")
    return found.values[order], np.take(found.vectors, order, axis=1)


def rank_one_less(d: Array, c: Array, rho: float) -> tuple[Array, Array]:
    """Return eigenvalues and orthogonal eigenvectors of ``diag(d) - rho c c'``, rho > 0, which is to be positive.

    Eigenvalues much below ``rho c'c`` are differences of large numbers and lose digits by that ratio; see `refine`.
    Arguments and returns are those of `rank_one`.
    """
    values, vectors = rank_one(np.ascontiguousarray(-d[::-1]), np.ascontiguousarray(c[::-1]), rho)
    return -values[::-1], np.ascontiguousarray(vectors[::-1, ::-1])


def refine(
    stiffness: Array, rows: Array, springs: Array, vectors: Array, steps: int = 3, demand: float = 1e-9
) -> tuple[Array, Array] | None:
    """Return eigenvalues and eigenvectors of ``diag(stiffness) + rows' diag(springs) rows``, given good guesses.

    Each step squares the error. The result is None where the guesses are too far off, or where neighbouring
    eigenvalues are too close for the method to separate their vectors.

    Parameters
    ----------
    stiffness : ndarray, shape (n,)
        Positive.
    rows : ndarray, shape (k, n)
    springs : ndarray, shape (k,)
    vectors : ndarray, shape (n, n)
        Nearly orthonormal columns.
    steps : int
        Largest number of steps.
    demand : float
        The iteration ends at a change of the vectors below this, because its square is then rounding.

    T. Ogita, K. Aishima, Japan J. Indust. Appl. Math. 35 (2018) 1007, doi:10.1007/s13160-018-0310-3.
    """
    n = stiffness.size
    for _ in range(steps):
        touched = rows @ vectors
        whole = vectors.T @ (stiffness[:, None] * vectors) + touched.T @ (springs[:, None] * touched)
        lack = np.eye(n) - vectors.T @ vectors
        values = whole.diagonal() / (1.0 - lack.diagonal())
        apart = values[None, :] - values[:, None]
        size = np.sqrt(np.outer(np.abs(values), np.abs(values)))
        push = whole + values[None, :] * lack
        np.fill_diagonal(push, 0.0)
        # Where only rounding couples close neighbours, any combination of their vectors is right.
        free = (np.abs(apart) <= _CLOSE * size) & (np.abs(push) <= _JOINED * size)
        change = np.where(free, 0.5 * lack, push / np.where(apart == 0.0, _EPS * size + 1e-300, apart))
        largest = float(np.max(np.abs(change)))
        if not (values.min() > 0.0 and largest < _FAR):
            return None
        vectors = vectors + vectors @ change
        if largest <= demand:
            order = np.argsort(values)
            return values[order], np.ascontiguousarray(vectors[:, order])
    return None


def constrain(d: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return the eigenvalues and eigenvectors of ``diag(d)`` restricted to ``c.x = 0``, the limit of a rigid spring.

    Parameters
    ----------
    d : ndarray, shape (n,)
        Ascending, not negative; repeated values are allowed.
    c : ndarray, shape (n,)
        Not zero.

    Returns
    -------
    values : ndarray, shape (n - 1,)
        Ascending.
    vectors : ndarray, shape (n, n - 1)
        Orthonormal columns V, all orthogonal to c.
    force : ndarray, shape (n - 1,)
        nu with ``diag(d) V = V diag(values) + c nu'``: the force of the constraint in each mode.
    """
    found = _coupled(d, c, 1.0, 1)
    # The scale of the exact coupling is that of c; its shape fits the roots.
    ratio = np.sqrt(np.sum(found.weights) / np.sum(found.exact * found.exact))
    force = np.zeros(d.size)
    force[found.which[:-1]] = 1.0 / (found.length * ratio)
    kept = np.delete(np.arange(d.size), found.which[-1])
    order = kept[np.argsort(found.values[kept], kind="stable")]
    return found.values[order], np.take(found.vectors, order, axis=1), force[order]
