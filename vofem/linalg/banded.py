"""Symmetric banded matrices for compiled time loops: factor once, solve and multiply many times.

Lower band storage: ``band[d, i]`` is the entry (i + d, i). The factorisation
is L D L' without pivoting and without square roots, for positive definite
matrices; its solve takes two sweeps.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.errors import SingularSystemError
from vofem.kernels.jit import jit, plain_form

#: Far from a load, answers of beams fall off to nothing. What is smaller than this becomes zero there, because
#: processors take a hundred times as long for numbers near 1e-308.
_TINY = 1e-250


def band_order(*matrices: Any) -> IntArray:
    """Return an order of the unknowns that keeps the common pattern of the matrices narrow.

    The natural order is kept unless reverse Cuthill-McKee narrows the band.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    natural = np.arange(matrices[0].shape[0])
    width = band_width(natural, *matrices)
    if width <= 3:
        return natural
    pattern = sum((abs(matrix) for matrix in matrices[1:]), start=abs(matrices[0]))
    order = np.asarray(reverse_cuthill_mckee(csr_matrix(pattern), symmetric_mode=True), dtype=np.int64)
    return order if band_width(order, *matrices) < width else natural


def band_width(order: IntArray, *matrices: Any) -> int:
    """Return the half-bandwidth of the common pattern of matrices, unknowns taken in the given order."""
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    parts = [matrix.tocoo() for matrix in matrices]
    return max(int(np.max(np.abs(place[part.row] - place[part.col]), initial=0)) for part in parts)


def to_band(matrix: Any, order: IntArray) -> Array:
    """Return a symmetric sparse matrix in lower band storage, unknowns taken in the given order."""
    coo = matrix.tocoo()
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    row, column = place[coo.row], place[coo.col]
    lower = row >= column
    width = int(np.max(row[lower] - column[lower], initial=0))
    band = np.zeros((width + 1, order.size))
    np.add.at(band, ((row - column)[lower], column[lower]), coo.data[lower])
    return band


def widen(band: Array, width: int) -> Array:
    """Return a band with zero diagonals added up to the given half-bandwidth."""
    return np.vstack([band, np.zeros((width + 1 - band.shape[0], band.shape[1]))])


def factor(band: Array, what: str) -> Array:
    """Return L (unit, below) and D (row 0) of ``A = L D L'`` in band storage.

    Raises `SingularSystemError` if a pivot is not positive; `what` names the matrix.
    """
    result = band.copy()
    bad = factor_in_place(result)
    if bad >= 0:
        raise SingularSystemError(f"{what} is not positive definite (pivot {bad} of {band.shape[1]})")
    return result


@jit
def factor_in_place(band: Array) -> int:
    """Replace A by its factors, for `solve`; return the first pivot that is not positive, or -1."""
    width, n = band.shape[0] - 1, band.shape[1]
    for i in range(n):
        pivot = band[0, i]
        if not pivot > 0.0:
            return i
        reach = min(width, n - 1 - i)
        for a in range(1, reach + 1):
            ratio = band[a, i] / pivot
            for b in range(a, reach + 1):
                band[b - a, i + a] -= ratio * band[b, i]
        for a in range(1, reach + 1):
            band[a, i] /= pivot
    return -1


@jit
def solve(factored: Array, x: Array) -> None:
    """Solve ``A x = x`` in place."""
    width, n = factored.shape[0] - 1, factored.shape[1]
    if width == 3 and n > 3:
        # Beams of Hermite elements.
        _solve_four_diagonals(factored, x)
        return
    if width == 1:
        # Chains of masses.
        _solve_two_diagonals(factored, x)
        return
    if width == 0:
        # Masses at points.
        for i in range(n):
            x[i] /= factored[0, i]
        return
    for i in range(n):
        value = x[i]
        for a in range(1, min(width, n - 1 - i) + 1):
            x[i + a] -= factored[a, i] * value
    for i in range(n):
        x[i] /= factored[0, i]
    for i in range(n - 1, -1, -1):
        value = x[i]
        for a in range(min(width, n - 1 - i), 0, -1):
            value -= factored[a, i] * x[i + a]
        x[i] = value


