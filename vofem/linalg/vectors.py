"""Vectors in compiled loops.

numba compiles an assignment to a slice with all that it takes to broadcast, and to say why it could not: half a
second each. These loops are compiled once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.linalg.jit import jit, plain_form

Array = NDArray[np.float64]


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
def inner(one: Array, two: Array) -> float:
    """Return the sum of the products of the entries of two vectors."""
    total = 0.0
    for i in range(one.size):
        total += one[i] * two[i]
    return total


@plain_form(inner)
def _inner(one: Array, two: Array) -> float:
    return float(one @ two)
