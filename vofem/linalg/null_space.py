"""The null space of a small matrix whose entries are sums that may cancel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
