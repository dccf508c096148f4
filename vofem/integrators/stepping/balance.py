"""The balance of a step: ``A x = right - weight B'(R(u) - held)``, ``u = base + reach B x``, with reactions R of laws.

There are two ways to solve it. Where laws are few, Newton's method runs on
their coordinates u, through the compliance ``B A^-1 B'``. Where there are about
as many laws as unknowns, that matrix is large and full, but A with the slopes of
all laws added is still a narrow band. Newton's method then runs on x, and its
cost grows with the number of unknowns.
Both ways minimise the same convex function, so both find its only minimum from any start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.contact_solve import compliance, law, only_force, solve_reactions
from vofem.laws.kinds import CALLED, JUMP
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.table import Laws
from vofem.linalg.banded import factor, factor_in_place, solve, subtract_product, widen
from vofem.linalg.jit import jit

Array = NDArray[np.float64]

#: Number of laws from which on the solution in the band is considered.
_FEWEST = 16

_MOST = 200
_EPS = float(np.finfo(float).eps)


class Structure(NamedTuple):
    """The linear structure within a step: how x follows from reactions.

    Attributes
    ----------
    factored : ndarray
        A, factored.
    compliance : ndarray, shape (m, m)
        ``reach weight B A^-1 B'``; of no size where `whole` stands for it.
    whole : ndarray
        The band of A, with room for ``B'B``; no rows where `compliance` stands for it.
    reach, weight : float
    """

    factored: Array
    compliance: Array
    whole: Array
    reach: float
    weight: float


def structure(band: Array, what: str, rows: Rows, laws: Laws, reach: float, weight: float) -> Structure:
    """Return the structure of a matrix A in band storage; `what` names it in errors."""
    factored = factor(band, what)
    width = _row_width(rows)
    if _banded_pays(laws, band.shape[1], max(width, band.shape[0] - 1)):
        whole = widen(band, max(width, band.shape[0] - 1))
        return Structure(factored, np.empty((0, 0)), whole, reach, weight)
    answer = reach * weight * compliance(rows, factored)
    return Structure(factored, answer, np.empty((0, band.shape[1])), reach, weight)


def _row_width(rows: Rows) -> int:
    """Return the largest distance of two columns of one row."""
    parts = [rows.column[a:b] for a, b in zip(rows.start[:-1], rows.start[1:], strict=True) if b > a + 1]
    return max((int(part.max() - part.min()) for part in parts), default=0)


def _banded_pays(laws: Laws, n: int, width: int) -> bool:
    """Return whether a Newton step costs less in the band than through the compliance, half of the laws acting.

    The compliance is always used where a spring softens, because the band may then not be positive definite, and
    where a force jumps, because Newton's method on x then stalls.
    """
    m, kind = laws.table.size, laws.table["kind"]
    suited = not np.any((kind == CALLED) | ((kind == JUMP) & (laws.table["gap"] > 0.0)))
    return suited and m >= _FEWEST and m**3 / 24.0 + 1.5 * m**2 > 8.0 * n * (width + 1.0) ** 2


@jit
def balance(
    laws: Laws, structure: Structure, rows: Rows, right: Array, held: Array, base: Array, u0: Array, mean: bool,
    rate: float, drag: Array, reaction: Array, u: Array, x: Array,
) -> int:  # fmt: skip
    """Find x, the reactions and the coordinates at the end of a step.

    Parameters
    ----------
    laws : Laws
    structure : Structure
    rows : Rows
        B.
    right : ndarray, shape (n,)
    held : ndarray, shape (m,)
        Reactions that `right` holds already.
    base, u0 : ndarray, shape (m,)
        Coordinates at x = 0, and at the start of the step.
    mean, rate, drag
        As in `solve_reactions`.
    reaction, u : ndarray, shape (m,)
        Filled; on entry `reaction` holds a guess.
    x : ndarray, shape (n,)
        Filled.

    Returns
    -------
    steps : int
        0 where nothing acts; negative where no solution was found.
    """
    m = u.size
    free = np.empty(m)
    x[:] = right
    solve(structure.factored, x)
    for j in range(m):
        free[j] = base[j] + structure.reach * dot(rows, j, x)
    if structure.whole.shape[0] > 0:
        idle = True
        for j in range(m):
            u[j] = free[j]
            idle = idle and held[j] == 0.0 and only_force(laws, j, u0[j], free[j], mean, rate, drag[j]) == 0.0
        if idle:
            reaction[:] = 0.0
            return 0
        return _in_band(laws, structure, rows, right, held, base, u0, mean, rate, drag, reaction, u, x)
    for i in range(m):
        for j in range(m):
            if held[j] != 0.0:
                free[i] += structure.compliance[i, j] * held[j]
    found = solve_reactions(laws, structure.compliance, free, u0, mean, rate, drag, reaction, u)
    changed = False
    for j in range(m):
        changed = changed or reaction[j] != held[j]
    if changed:
        x[:] = right
        for j in range(m):
            if reaction[j] != held[j]:
                subtract_row(rows, j, structure.weight * (reaction[j] - held[j]), x)
        solve(structure.factored, x)
    return found


@jit
def _in_band(
    laws: Laws, structure: Structure, rows: Rows, right: Array, held: Array, base: Array, u0: Array, mean: bool,
    rate: float, drag: Array, reaction: Array, u: Array, x: Array,
) -> int:  # fmt: skip
    """Find x, u and the reactions by Newton's method on x; return the number of its steps, or -1.

    Reactions are extrapolated along the laws' tangents. They balance the
    structure to the last digit, also where a law is so steep that the rounding
    of u changes its force.
    """
    n, m, reach, weight = x.size, u.size, structure.reach, structure.weight
    force, slope, turn = np.empty(m), np.empty(m), np.empty(m)
    band, move, product = np.empty(structure.whole.shape), np.empty(n), np.empty(n)
    x[:] = 0.0
    whole_step = False
    for step in range(_MOST):
        off, size = 0.0, 0.0
        for j in range(m):
            u[j] = base[j] + reach * dot(rows, j, x)
            force[j], slope[j] = law(laws, j, u0[j], u[j], mean, rate, drag[j])
            if not np.isfinite(force[j]):
                return -1
            off, size = max(off, abs(force[j] - reaction[j])), max(size, abs(force[j]) + abs(reaction[j]))
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        demand = _EPS * 2.0 ** min(step, 22)
        if whole_step and off <= demand * size:
            return step
        band[:] = structure.whole
        move[:] = right
        subtract_product(structure.whole, x, move)
        for j in range(m):
            if force[j] != held[j]:
                subtract_row(rows, j, weight * (force[j] - held[j]), move)
            if slope[j] != 0.0:
                _add_square(rows, j, weight * reach * slope[j], band)
        downhill = 0.0
        product[:] = move
        if factor_in_place(band) >= 0:
            return -1
        solve(band, move)
        for i in range(n):
            downhill += move[i] * product[i]
        still = True
        for j in range(m):
            turn[j] = reach * dot(rows, j, move)
            still = still and abs(turn[j]) <= demand * (abs(base[j]) + abs(u[j] - base[j]))
        length = 1.0
        if not still:
            product[:] = 0.0
            subtract_product(structure.whole, move, product)
            stiff = 0.0
            for i in range(n):
                stiff -= move[i] * product[i]
            length = _line_search(laws, u0, u, turn, force, weight / reach, downhill, stiff, mean, rate, drag)
        for i in range(n):
            x[i] += length * move[i]
        for j in range(m):
            reaction[j] = force[j] + slope[j] * (length * turn[j])
        whole_step = length == 1.0
        if still:
            for j in range(m):
                u[j] = base[j] + reach * dot(rows, j, x)
            return step + 1
    return -1


@jit
def _add_square(rows: Rows, j: int, factor: float, band: Array) -> None:
    """Add a multiple of ``b b'`` of row j."""
    for e in range(rows.start[j], rows.start[j + 1]):
        for f in range(rows.start[j], rows.start[j + 1]):
            below = rows.column[e] - rows.column[f]
            if below >= 0:
                band[below, rows.column[f]] += factor * rows.weight[e] * rows.weight[f]


@jit
def _uphill(
    y: float, laws: Laws, u0: Array, u: Array, turn: Array, force: Array, ratio: float, downhill: float, stiff: float,
    mean: bool, rate: float, drag: Array,
) -> float:  # fmt: skip
    """Return the derivative of the convex function at a fraction y of a step."""
    total = y * stiff - downhill
    for j in range(u.size):
        if turn[j] != 0.0:
            there = only_force(laws, j, u0[j], u[j] + y * turn[j], mean, rate, drag[j])
            total += ratio * turn[j] * (there - force[j])
    return total


@jit
def _line_search(
    laws: Laws, u0: Array, u: Array, turn: Array, force: Array, ratio: float, downhill: float, stiff: float,
    mean: bool, rate: float, drag: Array,
) -> float:  # fmt: skip
    if _uphill(1.0, laws, u0, u, turn, force, ratio, downhill, stiff, mean, rate, drag) <= 1e-12 * downhill:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _uphill(middle, laws, u0, u, turn, force, ratio, downhill, stiff, mean, rate, drag) > 0.0:
            high = middle
        else:
            low = middle
        if high - low <= 1e-3 * low:
            break
    return 0.5 * (low + high)
