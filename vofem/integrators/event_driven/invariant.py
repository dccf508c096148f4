"""Invariant subspaces of a damped system: one for every root, or one for several whose modes nearly coincide."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Condition number of a basis that costs hardly any digits, and the largest that is put up with.
_WELL, _BEARABLE = 30.0, 1e3

#: Modes whose overlap is closer to one than this are kept together: as many as it takes, all of them at last.
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


def groups_of(state: Array) -> list[Group]:
    """Split ``x' = state x`` into as small subspaces as a well-conditioned basis allows.

    Parameters
    ----------
    state : ndarray, shape (n, n)
        Of which the symmetric part is not positive, or nearly so.
    """
    roots, right = np.linalg.eig(state)
    if np.linalg.cond(right) < _WELL:
        left = np.linalg.inv(right)
        return [_modes(roots, right, left, np.array([k])) for k in np.flatnonzero(roots.imag >= 0)]
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
    groups: list[Group] = []
    for k, part in enumerate(parts):
        mine = np.flatnonzero(labels == k)
        if mine.size > 1 and part is not None:
            groups.append(Group(part[0], inverse[mine].real, part[1]))
        elif roots[mine[0]].imag >= 0.0:
            groups.append(_modes(roots, basis, inverse, mine))
    return groups


def _modes(roots: Any, right: Any, left: Any, k: IntArray) -> Group:
    """Return the group of a real root, or of a pair of conjugate ones by the first of them."""
    s = complex(roots[k[0]])
    if s.imag == 0.0:
        return Group(right[:, k].real.copy(), left[k].real.copy(), np.array([[s.real]]))
    column, row = right[:, k[0]], left[k[0]]
    double = np.sqrt(2.0)
    motion = np.array([[s.real, -s.imag], [s.imag, s.real]])
    return Group(
        double * np.stack([column.real, -column.imag], axis=1), double * np.stack([row.real, row.imag]), motion
    )


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
