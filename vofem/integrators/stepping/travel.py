"""Steps of the midpoint rule where laws act at points that travel, or hold a mass at such a point.

A row b that travels takes part in two ways. The coordinate of a law at the end of a step is ``u_1 = b_1.q_1 + g_1``,
and its mean force R acts along the mean row ``(b_0 + b_1)/2``. As

    u_1 - u_0 = (b_0 + b_1)/2 . (q_1 - q_0) + (b_1 - b_0).(q_0 + q_1)/2 + g_1 - g_0,

the energy of the law grows by the work that the structure does, and by that of what moves the point, without an error.
A tie has the condition ``u_1 = 0`` in place of a law.

The rows change from step to step, so these steps are Python and no compiled loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.kernel import Chunk
from vofem.laws import LawGroup
from vofem.laws.law import DAMPING, FORCE, MEAN, STORED, TANGENT, Laws, ask
from vofem.laws.moving import Moving
from vofem.system import System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]

_MOST, _EPS = 100, float(np.finfo(float).eps)


class Travel(NamedTuple):
    """What moves the laws of a system, unknowns in band order.

    Attributes
    ----------
    rest : ndarray, shape (m, n)
        The part of the rows that does not travel.
    groups : tuple of (int, Moving)
        Numbers of the first laws of groups, and what moves the laws of these groups.
    tied : ndarray of bool, shape (m,)
    away : ndarray, shape (m,)
        Coordinates of laws that find nothing.
    dissipating : ndarray of int
        Numbers of the laws whose dampers are counted.
    """

    rest: Array
    groups: tuple[tuple[int, Moving], ...]
    tied: NDArray[np.bool_]
    away: Array
    dissipating: NDArray[np.int64]

    def rows(self, times: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return rows (k, m, n), offsets (k, m) and whether laws find anything (k, m), at times."""
        rows = np.repeat(self.rest[None], times.size, axis=0)
        offsets, present = np.zeros((times.size, self.rest.shape[0])), np.ones((times.size, self.rest.shape[0]), bool)
        for first, moving in self.groups:
            offsets[:, first : first + moving.weights.shape[0]] += moving.at(times).T
            for law, rider in moving.riders.items():
                j = first + law
                rows[:, j] += rider.rows(times).toarray()
                there = rider.present(times)
                offsets[:, j] += np.where(there, rider.road(times), 0.0)
                # A tie goes on at the level of the supports.
                present[:, j] = there | self.tied[j]
        return rows, offsets, present


def travel_of(groups: tuple[LawGroup, ...], rest: Array, order: NDArray[np.int64]) -> Travel:
    """Return what moves the laws of some groups, whose rows at rest are given, shape (m, n)."""
    parts, first = [], 0
    for group in groups:
        if group.moving is not None:
            parts.append((first, group.moving.ordered(order)))
        first += len(group)
    counted = [np.full(len(group), not group.recorded) for group in groups]
    tied, away = (np.concatenate(part) for part in zip(*((g.tied, g.away) for g in groups), strict=True))
    return Travel(rest, tuple(parts), tied, away, np.flatnonzero(np.concatenate(counted)))


def begin_ties(travel: Travel, q: Array, v: Array) -> None:
    """Put masses that travel on the beam, and let them move with it, at t = 0; q and v are changed."""
    now = np.zeros(1)
    for first, moving in travel.groups:
        for law, rider in moving.riders.items():
            j = first + law
            if travel.tied[j]:
                own = int(np.flatnonzero(travel.rest[j])[0])
                row, rate = rider.rows(now), rider.rates(now)
                q[own] = float((row @ q)[0])
                v[own] = float((row @ v)[0] + (rate @ q)[0])


class Midpoint(NamedTuple):
    """The matrices of steps of one size, unknowns in band order.

    Attributes
    ----------
    dt : float
        In s.
    mass, stiffness : csr_matrix
    damping : csr_matrix or None
    solve : callable
        Solves with ``M + dt C/2 + dt^2 K/4``.
    """

    dt: float
    mass: csr_matrix
    stiffness: csr_matrix
    damping: csr_matrix | None
    solve: Callable[[Array], Array]


def midpoint(system: System, damping: Any, order: NDArray[np.int64], dt: float) -> Midpoint:
    """Return the matrices of steps of a size in s."""
    from scipy.sparse.linalg import splu

    mass, stiffness = (matrix.tocsr()[order][:, order].tocsr() for matrix in (system.mass, system.stiffness))
    whole = mass + (0.25 * dt**2) * stiffness
    if damping is not None:
        damping = damping.tocsr()[order][:, order].tocsr()
        whole = whole + (0.5 * dt) * damping
    return Midpoint(dt, mass, stiffness, damping, splu(whole.tocsc()).solve)


