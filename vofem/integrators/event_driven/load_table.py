"""The loads of a run as tables: their closed forms in every interval between two breakpoints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.time_functions import TimeFunction

Array = NDArray[np.float64]

#: Numbers that a table may hold.
_MOST_NUMBERS = 20_000_000


class LoadTable(NamedTuple):
    """Functions of time, each ``constant + slope tau + sum Re(amplitude exp(i omega tau))`` in every interval.

    Attributes
    ----------
    edges : ndarray, shape (k + 1,)
        Ends of the intervals in s; tau is counted from the begin of an interval.
    constant, slope : ndarray, shape (k, n_functions)
    counts : ndarray of int, shape (k,)
        Number of frequencies in an interval.
    omega : ndarray, shape (k, n_h)
        Frequencies in rad/s, the first `counts[i]` of row i.
    amplitude : ndarray of complex, shape (k, n_functions, n_h)
    """

    edges: Array
    constant: Array
    slope: Array
    counts: NDArray[np.int64]
    omega: Array
    amplitude: NDArray[np.complex128]


def load_table(functions: Sequence[TimeFunction], edges: Array) -> LoadTable | None:
    """Return the tables of some functions of time; None where they would be too large.

    Parameters
    ----------
    functions : sequence of TimeFunction
        Functions with closed forms.
    edges : ndarray, shape (k + 1,)
        Increasing times in s with all breakpoints in between.
    """
    begin = np.asarray(edges[:-1], dtype=float)
    k, n = begin.size, len(functions)
    constant, slope = np.zeros((k, n)), np.zeros((k, n))
    waves: list[dict[float, Array]] = [{} for _ in range(k)]
    for f, function in enumerate(functions):
        lines = function.lines(begin)
        if lines is not None:
            constant[:, f], slope[:, f] = lines
            continue
        for i, t in enumerate(begin.tolist()):
            piece = function.piece(t)
            constant[i, f], slope[i, f] = piece.constant, piece.slope
            for w, wave in piece.harmonics:
                waves[i].setdefault(w, np.zeros(n, dtype=complex))[f] += wave
    count = np.array([len(found) for found in waves], dtype=np.int64)
    most = int(count.max(initial=0))
    if k * n * (most + 2) > _MOST_NUMBERS:
        return None
    omega, amplitude = np.zeros((k, most)), np.zeros((k, n, most), dtype=complex)
    for i in np.flatnonzero(count).tolist():
        for h, (w, both) in enumerate(waves[i].items()):
            omega[i, h], amplitude[i, :, h] = w, both
    return LoadTable(np.array(edges, dtype=float), constant, slope, count, omega, amplitude)
