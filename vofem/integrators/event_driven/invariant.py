"""Invariant subspaces of a damped system: one for every root, or one for several whose modes nearly coincide."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Condition number of a basis below which hardly any digits are lost, and the largest one that is accepted.
_WELL, _BEARABLE = 30.0, 1e3

#: Steps of the power method for a norm that is only compared with a limit.
_POWERS = 6

#: Modes whose overlap differs from one by less than this are kept together. The values are tried in turn; the last one
#: joins all modes.
_OVERLAPS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 0.6, 2.0)


class Group(NamedTuple):
    """A subspace on which the motion is ``xi' = motion xi``.

    Attributes
    ----------
    right : ndarray, shape (n, g)
        Columns that span it.
    left : ndarray, shape (g, n)
        Rows that take a state to xi.
    motion : ndarray, shape (g, g)
    """

    right: Array
    left: Array
    motion: Array

    def joined(self, other: Group) -> Group:
        """Return both as one subspace, on which they stay independent."""
        g, h = self.motion.shape[0], other.motion.shape[0]
        motion = np.zeros((g + h, g + h))
        motion[:g, :g], motion[g:, g:] = self.motion, other.motion
        return Group(np.hstack([self.right, other.right]), np.vstack([self.left, other.left]), motion)


class Roots(NamedTuple):
    """Roots that have a mode of their own, and these modes as real columns and rows.

    Attributes
    ----------
    pairs : ndarray of complex, shape (m,)
        The root with the positive imaginary part of each conjugate pair.
    real : ndarray, shape (r,)
        Ascending.
    right : ndarray, shape (n, 2m + r)
        First columns of the pairs, then their second ones, then those of the real roots. On the columns of a pair the
        motion is ``xi' = [[a, -b], [b, a]] xi``, where the root is ``a + i b``.
    left : ndarray, shape (2m + r, n)
        Rows that take a state to its coordinates.
    """

    pairs: NDArray[np.complex128]
    real: Array
    right: Array
    left: Array

    def scaled(self, scale: Array) -> Roots:
        """Return the modes where every entry of the state is multiplied by a factor, shape (n,)."""
        return self._replace(right=self.right * scale[:, None], left=self.left / scale)

    def taken(self, pairs: NDArray[np.bool_], real: NDArray[np.bool_]) -> tuple[Roots, list[Group]]:
        """Return some of the roots, and each of the others as a group of its own."""
        m = self.pairs.size
        kept = np.flatnonzero(np.concatenate([pairs, pairs, real]))
        groups = [
            Group(
                self.right[:, [k, m + k]],
                self.left[[k, m + k]],
                np.array([[s.real, -s.imag], [s.imag, s.real]]),
            )
            for k, s in enumerate(self.pairs)
            if not pairs[k]
        ]
        groups += [
            Group(self.right[:, [2 * m + k]], self.left[[2 * m + k]], self.real[[k]][:, None])
            for k in np.flatnonzero(~real)
        ]
        return Roots(self.pairs[pairs], self.real[real], self.right[:, kept], self.left[kept]), groups


def own_modes(roots: NDArray[np.complex128], right: Any, left: Any = None) -> Roots:
    """Return roots with modes of their own, one of each conjugate pair, from complex columns (n, m) and rows (m, n).

    Without rows these are the inverse of the columns, which then are all of them.
    """
    single = np.flatnonzero(roots.imag == 0.0)
    single = single[np.argsort(roots[single].real, kind="stable")]
    upper = np.flatnonzero(roots.imag > 0.0)
    double = np.sqrt(2.0)
    columns = np.hstack([double * right[:, upper].real, -double * right[:, upper].imag, right[:, single].real])
    if left is None:
        rows = np.linalg.inv(columns)
    else:
        rows = np.vstack([double * left[upper].real, double * left[upper].imag, left[single].real])
    return Roots(roots[upper], roots[single].real, columns, rows)


def well_conditioned(roots: Roots) -> bool:
    """Return whether the modes span the whole space with hardly any loss of digits."""
    return bool(np.all(np.isfinite(roots.left))) and _norm(roots.right) * _norm(roots.left.T) < _WELL


def _norm(matrix: Array) -> float:
    """Return the 2-norm of a matrix to some percent, from below."""
    size = np.sum(matrix**2, axis=0)
    vector = matrix[:, int(np.argmax(size))]
    for _ in range(_POWERS):
        vector = matrix @ (matrix.T @ (vector / np.linalg.norm(vector)))
    return float(np.sqrt(np.linalg.norm(vector)))


def split(state: Array) -> tuple[Roots, list[Group]]:
    """Split ``x' = state x`` into as small subspaces as a well-conditioned basis allows.

    Parameters
    ----------
    state : ndarray, shape (n, n)
        Matrix of the system, whose symmetric part has no positive eigenvalues except rounding.
    """
    roots, right = np.linalg.eig(state)
    upper = np.flatnonzero(roots.imag >= 0.0)
    try:
        alone = own_modes(roots[upper], right[:, upper])
        if well_conditioned(alone):
            return alone, []
    except np.linalg.LinAlgError:
        # Columns of a multiple root coincide.
        pass
    from scipy.linalg import schur

    triangle, vectors = schur(state, output="real")
    along = _roots_of(triangle)
    overlap = np.abs(right.conj().T @ right)
    best = np.inf
    for closeness in _OVERLAPS:
        labels = _together(overlap > 1.0 - closeness, roots)
        parts = [_subspace(triangle, vectors, along, roots[labels == k]) for k in range(labels.max() + 1)]
        basis = right.copy()
        for k, part in enumerate(parts):
            if np.sum(labels == k) > 1:
                basis[:, labels == k] = np.nan if part is None else part[0]
        if len(parts) == 1 and best < _BEARABLE:
            break
        condition = float(np.linalg.cond(basis)) if np.all(np.isfinite(basis)) else np.inf
        if condition < best:
            best, kept = condition, (labels, parts, basis)
        if best < _WELL:
            break
    labels, parts, basis = kept
    inverse = np.linalg.inv(basis)
    groups, single = [], []
    for k, part in enumerate(parts):
        mine = np.flatnonzero(labels == k)
        if mine.size > 1 and part is not None:
            groups.append(Group(part[0], inverse[mine].real, part[1]))
        elif roots[mine[0]].imag >= 0.0:
            single.append(mine[0])
    return own_modes(roots[single], basis[:, single], inverse[single]), groups


def _together(close: NDArray[np.bool_], roots: NDArray[np.complex128]) -> IntArray:
    """Return the number of the group of each root: linked by closeness, and with their conjugates where not alone."""
    n = roots.size
    conjugate = np.arange(n)
    upper = np.flatnonzero(roots.imag > 0)
    # LAPACK puts conjugates next to each other, the upper one first.
    conjugate[upper], conjugate[upper + 1] = upper + 1, upper
    labels = np.full(n, -1, dtype=np.int64)
    count = 0
    for k in range(n):
        if labels[k] >= 0:
            continue
        group, front = np.zeros(n, dtype=np.bool_), np.arange(n) == k
        while front.any():
            group |= front
            front = np.any(close[front], axis=0)
            if group.sum() > 1 or front.sum() > 1:
                front |= np.isin(np.arange(n), conjugate[group | front])
            front &= ~group
        labels[group] = count
        count += 1
    return labels


def _subspace(
    triangle: Array, vectors: Array, along: NDArray[np.complex128], roots: NDArray[np.complex128]
) -> tuple[Array, Array] | None:
    """Return an orthonormal basis of the subspace of some roots and the motion on it; None where that fails.

    It is the beginning of a real Schur form in which these roots come first.
    """
    from scipy.linalg.lapack import dtrsen

    if roots.size == 1:
        return None
    if roots.size == along.size:
        return vectors, triangle
    select = np.zeros(along.size, dtype=np.int32)
    for root in roots:
        select[int(np.argmin(np.where(select == 1, np.inf, np.abs(along - root))))] = 1
    # Job "N": order only, no condition numbers.
    ordered = dtrsen(select, triangle, vectors, job=b"N")
    if ordered[-1] != 0:
        return None
    return np.ascontiguousarray(ordered[1][:, : roots.size]), np.ascontiguousarray(
        ordered[0][: roots.size, : roots.size]
    )


def _roots_of(triangle: Array) -> NDArray[np.complex128]:
    """Return the eigenvalues along the diagonal of a real Schur form."""
    roots = triangle.diagonal().astype(complex)
    for k in np.flatnonzero(triangle.diagonal(-1)):
        roots[k : k + 2] = np.linalg.eigvals(triangle[k : k + 2, k : k + 2])
    return roots
