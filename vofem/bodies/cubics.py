"""The four Hermite cubics on one element, in element coordinates (Hughes, The Finite Element Method, 1987).

The element coordinate ``xi`` runs from 0 to 1. Slopes are derivatives by the physical coordinate, so the slope
functions carry the element length. With differences of nodal coordinates taken once, nothing here loses digits on a
short element or far from the origin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_SHAPES = {
    0: (
        lambda s: (1.0 - s) ** 2 * (1.0 + 2.0 * s),
        lambda s: s * (1.0 - s) ** 2,
        lambda s: s**2 * (3.0 - 2.0 * s),
        lambda s: s**2 * (s - 1.0),
    ),
    1: (
        lambda s: 6.0 * s * (s - 1.0),
        lambda s: (1.0 - s) * (1.0 - 3.0 * s),
        lambda s: 6.0 * s * (1.0 - s),
        lambda s: s * (3.0 * s - 2.0),
    ),
    2: (
        lambda s: 12.0 * s - 6.0,
        lambda s: 6.0 * s - 4.0,
        lambda s: 6.0 - 12.0 * s,
        lambda s: 6.0 * s - 2.0,
    ),
    3: (
        lambda s: np.full_like(s, 12.0),
        lambda s: np.full_like(s, 6.0),
        lambda s: np.full_like(s, -12.0),
        lambda s: np.full_like(s, 6.0),
    ),
}


def hermite(i: int, xi: ArrayLike, h: ArrayLike, derivative: int = 0) -> Array:
    """Return a derivative of the i-th Hermite cubic by the physical coordinate.

    `i`: 0, 2: displacement at the left, right end; 1, 3: slope there.
    `xi`: element coordinates in [0, 1].
    `h`: element length in m, broadcast with `xi`.
    `derivative`: 0 to 3.
    """
    s = np.asarray(xi, dtype=float)
    h = np.asarray(h, dtype=float)
    values = _SHAPES[derivative][i](s)
    power = i % 2 - derivative
    if power == 0:
        return values * np.ones_like(h)
    return values * h if power == 1 else values / h ** (-power)


def rows_on_elements(entries: Array) -> csr_matrix:
    """Return rows over the degrees of freedom of a beam, shape (n_elements k, 2 n_elements + 2).

    `entries` (shape (n_elements, k, 4)): those of the cubics in k rows of every element.
    """
    from scipy.sparse import csr_matrix

    count, each = entries.shape[:2]
    columns = np.repeat(2 * np.arange(count), each)[:, None] + np.arange(4)
    ends = 4 * np.arange(count * each + 1)
    return csr_matrix((entries.ravel(), columns.ravel(), ends), shape=(count * each, 2 * count + 2))