def advance_travelling(
    travel: Travel, matrices: Midpoint, laws: Laws, times: Array, force: Array, shift: Array, earlier: Array,
    chunk: Chunk,
) -> tuple[int, int, Array]:  # fmt: skip
    """Take the steps that a chunk has rows for.

    Parameters
    ----------
    travel : Travel
    matrices : Midpoint
    laws : Laws
    times : ndarray, shape (steps + 1,)
        Ends of the steps, s.
    force, shift, earlier, chunk
        See `kernel.advance`.

    Returns
    -------
    taken, solves : int
        See `kernel.advance`.
    driven : ndarray, shape (steps,)
        Work over the steps of what moves points and stops, J. What a law stores when its point leaves the beam is lost
        to it.
    """
    (dt, mass, stiffness, damping, inverse), steps = matrices, times.size - 1
    half, (rows, offsets, present) = 0.5 * dt, travel.rows(times)
    driven, solves = np.zeros(steps), 0
    for k in range(steps):
        q0, v0, u0 = chunk.q[k], chunk.v[k], chunk.u[k]
        mean = 0.5 * (rows[k] + rows[k + 1])
        acts = present[k] & present[k + 1]
        answers = inverse(mean.T).T
        reach = (dt * half) * (rows[k + 1] @ answers.T)
        p = v0 + half * (earlier if k == 0 else chunk.a[k - 1])
        held = np.zeros(u0.size)
        # The second time corrects errors of the factored matrix.
        for _ in range(2):
            way = (p - v0) / half
            if shift.shape[0]:
                way = way + shift[k] / half
            right = -(stiffness @ (q0 + half * p)) - mass @ way - held @ mean
            if force.shape[0]:
                right += force[k]
            if damping is not None:
                right -= damping @ p
            right = inverse(right)
            free = rows[k + 1] @ (q0 + dt * (p + half * right)) + offsets[k + 1]
            found = _reactions(laws, travel, acts, dt, u0, free, reach, held)
            if found is None:
                return k, solves, driven
            p = p + half * (right - (found - held) @ answers)
            held = found
        solves += int(np.any(held != 0.0))
        q1, v1 = chunk.q[k + 1], chunk.v[k + 1]
        q1[:] = q0 + dt * p
        v1[:] = 2.0 * (p + shift[k] if shift.shape[0] else p) - v0
        chunk.a[k + 1] = (v1 - v0) / dt
        u1 = np.where(present[k + 1], rows[k + 1] @ q1 + offsets[k + 1], travel.away)
        chunk.u[k + 1], chunk.reaction[k + 1] = u1, held
        for j in np.flatnonzero(laws.table[:, 3]).tolist():
            damper = ask(laws, j, DAMPING, float(u0[j]), float(u1[j])) * ((u1[j] - u0[j]) / dt)
            chunk.damper[k + 1, j] = damper if acts[j] else 0.0
        driven[k] = float(held @ np.where(acts, u1 - u0 - mean @ (q1 - q0), 0.0))
        for j in np.flatnonzero(present[k] ^ present[k + 1]).tolist():
            driven[k] += ask(laws, j, STORED, float(u1[j]), float(u1[j])) - ask(
                laws, j, STORED, float(u0[j]), float(u0[j])
            )
    return steps, solves, driven


def _reactions(
    laws: Laws, travel: Travel, acts: NDArray[np.bool_], dt: float, u0: Array, free: Array, reach: Array, held: Array
) -> Array | None:  # fmt: skip
    """Return the mean forces of the laws over a step, shape (m,); None where there is no solution.

    Parameters
    ----------
    acts : ndarray of bool, shape (m,)
        Laws that find something at both ends of the step.
    u0, free : ndarray, shape (m,)
        Coordinates at the start, and at the end under the forces `held`.
    reach : ndarray, shape (m, m)
        Fall of the coordinates at the end by unit forces.
    """
    found = held.copy()
    active = np.flatnonzero(acts)
    if not active.size:
        return found * 0.0
    tie, own = travel.tied[active], reach[np.ix_(active, active)]

    def unbalance(forces: Array) -> tuple[Array, Array, Array]:
        trial = found.copy()
        trial[active] = forces
        u = free - reach @ (trial - held)
        force, slope = np.zeros(active.size), np.zeros(active.size)
        for i, j in enumerate(active.tolist()):
            if not travel.tied[j]:
                force[i], slope[i] = law_force(laws, j, dt, float(u0[j]), float(u[j]))
        off = np.where(tie, u[active], force - forces)
        scale = np.where(tie, np.abs(free[active]) + np.abs(own) @ np.abs(forces), np.abs(force) + np.abs(forces))
        return off, scale, np.where(tie[:, None], own, np.eye(active.size) + slope[:, None] * own)

    forces = balanced(unbalance, found[active])
    if forces is None:
        return None
    found[active] = forces
    return found


def balanced(unbalance: Callable[[Array], tuple[Array, Array, Array]], forces: Array) -> Array | None:
    """Return the forces at which nothing is out of balance, shape (n,), by Newton's method; None where there are none.

    Parameters
    ----------
    unbalance : callable
        Returns what is out of balance under some forces, (n,), its size without cancellation, (n,), and the matrix
        that turns it into a change of the forces, (n, n).
    forces : ndarray, shape (n,)
        A guess.
    """
    trial = best = forces
    step: Array = np.zeros_like(forces)
    smallest = np.inf
    for iteration in range(_MOST):
        off, scale, matrix = unbalance(trial)
        if not np.all(np.isfinite(off)):
            return None
        size = float(np.max(np.abs(off) / np.where(scale > 0.0, scale, 1.0)))
        if size <= 4.0 * _EPS * 2.0 ** min(iteration, 12):
            return trial
        if size >= smallest and iteration % 8:
            step = 0.5 * step
        else:
            smallest, best = min(size, smallest), trial
            step = np.asarray(np.linalg.solve(matrix, off), dtype=np.float64)
        trial = best + step
    return None


def law_force(laws: Laws, j: int, dt: float, u0: float, u1: float) -> tuple[float, float]:
    """Return the mean force of law j on its path over a step, and its derivative by u1."""
    force, way = ask(laws, j, MEAN, u0, u1), u1 - u0
    slope = (ask(laws, j, FORCE, u1, u1) - force) / way if way else 0.5 * ask(laws, j, TANGENT, u1, u1)
    if laws.table[j, 3]:
        damping = ask(laws, j, DAMPING, u0, u1)
        force += damping * (way / dt)
        slope += ask(laws, j, DAMPING, u1, u1) / dt
    return force, slope
