"""The linear segments of an event-driven run, as a run keeps them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.system import CLOSED, Events


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
    #: Numbers of the events that had been written when the segments began, shape (k,); None in earlier files.
    logged: NDArray[np.int64] | None = None


def counted(segments: Segments, events: Events, rigid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return `Segments.logged` of a run whose file does not hold it: every change of a status is an event."""
    status = np.vstack([events.initial[: rigid.size], segments.status[:, : rigid.size]])
    changed = status[1:] != status[:-1]
    found = np.cumsum(np.count_nonzero(changed, axis=1))
    for k in np.flatnonzero((segments.durations[:-1] == 0.0) & np.any(np.diff(segments.velocity, axis=0), axis=1)):
        number = found[k]
        j = events.contact[number] if number < events.time.size else 0
        if number < events.time.size and rigid[j] and events.status[number] == CLOSED:
            # A bounce: the stop closes and opens at once.
            found[k + 1 :] += 2 - changed[k + 1, j]
    return np.asarray(found)
