"""The rows of scalar laws in compressed form, for compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.kernels.jit import jit
from vofem.laws.group import LawGroup

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class Rows(NamedTuple):
    """Rows in compressed form: row j consists of the entries `start[j]` to `start[j + 1]` of `column` and `weight`."""

    start: IntArray
    column: IntArray
    weight: Array


def compressed(rows: csr_matrix | None, order: IntArray) -> Rows:
    """Return rows over the unknowns in the given order; None means that there are no rows."""
    if rows is None:
        return Rows(np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0))
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    # Copies: operations of scipy sort the entries of a matrix in place.
    return Rows(rows.indptr.astype(np.int64), place[rows.indices], rows.data.copy())


def all_rows(groups: Sequence[LawGroup]) -> csr_matrix | None:
    """Return the rows of all groups, one after the other, or None where there are none."""
    parts = [group.rows for group in groups]
    if len(parts) < 2:
        return parts[0] if parts else None
    from scipy.sparse import vstack

    return vstack(parts, format="csr")


@jit
def dot(rows: Rows, j: int, x: Array) -> float:
    """Return the product of row j with x."""
    total = 0.0
    for e in range(rows.start[j], rows.start[j + 1]):
        total += rows.weight[e] * x[rows.column[e]]
    return total


@jit
def subtract_row(rows: Rows, j: int, factor: float, y: Array) -> None:
    """Subtract a multiple of row j from y."""
    for e in range(rows.start[j], rows.start[j + 1]):
        y[rows.column[e]] -= rows.weight[e] * factor
