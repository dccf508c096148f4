"""Reactions of scalar laws at the end of a step, solved for in the coordinates of the laws.

With the structure's compliance G over the step, ``u = u_free - G R(u)``. All
laws of contacts are monotone, so ``1/2 R'GR + sum psi_j((u_free - G R)_j)`` is
convex. Newton's method with a line search on its derivative therefore finds the
only solution from any start. With one coordinate this is a monotone scalar
equation, which is solved inside a bracket.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.laws.evaluate import closed_share, force_and_tangent, force_at, mean_and_slope, mean_force
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.table import Laws
from vofem.linalg.banded import solve
from vofem.linalg.jit import jit

Array = NDArray[np.float64]

_MOST = 200
_EPS = float(np.finfo(float).eps)

#: Newton steps after which a residual at the rounding level of its own terms is accepted.
_PATIENCE = 30


def compliance(rows: Rows, factored: Array) -> Array:
    """Return ``B A^-1 B'`` of factored A, shape (n_rows, n_rows)."""
    m = rows.start.size - 1
    result = np.zeros((m, m))
    for j in range(m):
        column = np.zeros(factored.shape[1])
        subtract_row(rows, j, -1.0, column)
        solve(factored, column)
        for i in range(m):
            result[i, j] = dot(rows, i, column)
    return 0.5 * (result + result.T)


@jit
def law(laws: Laws, j: int, u0: float, u1: float, mean: bool, rate: float, drag: float) -> tuple[float, float]:
    """Return force and slope of a law at the end of a step.

    Parameters
    ----------
    mean : bool
        The mean force over the path from u0 to u1, or the force at u1.
    rate : float
        Factor in 1/s: the damper's force is its coefficient times this factor times the path ``u1 - u0``.
    drag : float
        A damper's force that does not depend on u1, N.
    """
    one = laws.table[j]
    force, slope = mean_and_slope(laws, j, u0, u1) if mean else force_and_tangent(laws, j, u1)
    if one["damping"] > 0.0:
        damper = one["damping"] * rate
        force += damper * closed_share(laws, j, u0, u1) - drag
        if u1 > one["gap"]:
            slope += damper
    return force, slope


@jit
def only_force(laws: Laws, j: int, u0: float, u1: float, mean: bool, rate: float, drag: float) -> float:
    """Return the force of `law` alone."""
    one = laws.table[j]
    force = mean_force(laws, j, u0, u1) if mean else force_at(laws, j, u1)
    if one["damping"] > 0.0:
        force += one["damping"] * rate * closed_share(laws, j, u0, u1) - drag
    return force


@jit
def _scalar(
    laws: Laws, j: int, compliance: float, free: float, u0: float, mean: bool, rate: float, drag: float, guess: float
) -> tuple[float, float, bool]:
    """Return reaction, coordinate and success for one coordinate."""
    force, slope = law(laws, j, u0, free, mean, rate, drag)
    if force == 0.0:
        return 0.0, free, True
    # The root lies between two coordinates: with no force of the law, and with its force at the free coordinate.
    low, high = min(free, free - compliance * force), max(free, free - compliance * force)
    u = min(max(free - compliance * guess, low), high)
    for _ in range(_MOST):
        force, slope = law(laws, j, u0, u, mean, rate, drag)
        excess = (u - free) + compliance * force
        if excess > 0.0:
            high = u
        else:
            low = u
        if excess == 0.0 or high - low <= _EPS * max(abs(low), abs(high)):
            break
        new = u - excess / (1.0 + compliance * slope)
        # This test comes before the bounds are updated, because u is one of them: a linear law ends at its first step.
        if abs(new - u) <= _EPS * (abs(u) + abs(free)) and abs(excess) <= 4.0 * _EPS * (
            abs(free) + compliance * abs(force)
        ):
            u = new
            break
        u = new if low < new < high else 0.5 * (low + high)
    else:
        return 0.0, u, False
    if compliance * slope > 1.0:
        # Where the law is stiffer than the structure, the equation of balance loses fewer digits than the law does.
        return (free - u) / compliance, u, np.isfinite(u)
    return only_force(laws, j, u0, u, mean, rate, drag), u, np.isfinite(u)


