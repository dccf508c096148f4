"""The balance of a step, ``A x = right - per_reaction B'(R(u) - held)`` with the reactions R of laws.

The coordinates of the laws are ``u = base + per_x B x``.

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

from vofem.integrators.stepping.contact_solve import (
    Acting,
    Direction,
    bisect,
    compliance,
    law,
    only_force,
    solve_many,
    solve_one,
)
from vofem.kernels.jit import jit
from vofem.laws.evaluate import rising
from vofem.laws.kinds import FEWEST_IN_BAND
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.table import Laws
from vofem.linalg.banded import factor, factor_in_place, solve, subtract_product, widen
from vofem.linalg.vectors import copy, fill

Array = NDArray[np.float64]

_MOST = 200

#: Effects of single laws over their sum from which on the sum is too inexact, and largest number of corrections then.
_CANCELLED = 1e4
_CORRECTIONS = 4

_EPS = float(np.finfo(float).eps)


class Structure(NamedTuple):
    """The linear structure within a step: how x follows from reactions.

    One of `alone`, `compliance` and `band` is there, and the others are None; where there are no laws, all are None.

    Attributes
    ----------
    factored : ndarray
        A, factored.
    alone : ndarray or None, shape (1, 1)
        The compliance of the only law: ``per_x per_reaction b A^-1 b'``.
    compliance : ndarray or None, shape (m, m)
        ``per_x per_reaction B A^-1 B'``.
    band : ndarray or None
        The band of A, with room for ``B'B``.
    per_x, per_reaction : float
        Factors of x in the coordinates of the laws, and of the reactions in the equation of x.
    """

    factored: Array
    alone: Array | None
    compliance: Array | None
    band: Array | None
    per_x: float
    per_reaction: float


class Guess(NamedTuple):
    """The unknowns of a step: reactions (m,), which hold a first guess on entry, coordinates u (m,) and x (n,).

    `free`, shape (m,), is work space: the coordinates without reactions.
    """

    reaction: Array
    u: Array
    x: Array
    free: Array


class Known(NamedTuple):
    """The right-hand side of a step.

    Attributes
    ----------
    right : ndarray, shape (n,)
    held : ndarray, shape (m,)
        Reactions that `right` holds already.
    base : ndarray, shape (m,)
        Coordinates at x = 0.
    """

    right: Array
    held: Array
    base: Array


def structure(band: Array, what: str, rows: Rows, laws: Laws, per_x: float, per_reaction: float) -> Structure:
    """Return the structure of a matrix A in band storage; `what` names it in errors."""
    factored, m = factor(band, what), laws.table.size
    width = max(_row_width(rows), band.shape[0] - 1)
    if m == 0:
        return Structure(factored, None, None, None, per_x, per_reaction)
    if _banded_pays(laws, band.shape[1], width):
        return Structure(factored, None, None, widen(band, width), per_x, per_reaction)
    answer = per_x * per_reaction * compliance(rows, factored)
    if m == 1:
        return Structure(factored, answer, None, None, per_x, per_reaction)
    return Structure(factored, None, answer, None, per_x, per_reaction)


def _row_width(rows: Rows) -> int:
    """Return the largest distance of two columns of one row."""
    parts = [rows.column[a:b] for a, b in zip(rows.start[:-1], rows.start[1:], strict=True) if b > a + 1]
    return max((int(part.max() - part.min()) for part in parts), default=0)


def _banded_pays(laws: Laws, n: int, width: int) -> bool:
    """Return whether a Newton step costs less in the band than through the compliance, half of the laws acting.

    The compliance is always used where a spring softens, because the band may then not be positive definite, and
    where a force jumps, because Newton's method on x then stalls.
    """
    m = laws.table.size
    return rising(laws) and m >= FEWEST_IN_BAND and m**3 / 24.0 + 1.5 * m**2 > 8.0 * n * (width + 1.0) ** 2


@jit
def balance(acting: Acting, structure: Structure, rows: Rows, known: Known, guess: Guess) -> int:
    """Find x, the reactions and the coordinates at the end of a step.

    Parameters
    ----------
    acting : Acting
    structure : Structure
    rows : Rows
        B.
    known : Known
    guess : Guess
        Filled.

    Returns
    -------
    steps : int
        0 where nothing acts; negative where no solution was found.
    """
    x, free = guess.x, guess.free
    copy(known.right, x)
    solve(structure.factored, x)
    for j in range(free.size):
        free[j] = known.base[j] + structure.per_x * dot(rows, j, x)
    return _find(structure.alone, structure.compliance, structure.band, acting, structure, rows, known, free, guess)


@jit
def _find(
    alone: Array | None, many: Array | None, band: Array | None, acting: Acting, structure: Structure, rows: Rows,
    known: Known, free: Array, guess: Guess,
) -> int:  # fmt: skip
    """Find the reactions in one of three ways, of which numba compiles the one whose matrix is not None."""
    if band is not None:
        return _in_band(band, acting, structure, rows, known, free, guess)
    if alone is not None:
        free[0] += alone[0, 0] * known.held[0]
        reaction, u, solved = solve_one(acting, alone[0, 0], free[0], guess.reaction[0])
        guess.reaction[0], guess.u[0] = reaction, u
        if reaction != known.held[0]:
            _answer(structure, rows, known, guess)
        if not solved:
            return -1
        return 1 if reaction != 0.0 else 0
    if many is not None:
        for i in range(free.size):
            for j in range(free.size):
                if known.held[j] != 0.0:
                    free[i] += many[i, j] * known.held[j]
        found = solve_many(acting, many, free, guess.reaction, guess.u)
        for j in range(free.size):
            if guess.reaction[j] != known.held[j]:
                _answer(structure, rows, known, guess)
                break
        if found > 0 and _cancel(many, guess):
            _correct(acting, many, structure, rows, known, guess)
        return found
    return 0


@jit
def _cancel(compliance: Array, guess: Guess) -> bool:
    """Return whether laws work against each other with forces whose single effects are far larger than their sum."""
    for i in range(guess.u.size):
        size = 0.0
        for j in range(guess.u.size):
            size += abs(compliance[i, j] * guess.reaction[j])
        if size > _CANCELLED * abs(guess.u[i]):
            return True
    return False


@jit
def _correct(acting: Acting, compliance: Array, structure: Structure, rows: Rows, known: Known, guess: Guess) -> None:
    """Improve x, u and the reactions of laws that work against each other.

    The sum of large effects that cancel is rounded by as much as one of them is. Therefore small corrections of the
    reactions are found from coordinates that follow from x, and are kept apart from the reactions until the end.
    """
    reaction, u, x, m = guess.reaction, guess.u, guess.x, guess.u.size
    low, right, move = np.zeros(m), np.empty(m), np.empty(x.size)
    least = np.inf
    for _ in range(_CORRECTIONS):
        matrix, off = np.eye(m), 0.0
        for i in range(m):
            u[i] = known.base[i] + structure.per_x * dot(rows, i, x)
            force, slope = law(acting, i, u[i])
            right[i] = (force - reaction[i]) - low[i]
            off = max(off, abs(right[i]))
            for j in range(m):
                matrix[i, j] += slope * compliance[i, j]
        if not off < 0.5 * least:
            break
        least = off
        change = np.linalg.solve(matrix, right)
        fill(move, 0.0)
        for j in range(m):
            low[j] += change[j]
            subtract_row(rows, j, structure.per_reaction * change[j], move)
        solve(structure.factored, move)
        for i in range(x.size):
            x[i] += move[i]
    for j in range(m):
        reaction[j] += low[j]
        u[j] = known.base[j] + structure.per_x * dot(rows, j, x)


@jit
def _answer(structure: Structure, rows: Rows, known: Known, guess: Guess) -> None:
    """Enter into x the solution for given reactions."""
    copy(known.right, guess.x)
    for j in range(guess.reaction.size):
        if guess.reaction[j] != known.held[j]:
            subtract_row(rows, j, structure.per_reaction * (guess.reaction[j] - known.held[j]), guess.x)
    solve(structure.factored, guess.x)


@jit
def _in_band(
    matrix: Array, acting: Acting, structure: Structure, rows: Rows, known: Known, free: Array, guess: Guess
) -> int:
    """Find x, u and the reactions by Newton's method on x; return the number of its steps, or -1.

    Reactions are extrapolated along the laws' tangents. They balance the
    structure to the last digit, also where a law is so steep that the rounding
    of u changes its force.
    """
    reaction, u, x = guess.reaction, guess.u, guess.x
    n, m, per_x, per_reaction = x.size, u.size, structure.per_x, structure.per_reaction
    idle = True
    for j in range(m):
        u[j] = free[j]
        idle = idle and known.held[j] == 0.0 and only_force(acting, j, free[j]) == 0.0
    if idle:
        fill(reaction, 0.0)
        return 0
    force, slope, turn, none = np.empty(m), np.empty(m), np.empty(m), np.zeros(m)
    band, move, product = np.empty_like(matrix), np.empty(n), np.empty(n)
    fill(x, 0.0)
    whole_step = False
    for step in range(_MOST):
        off, size = 0.0, 0.0
        for j in range(m):
            u[j] = known.base[j] + per_x * dot(rows, j, x)
            force[j], slope[j] = law(acting, j, u[j])
            if not np.isfinite(force[j]):
                return -1
            off, size = max(off, abs(force[j] - reaction[j])), max(size, abs(force[j]) + abs(reaction[j]))
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        demand = _EPS * 2.0 ** min(step, 22)
        if whole_step and off <= demand * size:
            return step
        for a in range(band.shape[0]):
            copy(matrix[a], band[a])
        copy(known.right, move)
        subtract_product(matrix, x, move)
        for j in range(m):
            if force[j] != known.held[j]:
                subtract_row(rows, j, per_reaction * (force[j] - known.held[j]), move)
            if slope[j] != 0.0:
                _add_square(rows, j, per_reaction * per_x * slope[j], band)
        copy(move, product)
        if factor_in_place(band) >= 0:
            return -1
        solve(band, move)
        downhill = 0.0
        for i in range(n):
            downhill += move[i] * product[i]
        still = True
        for j in range(m):
            turn[j] = per_x * dot(rows, j, move)
            still = still and abs(turn[j]) <= demand * (abs(known.base[j]) + abs(u[j] - known.base[j]))
        length = 1.0
        if not still:
            fill(product, 0.0)
            subtract_product(matrix, move, product)
            stiff = 0.0
            for i in range(n):
                stiff -= move[i] * product[i]
            length = bisect(acting, Direction(u, turn, force, none, per_reaction / per_x, downhill, stiff))
        for i in range(n):
            x[i] += length * move[i]
        for j in range(m):
            reaction[j] = force[j] + slope[j] * (length * turn[j])
        whole_step = length == 1.0
        if still:
            for j in range(m):
                u[j] = known.base[j] + per_x * dot(rows, j, x)
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
