"""The linear segments of an event-driven run: one as its integrals need it, and all as a run keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.motion import Motion
from vofem.time_functions import Piece


@dataclass(frozen=True)
class Segment:
    """A stretch of time without events.

    Attributes
    ----------
    duration : float
        Duration of the segment in s.
    status : ndarray of int, shape (n_contacts,)
    motion : Motion
        The motion from the segment's start on.
    pieces : list of Piece
        The loads from the segment's start.
    wanted : ndarray of int, shape (k,)
        Numbers of the requested times that lie in the segment.
    tau : ndarray, shape (k,)
        Those times, from the segment's start.
    """

    duration: float
    status: NDArray[np.int64]
    motion: Motion
    pieces: list[Piece]
    wanted: NDArray[np.int64]
    tau: NDArray[np.float64]


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
