"""Reactions of scalar laws at the end of a step, solved for in the coordinates of the laws.

With the structure's compliance G over the step, ``u = u_free - G R(u)``. All
laws of contacts are monotone, so ``1/2 R'GR + sum psi_j((u_free - G R)_j)`` is
convex. Newton's method with a line search on its derivative therefore finds the
only solution from any start. With one coordinate this is a monotone scalar
equation, which is solved inside a bracket.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.laws.evaluate import closed_share, force_and_tangent, force_at, mean_and_slope, mean_force
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.table import Laws
from vofem.linalg.banded import solve
from vofem.linalg.vectors import copy, fill

Array = NDArray[np.float64]

_MOST = 200
_EPS = float(np.finfo(float).eps)

#: Slope of the convex function at the end of a full step, over that at its start, up to which the step is taken.
_FLAT = 1e-12

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


class Dampers(NamedTuple):
    """How dampers of contacts act over a step.

    Attributes
    ----------
    rate : float
        In 1/s: the force of a damper is its coefficient times this factor times the path ``u1 - u0``.
    offset : ndarray, shape (m,)
        What is subtracted from this force, N.
    """

    rate: float
    offset: Array


class Acting(NamedTuple):
    """How laws act over a step that starts at given coordinates.

    Attributes
    ----------
    laws : Laws
    start : ndarray, shape (m,)
        Coordinates at the start of the step.
    mean : True or None
        True: a law acts by its mean force over the step. None: by its force at the end.
    dampers : Dampers or None
        None where no contact has a damper.
    """

    laws: Laws
    start: Array
    mean: bool | None
    dampers: Dampers | None


@jit
def law(acting: Acting, j: int, u: float) -> tuple[float, float]:
    """Return force and slope of a law over a step that ends at u."""
    force, slope = _force_and_slope(acting.laws, acting.mean, j, acting.start[j], u)
    more, steeper = _damper(acting.laws, acting.dampers, j, acting.start[j], u)
    return force + more, slope + steeper


@jit
def _force_and_slope(laws: Laws, mean: bool | None, j: int, u0: float, u1: float) -> tuple[float, float]:
    if mean is None:
        return force_and_tangent(laws, j, u1)
    return mean_and_slope(laws, j, u0, u1)


@jit
def _damper(laws: Laws, dampers: Dampers | None, j: int, u0: float, u1: float) -> tuple[float, float]:
    """Return force and slope of the damper of a law."""
    if dampers is None:
        return 0.0, 0.0
    one = laws.table[j]
    if one["damping"] <= 0.0:
        return 0.0, 0.0
    coefficient = one["damping"] * dampers.rate
    force = coefficient * closed_share(laws, j, u0, u1) - dampers.offset[j]
    return force, coefficient if u1 > one["gap"] else 0.0


@jit
def only_force(acting: Acting, j: int, u: float) -> float:
    """Return the force of `law` alone."""
    u0 = acting.start[j]
    return _force(acting.laws, acting.mean, j, u0, u) + _damper(acting.laws, acting.dampers, j, u0, u)[0]


@jit
def _force(laws: Laws, mean: bool | None, j: int, u0: float, u1: float) -> float:
    if mean is None:
        return force_at(laws, j, u1)
    return mean_force(laws, j, u0, u1)


class Direction(NamedTuple):
    """A direction in which a convex function of the coordinates is minimised.

    At a fraction y of the way its derivative is ``y curvature - descent + weight sum_j move_j (R_j - known_j - y
    change_j)``, with the forces R of the laws at ``u + y move``.

    Attributes
    ----------
    u, move : ndarray, shape (m,)
        Coordinates at y = 0, and their change up to y = 1.
    known, change : ndarray, shape (m,)
    weight, descent, curvature : float
    """

    u: Array
    move: Array
    known: Array
    change: Array
    weight: float
    descent: float
    curvature: float


@jit
def _derivative(acting: Acting, way: Direction, y: float) -> float:
    """Return the derivative of the convex function at a fraction y of the way."""
    total = y * way.curvature - way.descent
    for j in range(way.u.size):
        if way.move[j] != 0.0:
            there = only_force(acting, j, way.u[j] + y * way.move[j])
            total += way.weight * way.move[j] * (there - way.known[j] - y * way.change[j])
    return total


@jit
def bisect(acting: Acting, way: Direction) -> float:
    """Return the fraction of the way at which the convex function is smallest: 1 where it falls all the way."""
    if _derivative(acting, way, 1.0) <= _FLAT * way.descent:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _derivative(acting, way, middle) > 0.0:
            high = middle
        else:
            low = middle
        if high - low <= 1e-3 * low:
            break
    return 0.5 * (low + high)


@jit
def solve_one(acting: Acting, compliance: float, free: float, guess: float) -> tuple[float, float, bool]:
    """Return reaction, coordinate and success for the only law."""
    # Not a literal 0, for which all laws would be compiled once more.
    j = acting.start.size - 1
    force, slope = law(acting, j, free)
    if force == 0.0:
        return 0.0, free, True
    # The root lies between two coordinates: with no force of the law, and with its force at the free coordinate.
    low, high = min(free, free - compliance * force), max(free, free - compliance * force)
    u = min(max(free - compliance * guess, low), high)
    for _ in range(_MOST):
        force, slope = law(acting, j, u)
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
    return only_force(acting, j, u), u, np.isfinite(u)


@jit
def solve_many(acting: Acting, compliance: Array, free: Array, reaction: Array, u: Array) -> int:
    """Find reactions and coordinates at the end of a step of several laws.

    Parameters
    ----------
    acting : Acting
    compliance : ndarray, shape (m, m)
    free : ndarray, shape (m,)
        Coordinates without reactions.
    reaction, u : ndarray, shape (m,)
        Filled; on entry `reaction` holds a guess.

    Returns
    -------
    steps : int
        Number of Newton steps, 0 where nothing acts; negative where no solution was found.
    """
    m = free.size
    idle = True
    for j in range(m):
        if only_force(acting, j, free[j]) != 0.0:
            idle = False
            break
    if idle:
        fill(reaction, 0.0)
        copy(free, u)
        return 0
    # A guess from the last step may lie beyond a jump of the force; coordinates without force start from zero.
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
            force[j], slope[j] = law(acting, j, u[j])
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
            length = bisect(acting, Direction(u, move, reaction, change, 1.0, 0.0, 0.0))
        for j in range(m):
            reaction[j] += length * change[j]
        if settled:
            return step + 1
    return -1
