"""Records of hysteretic laws: force, stored energy and loss at wanted times, and energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.record import Record
from vofem.kernels.jit import jit
from vofem.laws.evaluate import commit, commit_all, dissipated, force_at, stored
from vofem.laws.rows import Rows, dot
from vofem.laws.table import Laws
from vofem.linalg.vectors import copy

Array = NDArray[np.float64]


@jit
def record_hysteresis(laws: Laws, hysteretic: bool | None, before: Array, rows: Rows, out: Record) -> None:
    """Record the hysteretic laws at the times that the last step has stored.

    Their internal variables at the start of that step are in `before`. `laws` holds those at its end; they are copied
    into `before`.
    """
    if hysteretic is not None:
        _record(Laws(laws.table, laws.parameters, before, laws.kinds), rows, out, out.cursor[1], out.cursor[0])
        copy(laws.state, before)


@jit
def _record(laws: Laws, rows: Rows, out: Record, first: int, cursor: int) -> None:
    """Store force, stored energy and loss of every law with internal variables at the wanted times `first` to `cursor`.

    The internal variables are those at the start of the step in which these times lie.
    """
    for c in range(first, cursor):
        for j in range(laws.table.size):
            if laws.table[j]["end"] > laws.table[j]["start"]:
                u, i = dot(rows, j, out.q[:, c]), laws.table[j]["history"]
                out.histories[0, i, c] = force_at(laws, j, u)
                out.histories[1, i, c] = stored(laws, j, u)
                out.histories[2, i, c] = dissipated(laws, j, u)
    last = cursor - 1
    while last >= first and not out.wanted[last]:
        last -= 1
    if last >= first:
        after = Laws(laws.table, laws.parameters, laws.state.copy(), laws.kinds)
        for j in range(laws.table.size):
            if laws.table[j]["end"] > laws.table[j]["start"]:
                commit(after, j, dot(rows, j, out.q[:, last]))
        for i in range(after.state.size):
            out.past[i, 0] = after.state[i]


@jit
def commit_and_record(laws: Laws, hysteretic: bool | None, u: Array, before: Array, rows: Rows, out: Record) -> None:
    """Record the hysteretic laws over the step to u, and then commit it."""
    if hysteretic is not None:
        _record(Laws(laws.table, laws.parameters, before, laws.kinds), rows, out, out.cursor[1], out.cursor[0])
        commit_all(laws, u)
        copy(laws.state, before)


@jit
def hysteretic_energy(laws: Laws, state: Array, rows: Rows, q: Array) -> tuple[float, float]:
    """Return the energies in J that all laws with internal variables store at q, and that they have dissipated."""
    before = Laws(laws.table, laws.parameters, state, laws.kinds)
    energy, loss = 0.0, 0.0
    for j in range(laws.table.size):
        if laws.table[j]["end"] > laws.table[j]["start"]:
            u = dot(rows, j, q)
            energy += stored(before, j, u)
            loss += dissipated(before, j, u)
    return energy, loss
