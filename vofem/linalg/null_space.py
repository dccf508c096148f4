"""The null space of a matrix whose entries are sums that may cancel: of few columns, or of many tied in pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]

#: Entries below this fraction of the terms they are sums of are rounding.
_ROUNDING = 1e-12

#: So many rows are first reduced to a triangle, as a foundation may have one for every element.
_MANY_ROWS = 256


def null_space(matrix: Array, magnitude: Array) -> Array:
    """Return an orthonormal basis of the null space, shape (columns, r).

    What is rounding cannot be judged from the matrix itself, which may be
    nothing but rounding: each row is compared with the terms it is made of.

    Parameters
    ----------
    matrix : ndarray, shape (rows, columns)
    magnitude : ndarray, shape (rows, columns)
        The same sums over magnitudes.
    """
    columns = matrix.shape[1]
    if not matrix.shape[0] or not columns:
        return np.eye(columns)
    size = np.max(magnitude, axis=1, keepdims=True)
    rows = matrix / np.where(size > 0.0, size, 1.0)
    rows[np.abs(rows) < _ROUNDING] = 0.0
    rows = rows[np.any(rows != 0.0, axis=1)]
    if not rows.shape[0]:
        return np.eye(columns)
    if rows.shape[0] > _MANY_ROWS:
        rows = np.asarray(np.linalg.qr(rows, mode="r"))
    _, values, right = np.linalg.svd(rows, full_matrices=True)
    null = right[int(np.sum(values > 1e-10 * values[0])) :].T.copy()
    null[np.abs(null) < 1e-13] = 0.0
    return null


def tied(matrix: csr_matrix, magnitude: csr_matrix) -> Array:
    """Return a basis, shape (columns, r), in which a matrix of many columns has its null space.

    Rows with one entry make a column zero, rows with two make it a multiple of
    another: so springs join masses. What they leave free is the basis; other
    rows are not looked at. r is small where most columns are tied, whatever
    their number.

    Parameters
    ----------
    matrix : csr_matrix, shape (rows, columns)
    magnitude : csr_matrix, shape (rows, columns)
        The same sums over magnitudes, which tell what is rounding.
    """
    columns = matrix.shape[1]
    size = np.asarray(magnitude.max(axis=1).todense()).ravel()
    # Each column is a factor times its root; the tree is kept flat by joining the smaller part to the larger.
    factor, held = np.ones(columns), np.zeros(columns, dtype=bool)
    root, members = list(range(columns)), [[k] for k in range(columns)]
    for i in range(matrix.shape[0]):
        part = slice(matrix.indptr[i], matrix.indptr[i + 1])
        entries = [
            (int(k), float(x))
            for k, x in zip(matrix.indices[part], matrix.data[part], strict=True)
            if abs(x) > _ROUNDING * size[i]
        ]
        if len(entries) == 1:
            held[root[entries[0][0]]] = True
        if len(entries) != 2:
            continue
        (a, x), (b, y) = entries
        # x u_a + y u_b = 0, in terms of the roots of both.
        left, right = x * factor[a], y * factor[b]
        a, b = root[a], root[b]
        if a == b:
            held[a] |= abs(left + right) > _ROUNDING * size[i]
            continue
        if len(members[a]) < len(members[b]):
            a, b, left, right = b, a, right, left
        held[a] |= held[b]
        factor[members[b]] *= -left / right
        for k in members[b]:
            root[k] = a
        members[a] += members[b]
        members[b] = []
    free = [k for k in range(columns) if members[k] and not held[k]]
    basis = np.zeros((columns, len(free)))
    for j, k in enumerate(free):
        part_of = members[k]
        basis[part_of, j] = factor[part_of] / np.linalg.norm(factor[part_of])
    return basis
