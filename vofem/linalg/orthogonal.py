"""Solutions with ``K = D'D`` through the orthogonal factorisation of D, free of the rounding in K.

K of a beam contains differences of fourth order. Rounding in its entries causes
an error of ``K^-1 f`` that grows with the fourth power of the number of elements;
at 10 000 elements it is half of the answer. The strains D contain differences of
low order only. Plane rotations take one row of D after the other and give
``D = Q R``. The rounding in each row is in proportion to that row, also where rows
differ much in size. Then ``R'R = K``, and K itself is never formed. On a beam of
100 000 elements ``R^-1 R^-T f`` is right to twelve digits.

J. A. George, M. T. Heath, Linear Algebra Appl. 34 (1980) 69, doi:10.1016/0024-3795(80)90159-7.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, IntArray
from vofem.errors import SingularSystemError
from vofem.kernels.jit import jit
from vofem.linalg.banded import band_order

BoolArray = NDArray[np.bool_]

#: Largest number of entries of a band; they take 1 GiB.
_MOST_ENTRIES = 2**27


def elimination_orders(strain: Any, rotational: BoolArray) -> tuple[IntArray, IntArray]:
    """Return two orders of elimination that keep the band narrow, one from either end of the structure.

    At every node the displacement comes before the slope. The opposite order
    has a thousand times the rounding error on long meshes.

    `strain` has shape (n_strains, n).
    `rotational` (shape (n,)): False for displacements, true for slopes, which follow the displacement of their node.
    """
    pattern = abs(strain)
    order = band_order(pattern.T @ pattern)
    return _displacements_first(order, rotational), _displacements_first(order[::-1].copy(), rotational)


def _displacements_first(order: IntArray, rotational: BoolArray) -> IntArray:
    """Swap the slope and the displacement of a node where the slope comes first in an order."""
    slope = np.append(False, rotational[1:] & ~rotational[:-1])
    swap = np.flatnonzero(slope[order[:-1]] & (order[1:] == order[:-1] - 1))
    order[swap], order[swap + 1] = order[swap + 1], order[swap]
    return order


class OrthogonalFactor:
    """``R'R = D'D`` by plane rotations, R in a band.

    `strain` (shape (n_strains, n)): D, of full column rank.
    `order` (shape (n,)): the order in which the unknowns are eliminated; see `elimination_orders`.
    Raises `SingularSystemError` if D lacks rank, or its band would not fit into memory.
    """

    def __init__(self, strain: Any, order: IntArray) -> None:
        self.order = order
        rows = strain[:, self.order].tocsr()
        rows.eliminate_zeros()
        rows.sort_indices()
        rows = rows[np.flatnonzero(np.diff(rows.indptr))]
        first, last = rows.indices[rows.indptr[:-1]], rows.indices[rows.indptr[1:] - 1]
        width = int(np.max(last - first, initial=0))
        n = self.order.size
        if n * (width + 1) > _MOST_ENTRIES:
            raise SingularSystemError(
                f"the stiffness matrix has {n} unknowns and a half-bandwidth of {width}, too many to factor: "
                "springs join points that lie far apart. Use fewer elements or fewer such springs"
            )
        # Rows are sorted by their first column, so that each is rotated with few rows of R.
        rows = rows[np.argsort(first, kind="stable")]
        self.band = np.zeros((n, width + 1))
        _rotate(rows.indptr.astype(np.int64), rows.indices.astype(np.int64), rows.data, self.band)
        if not np.all(self.band[:, 0]):
            raise SingularSystemError("the strains leave a motion without stiffness; hold the structure better")

    def root_solve(self, force: Array) -> Array:
        """Return ``R^-T f``, whose square is twice the energy under the load f, shape (n,)."""
        y = force[self.order]
        _down(self.band, y)
        return y

    def solve(self, force: Array) -> Array:
        """Return ``K^-1 f``, shape (n,)."""
        y = self.root_solve(force)
        _up(self.band, y)
        x = np.empty_like(y)
        x[self.order] = y
        return x


@jit
def _rotate(indptr: IntArray, indices: IntArray, data: Array, band: Array) -> None:
    """Rotate rows, ordered by their first column, into R; ``band[j, d]`` is the entry (j, j + d)."""
    n, width = band.shape[0], band.shape[1] - 1
    row = np.zeros(width + 1)
    for i in range(indptr.size - 1):
        begin, end = indptr[i], indptr[i + 1]
        j = indices[begin]
        row[:] = 0.0
        for p in range(begin, end):
            row[indices[p] - j] = data[p]
        while j < n:
            if row[0] != 0.0:
                if band[j, 0] == 0.0:
                    band[j] = row
                    break
                length = np.hypot(band[j, 0], row[0])
                c, s = band[j, 0] / length, row[0] / length
                for d in range(width + 1):
                    x, y = band[j, d], row[d]
                    band[j, d] = c * x + s * y
                    row[d] = c * y - s * x
            rest = False
            for d in range(width):
                row[d] = row[d + 1]
                rest = rest or row[d] != 0.0
            row[width] = 0.0
            j += 1
            if not rest:
                break


@jit
def _down(band: Array, x: Array) -> None:
    """Solve ``R' x = x`` in place."""
    n, count = band.shape
    for i in range(n):
        x[i] /= band[i, 0]
        value = x[i]
        for d in range(1, min(count, n - i)):
            x[i + d] -= band[i, d] * value


@jit
def _up(band: Array, x: Array) -> None:
    """Solve ``R x = x`` in place."""
    n, count = band.shape
    for i in range(n - 1, -1, -1):
        value = x[i]
        for d in range(1, min(count, n - i)):
            value -= band[i, d] * x[i + d]
        x[i] = value / band[i, 0]
