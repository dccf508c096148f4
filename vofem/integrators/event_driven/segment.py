"""The linear segments of an event-driven run, as a run keeps them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Segments(NamedTuple):
    """The segments of a run, one a row.

    Attributes
    ----------
    starts, durations : ndarray, shape (k,)
        Start times and durations in s.
    status : ndarray of int, shape (k, n_contacts)
    displacement, velocity : ndarray, shape (k, n)
        Modal states at the start of the segments.
    gaps : ndarray, shape (k, n_contacts)
        Gap functions at the start, m.
    """

    starts: NDArray[np.float64]
    durations: NDArray[np.float64]
    status: NDArray[np.int64]
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    gaps: NDArray[np.float64]
