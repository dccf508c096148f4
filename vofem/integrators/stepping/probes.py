"""Points whose motion is recorded at every step, however few times the states are stored at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows, ProbeSamples
from vofem.kernels.jit import jit
from vofem.laws.rows import Rows, compressed, dot

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Steps that a tap holds between two looks at the outcome.
MOST_STEPS = 8192


class Tap(NamedTuple):
    """What compiled loops fill: times, and (q, v, a) of points, shape (3, n_points, room); `filled` columns are in."""

    rows: Rows
    times: Array
    motion: Array
    filled: IntArray


def tap(probes: ProbeRows | None, order: IntArray) -> Tap | None:
    """Return a tap for unknowns taken in the given order, or None where there are no points."""
    if probes is None:
        return None
    n, room = len(probes.names), MOST_STEPS + 2
    rows = compressed(probes.rows, order)
    return Tap(rows, np.empty(room), np.empty((3, n, room)), np.zeros(1, dtype=np.int64))


@jit
def record(tap: Tap, t: float, q: Array, v: Array, a: Array) -> None:
    """Enter the motion of all points at t, where a step ends."""
    k = tap.filled[0]
    tap.times[k] = t
    for j in range(tap.motion.shape[1]):
        tap.motion[0, j, k] = dot(tap.rows, j, q)
        tap.motion[1, j, k] = dot(tap.rows, j, v)
        tap.motion[2, j, k] = dot(tap.rows, j, a)
    tap.filled[0] = k + 1


class Recorded:
    """What has been recorded, in pieces."""

    def __init__(self, pieces: tuple[Array, ...] = ()) -> None:
        self._pieces = list(pieces)

    def drain(self, tap: Tap | None) -> None:
        """Take over what a tap holds, as rows of time, q, v and a."""
        if tap is None:
            return
        k = int(tap.filled[0])
        if k:
            self._pieces.append(np.vstack([tap.times[None, :k], *tap.motion[:, :, :k]]))
            tap.filled[0] = 0

    def whole(self) -> tuple[Array, ...]:
        """Return all in one piece, or nothing."""
        if len(self._pieces) > 1:
            self._pieces = [np.concatenate(self._pieces, axis=1)]
        return tuple(self._pieces)

    def samples(self, names: tuple[str, ...], until: float) -> ProbeSamples:
        """Return the record up to a time in s."""
        (whole,) = self.whole()
        times = whole[0]
        q, v, a = whole[1:, : np.searchsorted(times, until, side="right")].reshape(3, len(names), -1)
        return ProbeSamples(names, times[: q.shape[1]].copy(), q, v, a)
