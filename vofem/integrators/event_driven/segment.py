"""The linear segments of an event-driven run, as a run keeps them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Segments(NamedTuple):
    """The segments of a run, one a row."""

    #: `starts`, `durations`: start times and durations in s, shape (k,).
    starts: NDArray[np.float64]
    durations: NDArray[np.float64]
    status: NDArray[np.int64]  #: Shape (k, n_contacts).
    #: `displacement`, `velocity`: modal states at the start of the segments, shape (k, n).
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    gaps: NDArray[np.float64]  #: Gap functions at the start, m, shape (k, n_contacts).
    logged: NDArray[np.int64]  #: Numbers of the events that had been written when the segments began, shape (k,).
