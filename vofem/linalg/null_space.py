"""The null space of a small matrix, or of a large one of short rows, whose entries are sums that may cancel."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.arrays import Array

#: An entry below this fraction of the largest term of its sum counts as rounding.
_ROUNDING = 1e-12

#: More rows than this are first reduced to a triangle; a foundation may have one row for every element.
_MANY_ROWS = 256


def null_space(matrix: Array, magnitude: Array) -> Array:
    """Return an orthonormal basis of the null space, shape (columns, r).

    All entries of the matrix may be rounding, which the matrix itself does not
    show. Each entry is therefore compared with the size of the terms of its sum.

    `matrix` has shape (rows, columns).
    `magnitude` (shape (rows, columns)): the same sums over magnitudes.
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


#: Up to this number of columns a sparse matrix is treated as a dense one.
_FEW_COLUMNS = 64


def sparse_null_space(matrix: Any, magnitude: Any) -> Array:
    """Return a basis of the null space of a sparse matrix, shape (columns, r).

    Rows of one or two entries, for example of springs between masses, are solved
    one by one: a row of one entry makes an unknown zero, a row of two entries makes
    one unknown a multiple of the other. The remaining system is small.

    `matrix`, `magnitude` (shape (rows, columns)): see `null_space`.
    """
    columns = matrix.shape[1]
    if columns <= _FEW_COLUMNS:
        return null_space(matrix.toarray(), magnitude.toarray())
    matrix = matrix.tocsr()
    size = np.asarray(magnitude.max(axis=1).todense()).ravel()
    chains = _Chains(columns)
    rows: list[dict[int, float]] = []
    for k in range(matrix.shape[0]):
        part = slice(matrix.indptr[k], matrix.indptr[k + 1])
        entries = {
            int(i): float(a) / size[k]
            for i, a in zip(matrix.indices[part], matrix.data[part], strict=True)
            if abs(a) >= _ROUNDING * size[k]
        }
        if entries:
            rows.append(entries)
    while True:
        rest = [reduced for row in rows if (reduced := chains.absorb(row)) is not None]
        if len(rest) == len(rows):
            break
        rows = rest
    roots = np.flatnonzero((chains.parent == np.arange(columns)) & (chains.factor != 0.0))
    place = {int(root): k for k, root in enumerate(roots)}
    dense, terms = np.zeros((2, len(rows), roots.size))
    for k, row in enumerate(rows):
        for i, a in chains.reduced(row).items():
            dense[k, place[i]] = a
            terms[k, place[i]] = max(abs(a) for a in row.values())
    small = null_space(dense, terms)
    full = np.zeros((columns, small.shape[1]))
    for i in range(columns):
        root, factor = chains.find(i)
        if factor != 0.0:
            full[i] = factor * small[place[root]]
    return full / np.linalg.norm(full, axis=0)


class _Chains:
    """Unknowns that are multiples of others, or zero."""

    def __init__(self, count: int) -> None:
        self.parent = np.arange(count)
        self.factor = np.ones(count)

    def find(self, i: int) -> tuple[int, float]:
        """Return the representative of unknown i and the factor by which i is a multiple of it; 0 if i is zero."""
        path = []
        while self.parent[i] != i:
            path.append(i)
            i = int(self.parent[i])
        total = float(self.factor[i]) if self.factor[i] == 0.0 else 1.0
        for k in reversed(path):
            total *= float(self.factor[k])
            self.parent[k], self.factor[k] = i, total
        return i, total

    def reduced(self, row: dict[int, float]) -> dict[int, float]:
        """Return a row in terms of the representatives."""
        found: dict[int, float] = {}
        terms: dict[int, float] = {}
        for i, a in row.items():
            root, factor = self.find(i)
            found[root] = found.get(root, 0.0) + a * factor
            terms[root] = max(terms.get(root, 0.0), abs(a * factor))
        largest = max(terms.values(), default=0.0)
        return {root: a for root, a in found.items() if abs(a) >= _ROUNDING * largest and a != 0.0}

    def absorb(self, row: dict[int, float]) -> dict[int, float] | None:
        """Apply a row of at most two entries; return the row if it has more."""
        entries = self.reduced(row)
        if len(entries) > 2:
            return row
        if len(entries) == 1:
            self.factor[next(iter(entries))] = 0.0
        elif entries:
            (one, a), (two, b) = entries.items()
            self.parent[one], self.factor[one] = two, -b / a
        return None
