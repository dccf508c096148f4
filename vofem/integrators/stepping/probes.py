"""Points whose motion is recorded at every step, however few times the states are stored at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import ProbeRows, ProbeSamples
from vofem.integrators.stepping.checks import ContactWatch
from vofem.integrators.stepping.rows import Rows, compressed, dot
from vofem.linalg.jit import jit
from vofem.system import ContactLaws

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Steps that are taken at most between two looks at the outcome.
MOST_STEPS = 8192


class Tap(NamedTuple):
    """What compiled loops fill: times, and (q, v, a) of points, shape (3, n_points, room); `filled` columns are in."""

    rows: Rows
    times: Array
    motion: Array
    filled: IntArray


def tap(probes: ProbeRows | None, order: IntArray, steps: int, contacts: ContactLaws | None = None) -> Tap:
    """Return a tap for points, and after them for contacts, and unknowns taken in the given order.

    Parameters
    ----------
    probes : ProbeRows, optional
    order : ndarray of int, shape (n,)
    steps : int
        Between two looks at the outcome, at most.
    contacts : ContactLaws, optional
    """
    parts = [part.rows for part in (probes, contacts) if part is not None]
    rows, room = None, 0
    if parts:
        from scipy.sparse import vstack

        rows, room = vstack(parts, format="csr"), 2 + steps
    motion = np.empty((3, 0 if rows is None else rows.shape[0], room))
    return Tap(compressed(rows, order), np.empty(room), motion, np.zeros(1, dtype=np.int64))


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
    """What has been recorded: of points, which come first on a tap, in pieces; contacts are only looked at."""

    def __init__(self, points: int, contacts: ContactWatch | None) -> None:
        self._points, self._contacts = points, contacts
        self._pieces: list[Array] = []

    def go_on(self, pieces: tuple[Array, ...]) -> None:
        """Take over what has been recorded before."""
        self._pieces = list(pieces)

    def drain(self, tap: Tap) -> None:
        """Take over what a tap holds, as rows of time, q, v and a."""
        k, n = int(tap.filled[0]), self._points
        if k and n:
            self._pieces.append(np.vstack([tap.times[None, :k], *tap.motion[:, :n, :k]]))
        if k and self._contacts is not None:
            self._contacts.take(tap.times[:k], tap.motion[0, n:, :k], tap.motion[1, n:, :k])
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
