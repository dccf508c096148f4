"""Matrices gathered entry by entry, and rows stacked to matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.bodies.base import Array, IntArray, Row

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def entries(matrix: Any) -> tuple[IntArray, IntArray, Array]:
    """Return rows, columns and values of a matrix, in csr form or small and dense."""
    if isinstance(matrix, np.ndarray):
        rows, columns = np.indices(matrix.shape).reshape(2, -1)
        return rows, columns, matrix.ravel()
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return rows, matrix.indices.astype(np.int64), matrix.data


class Triplets:
    """Coordinate entries of one matrix over all degrees of freedom."""

    def __init__(self) -> None:
        self.rows: list[IntArray] = []
        self.columns: list[IntArray] = []
        self.values: list[Array] = []

    def add_matrix(self, matrix: Any, row: int, column: int) -> None:
        """Add a matrix whose first entry stands at a row and a column."""
        rows, columns, values = entries(matrix)
        self.rows.append(rows + row)
        self.columns.append(columns + column)
        self.values.append(values)

    def add_rank_one(self, row: Row, factor: float) -> None:
        """Add ``factor * b b'``."""
        k = row.indices.size
        self.rows.append(np.repeat(row.indices, k))
        self.columns.append(np.tile(row.indices, k))
        self.values.append(factor * np.outer(row.weights, row.weights).ravel())

    def build(self, size: int, columns: int | None = None) -> csr_matrix | None:
        """Return the matrix, square where no number of columns is given; None where nothing was added."""
        from scipy.sparse import coo_matrix

        if not self.rows:
            return None
        places = (np.concatenate(self.rows), np.concatenate(self.columns))
        return coo_matrix((np.concatenate(self.values), places), shape=(size, columns or size)).tocsr()


def stacked(rows: Sequence[Row], size: int) -> csr_matrix:
    """Return rows as one matrix over all degrees of freedom, shape (len(rows), N)."""
    from scipy.sparse import csr_matrix

    indices = np.concatenate([row.indices for row in rows])
    weights = np.concatenate([row.weights for row in rows])
    ends = np.cumsum([0, *(row.indices.size for row in rows)])
    return csr_matrix((weights, indices, ends), shape=(len(rows), size))


def restricted(matrix: csr_matrix, free: IntArray) -> Any:
    """Return the rows and columns of the free degrees of freedom of a square matrix, as csc_matrix."""
    size = matrix.shape[0]
    if free.size == size:
        return matrix.tocsc()
    from scipy.sparse import csc_matrix

    place = np.full(size, -1)
    place[free] = np.arange(free.size)
    coo = matrix.tocoo()
    row, column = place[coo.row], place[coo.col]
    kept = (row >= 0) & (column >= 0)
    return csc_matrix((coo.data[kept], (row[kept], column[kept])), shape=(free.size, free.size))
