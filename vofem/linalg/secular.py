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

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.linalg.vectors import copy

Array = NDArray[np.float64]

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
        low, high = 0.0, float(np.sum(w))
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
def _deflate(d: Array, c: Array, vectors: Array) -> tuple[NDArray[np.int64], bool]:
    """Rotate coinciding poles so that one of them takes all of the coupling.

    Returns the poles that are coupled, and whether `vectors` is the identity still.
    """
    n = d.size
    norm = np.sqrt(np.sum(c * c))
    active = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        # A rigid motion whose coupling is only rounding stays a rigid motion.
        active[i] = abs(c[i]) > (1e-14 if d[i] == 0.0 else 1e-18) * norm
    previous = -1
    plain = True
    for i in range(n):
        if not active[i]:
            continue
        if previous >= 0 and d[i] - d[previous] <= 4.0 * _EPS * max(abs(d[i]), abs(d[previous])):
            r = np.hypot(c[previous], c[i])
            cs, sn = c[i] / r, c[previous] / r
            for row in range(n):
                a, b = vectors[row, previous], vectors[row, i]
                vectors[row, previous] = cs * a - sn * b
                vectors[row, i] = sn * a + cs * b
            c[previous], c[i] = 0.0, r
            active[previous] = False
            plain = False
        previous = i
    return np.flatnonzero(active), plain


@jit
def _place(vectors: Array, index: NDArray[np.int64], local: Array, plain: bool) -> None:
    """Replace the first columns of `index` by their combinations; without rotations these are `local` itself."""
    columns = index[: local.shape[1]]
    if plain:
        for k in range(columns.size):
            for j in range(index.size):
                vectors[index[j], columns[k]] = local[j, k]
    else:
        combined = np.ascontiguousarray(vectors[:, index]) @ local
        for k in range(columns.size):
            copy(combined[:, k], vectors[:, columns[k]])


@jit
def _exact_coupling(poles: Array, c: Array, origin: NDArray[np.int64], offset: Array, spring: bool) -> Array:
    """Return the coupling for which the computed roots are exact (Loewner), with the signs of c."""
    m = poles.size
    exact = np.empty(m)
    for j in range(m):
        product = (poles[origin[m - 1]] - poles[j]) + offset[m - 1] if spring else 1.0
        for k in range(m - 1):
            root = (poles[origin[k]] - poles[j]) + offset[k]
            other = poles[k] - poles[j] if k < j else poles[k + 1] - poles[j]
            product *= root / other
        exact[j] = np.sqrt(abs(product)) * (1.0 if c[j] >= 0.0 else -1.0)
    return exact


@jit
def _unit_vectors(poles: Array, exact: Array, origin: NDArray[np.int64], offset: Array) -> tuple[Array, Array]:
    """Return one unit vector per root as columns, and the signed lengths that they were divided by."""
    m, count = poles.size, offset.size
    local, length = np.empty((m, count)), np.empty(count)
    for k in range(count):
        total = 0.0
        for j in range(m):
            local[j, k] = exact[j] / ((poles[j] - poles[origin[k]]) - offset[k])
            total += local[j, k] * local[j, k]
        # The diagonal is made positive, so that the vectors of a weak contact are close to the identity.
        length[k] = np.sqrt(total) * (1.0 if local[k, k] > 0.0 else -1.0)
        for j in range(m):
            local[j, k] /= length[k]
    return local, length


@jit
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
    vectors = np.eye(d.size)
    c = c.copy()
    values = d.copy()
    index, plain = _deflate(d, c, vectors)
    m = index.size
    if m == 0:
        return values, vectors
    poles = d[index]
    w = rho * c[index] * c[index]
    origin = np.empty(m, dtype=np.int64)
    offset = np.empty(m)
    for k in range(m):
        origin[k], offset[k] = _root(poles, w, k, 1.0)
        values[index[k]] = poles[origin[k]] + offset[k]
    exact = _exact_coupling(poles, c[index], origin, offset, True)
    local, _ = _unit_vectors(poles, exact, origin, offset)
    _place(vectors, index, local, plain)
    order = np.argsort(values)
    return values[order], vectors[:, order]


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


@jit
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
    n = d.size
    vectors = np.eye(n)
    c = c.copy()
    index, plain = _deflate(d, c, vectors)
    m = index.size
    poles = d[index]
    w = c[index] * c[index]
    origin = np.empty(m - 1, dtype=np.int64)
    offset = np.empty(m - 1)
    values = d.copy()
    force = np.zeros(n)
    for k in range(m - 1):
        origin[k], offset[k] = _root(poles, w, k, 0.0)
        values[index[k]] = poles[origin[k]] + offset[k]
    exact = _exact_coupling(poles, c[index], origin, offset, False)
    # The scale of the exact coupling is that of c; its shape fits the roots.
    ratio = np.sqrt(np.sum(w) / np.sum(exact * exact))
    local, length = _unit_vectors(poles, exact, origin, offset)
    for k in range(m - 1):
        force[index[k]] = 1.0 / (length[k] * ratio)
    _place(vectors, index, local, plain)
    kept = np.ones(n, dtype=np.bool_)
    kept[index[m - 1]] = False
    values, force, vectors = values[kept], force[kept], vectors[:, kept]
    order = np.argsort(values)
    return values[order], vectors[:, order], force[order]