@jit
def _solve_two_diagonals(factored: Array, x: Array) -> None:
    """Do what `solve` does where the half-bandwidth is 1, with the newest unknown in a register."""
    n = x.size
    here = x[0]
    for i in range(n - 1):
        ahead = x[i + 1] - factored[1, i] * here
        x[i] = here / factored[0, i]
        here = ahead
    last = here / factored[0, n - 1]
    x[n - 1] = last
    for i in range(n - 2, -1, -1):
        last = x[i] - factored[1, i] * last
        x[i] = last


@jit
def _solve_four_diagonals(factored: Array, x: Array) -> None:
    """Do what `solve` does where the half-bandwidth is 3.

    The unknowns on which the next ones depend stay in registers, and the newest of them enters a sum last: a sweep
    waits for its own results, so this order takes a third of the time. There are at least four unknowns.
    """
    n = x.size
    here, next1, next2 = x[0], x[1], x[2]
    for i in range(n - 3):
        next3 = x[i + 3] - factored[3, i] * here
        x[i] = here / factored[0, i]
        here, next1, next2 = next1 - factored[1, i] * here, next2 - factored[2, i] * here, next3
        if i % 16 == 0 and abs(here) + abs(next1) + abs(next2) < _TINY:
            here, next1, next2 = 0.0, 0.0, 0.0
    next1 -= factored[1, n - 3] * here
    next2 -= factored[2, n - 3] * here
    last1 = next1 / factored[0, n - 2]
    last2 = (next2 - factored[1, n - 2] * next1) / factored[0, n - 1]
    last1 -= factored[1, n - 2] * last2
    last0 = here / factored[0, n - 3] - factored[2, n - 3] * last2 - factored[1, n - 3] * last1
    x[n - 3], x[n - 2], x[n - 1] = last0, last1, last2
    for i in range(n - 4, -1, -1):
        value = x[i] - factored[3, i] * last2 - factored[2, i] * last1 - factored[1, i] * last0
        x[i] = 0.0 if abs(value) < _TINY else value
        last0, last1, last2 = value, last0, last1
        if i % 16 == 0 and abs(last0) + abs(last1) + abs(last2) < _TINY:
            last0, last1, last2 = 0.0, 0.0, 0.0


@plain_form(solve)
def _solve_in_lists(factored: Array, x: Array) -> None:
    # Access to Python's own numbers in lists takes a fifth of the time of access to single entries of arrays.
    width, n = factored.shape[0] - 1, factored.shape[1]
    rows, values = factored.tolist(), x.tolist()
    for i in range(n):
        value = values[i]
        for a in range(1, min(width, n - 1 - i) + 1):
            values[i + a] -= rows[a][i] * value
    values = [value / pivot for value, pivot in zip(values, rows[0], strict=True)]
    for i in range(n - 1, -1, -1):
        value = values[i]
        for a in range(min(width, n - 1 - i), 0, -1):
            value -= rows[a][i] * values[i + a]
        values[i] = value
    x[:] = values


@jit
def subtract_product(band: Array, x: Array, y: Array) -> None:
    """Subtract ``A x`` from y."""
    width, n = band.shape[0] - 1, band.shape[1]
    for i in range(n):
        y[i] -= band[0, i] * x[i]
    # Two loops for each diagonal, because the processor then takes several entries at once.
    for a in range(1, width + 1):
        for i in range(n - a):
            y[i + a] -= band[a, i] * x[i]
        for i in range(n - a):
            y[i] -= band[a, i] * x[i + a]


@plain_form(subtract_product)
def _subtract_diagonals(band: Array, x: Array, y: Array) -> None:
    n = band.shape[1]
    y -= band[0] * x
    for a in range(1, band.shape[0]):
        y[a:] -= band[a, : n - a] * x[: n - a]
        y[: n - a] -= band[a, : n - a] * x[a:]