@jit
def _many(
    laws: Laws,
    compliance: Array,
    free: Array,
    u0: Array,
    mean: bool,
    rate: float,
    drag: Array,
    reaction: Array,
    u: Array,
) -> int:
    """Solve for all coordinates; return the number of Newton steps, or -1."""
    m = free.size
    force, slope = np.empty(m), np.empty(m)
    for step in range(_MOST):
        for i in range(m):
            u[i] = free[i]
            for j in range(m):
                if reaction[j] != 0.0:
                    u[i] -= compliance[i, j] * reaction[j]
        active = np.zeros(m, dtype=np.bool_)
        off, size_of = 0.0, 0.0
        for j in range(m):
            force[j], slope[j] = law(laws, j, u0[j], u[j], mean, rate, drag[j])
            if not np.isfinite(force[j]):
                return -1
            active[j] = force[j] != 0.0 or slope[j] != 0.0 or reaction[j] != 0.0
            off, size_of = max(off, abs(force[j] - reaction[j])), max(size_of, abs(force[j]) + abs(reaction[j]))
        index = np.flatnonzero(active)
        size = index.size
        matrix, right = np.eye(size), np.empty(size)
        for a in range(size):
            right[a] = force[index[a]] - reaction[index[a]]
            for b in range(size):
                matrix[a, b] += slope[index[a]] * compliance[index[a], index[b]]
        solution = np.linalg.solve(matrix, right)
        change, move = np.zeros(m), np.zeros(m)
        still, rounded = True, True
        for a in range(size):
            # A law without slope has an exact row; elimination would add the rounding of other rows to it.
            change[index[a]] = right[a] if slope[index[a]] == 0.0 else solution[a]
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        settled = off <= _EPS * 2.0 ** min(step, 22) * size_of
        for i in range(m):
            scale = abs(free[i])
            for a in range(size):
                move[i] -= compliance[i, index[a]] * solution[a]
                scale += abs(compliance[i, index[a]] * reaction[index[a]])
            still = still and abs(move[i]) <= 4.0 * _EPS * scale
            # In a law much stiffer than the structure, the rounding of u may be the largest error of its force.
            noise = 4.0 * _EPS * (abs(force[i]) + abs(reaction[i]) + slope[i] * scale)
            rounded = rounded and abs(force[i] - reaction[i]) <= noise
        settled = settled or still or (rounded and step >= _PATIENCE)
        length = 1.0
        if not settled:
            length = _line_search(laws, u0, u, move, reaction, change, mean, rate, drag)
        for j in range(m):
            reaction[j] += length * change[j]
        if settled:
            return step + 1
    return -1


@jit
def _derivative(
    x: float, laws: Laws, u0: Array, u: Array, move: Array, reaction: Array, change: Array, mean: bool, rate: float,
    drag: Array,
) -> float:  # fmt: skip
    """Return the derivative of the convex function along a direction, up to a positive factor."""
    total = 0.0
    for j in range(u.size):
        force = only_force(laws, j, u0[j], u[j] + x * move[j], mean, rate, drag[j])
        total += move[j] * (force - reaction[j] - x * change[j])
    return total


@jit
def _line_search(
    laws: Laws, u0: Array, u: Array, move: Array, reaction: Array, change: Array, mean: bool, rate: float, drag: Array
) -> float:
    if _derivative(1.0, laws, u0, u, move, reaction, change, mean, rate, drag) <= 0.0:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _derivative(middle, laws, u0, u, move, reaction, change, mean, rate, drag) > 0.0:
            high = middle
        else:
            low = middle
        if high - low <= 1e-3 * low:
            break
    return 0.5 * (low + high)


@jit
def solve_reactions(
    laws: Laws,
    compliance: Array,
    free: Array,
    u0: Array,
    mean: bool,
    rate: float,
    drag: Array,
    reaction: Array,
    u: Array,
) -> int:
    """Find reactions and coordinates at the end of a step.

    Parameters
    ----------
    laws : Laws
    compliance : ndarray, shape (m, m)
    free, u0 : ndarray, shape (m,)
        Coordinates without reactions, and at the start of the step.
    mean : bool
        True: a law acts with its mean force over the step. False: with its force at the end.
    rate : float
        Weight in 1/s of the path in dampers' forces.
    drag : ndarray, shape (m,)
    reaction, u : ndarray, shape (m,)
        Filled; on entry `reaction` holds a guess.

    Returns
    -------
    steps : int
        0 where nothing acts; negative where no solution was found.
    """
    m = free.size
    idle = True
    for j in range(m):
        if only_force(laws, j, u0[j], free[j], mean, rate, drag[j]) != 0.0:
            idle = False
            break
    if idle:
        for j in range(m):
            reaction[j] = 0.0
            u[j] = free[j]
        return 0
    if m == 1:
        # Not a literal 0, for which all laws would be compiled once more.
        j = m - 1
        reaction[0], u[0], found = _scalar(laws, j, compliance[0, 0], free[0], u0[0], mean, rate, drag[0], reaction[0])
        return 1 if found else -1
    # A guess from the last step may lie beyond a jump of the force; coordinates without force start from zero.
    return _many(laws, compliance, free, u0, mean, rate, drag, reaction, u)
