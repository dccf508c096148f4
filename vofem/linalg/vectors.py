"""Vectors in compiled loops.

numba compiles every assignment to a slice together with code for broadcasting and its errors, which takes half a second
each. These loops are compiled once.
"""

from __future__ import annotations

from vofem.arrays import Array
from vofem.kernels.jit import jit, plain_form


@jit
def copy(values: Array, into: Array) -> None:
    """Copy a vector into another one of the same length."""
    for i in range(values.size):
        into[i] = values[i]


@plain_form(copy)
def _copy(values: Array, into: Array) -> None:
    into[:] = values


@jit
def fill(into: Array, value: float) -> None:
    """Set all entries of a vector to one value."""
    for i in range(into.size):
        into[i] = value


@plain_form(fill)
def _fill(into: Array, value: float) -> None:
    into[:] = value


@jit
def add(values: Array, factor: float, into: Array) -> None:
    """Add a multiple of a vector to another one of the same length."""
    for i in range(values.size):
        into[i] += factor * values[i]


@plain_form(add)
def _add(values: Array, factor: float, into: Array) -> None:
    into += factor * values


@jit
def add_outer(column: Array, row: Array, factor: float, into: Array) -> None:
    """Add a multiple of the product of a column and a row to a matrix."""
    for i in range(column.size):
        for k in range(row.size):
            into[i, k] += factor * column[i] * row[k]


@plain_form(add_outer)
def _add_outer(column: Array, row: Array, factor: float, into: Array) -> None:
    into += factor * column[:, None] * row


@jit
def add_product(one: Array, two: Array, into: Array) -> None:
    """Add the product of two matrices, of which the first has few rows, to a third one."""
    for i in range(one.shape[0]):
        for k in range(one.shape[1]):
            add(two[k], one[i, k], into[i])


@plain_form(add_product)
def _add_product(one: Array, two: Array, into: Array) -> None:
    into += one @ two


@jit
def inner(one: Array, two: Array) -> float:
    """Return the sum of the products of the entries of two vectors."""
    # Four sums are computed at a time, because each addition waits only for the last one of its own sum.
    n = one.size
    even = n - n % 4
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    for i in range(0, even, 4):
        first += one[i] * two[i]
        second += one[i + 1] * two[i + 1]
        third += one[i + 2] * two[i + 2]
        fourth += one[i + 3] * two[i + 3]
    for i in range(even, n):
        first += one[i] * two[i]
    return (first + second) + (third + fourth)


@plain_form(inner)
def _inner(one: Array, two: Array) -> float:
    return float(one @ two)


@jit
def multiply(matrix: Array, vector: Array, out: Array) -> None:
    """Write ``matrix @ vector``; columns beyond the length of the vector do not count, and missing ones are zero."""
    for i in range(out.size):
        out[i] = inner(matrix[i, : vector.size], vector)


@plain_form(multiply)
def _multiply(matrix: Array, vector: Array, out: Array) -> None:
    out[:] = matrix[: out.size, : vector.size] @ vector[: matrix.shape[1]]


@jit
def multiply_transposed(matrix: Array, vector: Array, out: Array) -> None:
    """Write ``matrix.T @ vector``, row by row of the matrix as it lies in memory; missing columns are zero."""
    fill(out, 0.0)
    for i in range(vector.size):
        factor, row = vector[i], matrix[i]
        for k in range(min(out.size, row.size)):
            out[k] += factor * row[k]


@plain_form(multiply_transposed)
def _multiply_transposed(matrix: Array, vector: Array, out: Array) -> None:
    out[:] = 0.0
    out[: matrix.shape[1]] = vector @ matrix[: vector.size, : out.size]
