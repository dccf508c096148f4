"""One linear segment of an event-driven run, as its integrals need it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.effects.time_functions import Piece
from vofem.integrators.event_driven.motion import Motion


@dataclass(frozen=True)
class Segment:
    """A stretch of time without events.

    Attributes
    ----------
    duration : float
        In s.
    status : ndarray of int, shape (n_contacts,)
    motion : Motion
        From the segment's start.
    pieces : list of Piece
        The loads from the segment's start.
    wanted : ndarray of int, shape (k,)
        Which of the times asked for lie in it.
    tau : ndarray, shape (k,)
        Those times, from the segment's start.
    """

    duration: float
    status: NDArray[np.int64]
    motion: Motion
    pieces: list[Piece]
    wanted: NDArray[np.int64]
    tau: NDArray[np.float64]
