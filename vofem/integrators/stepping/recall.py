"""What laws with memory tell of a run: histories at wanted times, and energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.backbone import Memory
from vofem.integrators.stepping.memory import commit, memory_force, memory_loss, memory_stored
from vofem.integrators.stepping.record import Output
from vofem.integrators.stepping.rows import Rows, dot
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


@jit
def remember(memory: Memory, state: Array, rows: Rows, out: Output, first: int, cursor: int) -> None:
    """Store force, stored energy and loss of every law at the wanted times `first` to `cursor`.

    `state` is that at the start of the step in which these times lie.
    """
    n = memory.table.size
    offset = rows.start.size - 1 - n
    for c in range(first, cursor):
        for i in range(n):
            u = dot(rows, offset + i, out.q[:, c])
            out.memory[0, i, c] = memory_force(memory, state, i, u)[0]
            out.memory[1, i, c] = memory_stored(memory, state, i, u)
            out.memory[2, i, c] = state[memory.table[i]["start"]] + memory_loss(memory, state, i, u)
    last = cursor - 1
    while last >= first and not out.wanted[last]:
        last -= 1
    if last >= first:
        past = state.copy()
        for i in range(n):
            commit(memory, past, i, dot(rows, offset + i, out.q[:, last]))
        out.past[:, 0] = past


@jit
def memory_energy(memory: Memory, state: Array, rows: Rows, q: Array) -> tuple[float, float]:
    """Return the energies in J that all laws hold at q and have dissipated."""
    n = memory.table.size
    stored, lost = 0.0, 0.0
    for i in range(n):
        u = dot(rows, rows.start.size - 1 - n + i, q)
        stored += memory_stored(memory, state, i, u)
        lost += state[memory.table[i]["start"]] + memory_loss(memory, state, i, u)
    return stored, lost


def memory_energy_of(memory: Memory, state: Array, u: Array) -> tuple[Array, Array]:
    """Return the energies in J that each law holds at its elongation and has dissipated before, each (n_laws,)."""
    stored = [memory_stored(memory, state, i, x) for i, x in enumerate(u.tolist())]
    return np.array(stored), state[memory.table["start"]].copy()
