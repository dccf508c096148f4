"""Records of laws with internal variables: force, stored energy and loss at wanted times, and energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.record import Output
from vofem.laws.evaluate import commit, force_at, lost, stored
from vofem.laws.rows import Rows, dot
from vofem.laws.springpot import BEFORE, FORCE, HELD, WORK, History
from vofem.laws.table import Laws
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


@jit
def remember(laws: Laws, state: Array, rows: Rows, out: Output, first: int, cursor: int) -> None:
    """Store force, stored energy and loss of every law with internal variables at the wanted times `first` to `cursor`.

    `state` holds the internal variables at the start of the step in which these times lie.
    """
    before = Laws(laws.table, laws.parameters, state)
    for c in range(first, cursor):
        for j in range(laws.table.size):
            if laws.table[j]["end"] > laws.table[j]["start"]:
                u, i = dot(rows, j, out.q[:, c]), laws.table[j]["history"]
                out.memory[0, i, c] = force_at(before, j, u)
                out.memory[1, i, c] = stored(before, j, u)
                out.memory[2, i, c] = lost(before, j, u)
    last = cursor - 1
    while last >= first and not out.wanted[last]:
        last -= 1
    if last >= first:
        after = Laws(laws.table, laws.parameters, state.copy())
        for j in range(laws.table.size):
            if laws.table[j]["end"] > laws.table[j]["start"]:
                commit(after, j, dot(rows, j, out.q[:, last]))
        out.past[:, 0] = after.state


@jit
def memory_energy(laws: Laws, state: Array, rows: Rows, q: Array) -> tuple[float, float]:
    """Return the energies in J that all laws with internal variables hold at q and have dissipated."""
    before = Laws(laws.table, laws.parameters, state)
    held, gone = 0.0, 0.0
    for j in range(laws.table.size):
        if laws.table[j]["end"] > laws.table[j]["start"]:
            u = dot(rows, j, q)
            held += stored(before, j, u)
            gone += lost(before, j, u)
    return held, gone


@jit
def tell_histories(history: History, out: Output, first: int, cursor: int, t: float, dt: float) -> None:
    """Record the springpots at the wanted times `first` to `cursor`, to t, the end of a step of size dt.

    They are the last laws in `out.memory`. Values between both ends of the step are interpolated.
    """
    n, told = history.told.shape[0], history.told
    row = out.memory.shape[1] - n
    for c in range(first, cursor):
        x = min(max(1.0 - (t - out.times[c]) / dt, 0.0), 1.0)
        for i in range(n):
            force = (1.0 - x) * told[i, BEFORE + FORCE] + x * told[i, FORCE]
            held = (1.0 - x) * told[i, BEFORE + HELD] + x * told[i, HELD]
            work = (1.0 - x) * told[i, BEFORE + WORK] + x * told[i, WORK]
            out.memory[0, row + i, c] = force
            out.memory[1, row + i, c] = held
            out.memory[2, row + i, c] = work - held
    for i in range(n):
        for what in (FORCE, HELD, WORK):
            told[i, BEFORE + what] = told[i, what]


def absorbed(history: History) -> float:
    """Return the work in J that all springpots have absorbed up to the time to which results are stored."""
    return float(np.sum(history.told[:, BEFORE + WORK]))
