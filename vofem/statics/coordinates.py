"""The linear equations of equilibrium in the coordinates of scalar laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.system import System

#: Difference of forces, over the terms that make them up, below which it is rounding.
_ROUNDING = 64.0 * float(np.finfo(float).eps)

#: Singular values, over the largest, below which rows of contacts that are held depend on each other.
_DEPENDENT = 1e-13


def alike(rows: Any) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
    """Return which sparse rows are equal but for their sign.

    Returns `member` (shape (m,)): number of the group to which every row belongs.
    Returns `sign` (shape (m,)): 1 or -1: every row over the first one of its group.
    Returns `first` (shape (g,)): the first row of every group.
    """
    seen: dict[tuple[bytes, bytes], int] = {}
    member, sign = np.empty(rows.shape[0], dtype=np.int64), np.ones(rows.shape[0])
    first: list[int] = []
    for j in range(rows.shape[0]):
        row = rows[j].sorted_indices()
        places = row.indices.tobytes()
        for factor in (1.0, -1.0):
            group = seen.get((places, (factor * row.data).tobytes()))
            if group is not None:
                member[j], sign[j] = group, factor
                break
        else:
            member[j] = seen[places, row.data.tobytes()] = len(first)
            first.append(j)
    return member, sign, np.array(first, dtype=np.int64)


class Coordinates:
    """Coordinates u of m laws under their forces R and a multiple of a load.

        u = factor u_f - G R + D a,    D' R = factor r' f

    r are the rigid motions of what is loose without laws, ``D = B r``, a their
    amplitudes, and G the compliance with these taken out.

    Laws at one point have one coordinate, and the sum of their forces is one unknown: where stops are
    steep, rounding would otherwise set equal coordinates apart by more than their penetrations.

    `rows` (shape (m, n)): B.
    `force` has shape (n,).
    `solve`: it solves with K, for shapes (n,) and (n, k).
    """

    def __init__(self, system: System, rows: Any, force: Array, solve: Callable[[Array], Array]) -> None:
        self._member, self._sign, first = alike(rows)
        self._rows = rows[first]
        self._columns = np.reshape(solve(self._rows.T.toarray()), (force.size, -1))
        self._compliance = np.asarray(self._rows @ self._columns)
        self._load = solve(force)
        self._rigid = system.rigid
        self._free = np.asarray(self._rows @ self._load)
        self._moves = np.asarray(self._rows @ self._rigid)
        self._push = self._rigid.T @ force

    def _summed(self, values: Array) -> Array:
        """Return sums over the laws of every group."""
        return np.asarray(np.bincount(self._member, values, self._free.size), dtype=float)

    def linear(
        self, factor: float, tangent: Array, intercept: Array, held: Array | None = None, share: Array | None = None
    ) -> tuple[Array, Array, Array] | None:
        """Return u, R and the amplitudes of rigid motions for ``R = tangent u + intercept``.

        The unknown of a point is its coordinate where its laws are softer than the structure, and their force where
        they are steeper: a force computed from a coordinate would hold the rounding of the coordinate times the slope.

        `tangent`, `intercept` (shape (m,)): tangent, N/m, and force at u = 0, N, of every law; zero for laws that are
        held.
        `held` (shape (m,)): coordinates at which laws are held, in m; NaN for the others. Their forces follow from
        equilibrium.
        `share` (shape (m,)): stiffnesses in N/m, in proportion to which held laws share a force that equilibrium leaves
        open, as of two at one point.
        Returns None where the equations have no solution.
        """
        slope, force = self._summed(tangent), self._summed(self._sign * intercept)
        steep = slope * np.diag(self._compliance) > 1.0
        # A coordinate is a x + b and the force there c x + d.
        a = 1.0 / np.where(steep, slope, 1.0)
        b, c, d = np.where(steep, -force * a, 0.0), np.where(steep, 1.0, slope), np.where(steep, 0.0, force)
        ties, given = None, tangent
        if held is not None and share is not None:
            pinned = np.flatnonzero(~np.isnan(held))
            places = self._member[pinned]
            a[places], b[places], c[places] = 0.0, self._sign[pinned] * held[pinned], 1.0
            d[places] = force[places] + slope[places] * b[places]
            given = tangent.copy()
            given[np.isin(self._member, places)] = 0.0
            given[pinned] = share[pinned]
            ties = self._ties(np.unique(places), self._summed(given))
        right, along = factor * self._free - self._compliance @ d - b, np.diag(a) + self._compliance * c
        across, moves = self._moves.T * c, -self._moves
        if ties is not None:
            right, along, across, moves = ties.T @ right, ties.T @ along @ ties, across @ ties, ties.T @ moves
        count = self._push.size
        matrix = np.block([[along, moves], [across, np.zeros((count, count))]])
        try:
            solution = np.linalg.solve(matrix, np.concatenate([right, factor * self._push - self._moves.T @ d]))
        except np.linalg.LinAlgError:
            return None
        x, amplitude = np.split(solution, [right.size])
        if ties is not None:
            x = ties @ x
        u = self._sign * (a * x + b)[self._member]
        w = tangent * u + intercept
        # Equilibrium gives the total force of the laws of a point. The force of each law has the rounding of u.
        rest, whole = c * x + d - self._summed(self._sign * w), self._summed(given)
        w += self._sign * given * (rest / np.where(whole > 0.0, whole, np.inf))[self._member]
        return u, w, amplitude

    def _ties(self, places: NDArray[np.int64], weights: Array) -> Array | None:
        """Return columns T of unknowns ``x = T z`` where held rows depend on each other, or None where they do not."""
        if places.size < 2:
            return None
        rows, root = self._rows[places], np.sqrt(weights[places])
        dense = rows[:, np.unique(rows.indices)].toarray() * root[:, None]
        left, sizes, _ = np.linalg.svd(dense, full_matrices=False)
        independent = sizes > _DEPENDENT * sizes[0]
        if int(np.sum(independent)) == places.size:
            return None
        others = np.setdiff1d(np.arange(self._free.size), places)
        ties = np.zeros((self._free.size, others.size + int(np.sum(independent))))
        ties[others, np.arange(others.size)] = 1.0
        ties[places, others.size :] = root[:, None] * left[:, independent]
        return ties

    def beside(self, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which laws act at the points of some laws, these among them, shape (m,)."""
        return np.asarray(np.isin(self._member, self._member[some]))

    def left_over(self, w: Array, elastic: Array, intercept: Array, free: NDArray[np.int64]) -> Array:
        """Return what laws other than some leave over of the force at every law's point, in its direction, shape (m,).

        `w` (shape (m,)): forces in balance with the load.
        `elastic`, `intercept` (shape (m,)): the two terms that make up the force of every law.
        `free`: numbers of the laws that bear the rest.
        """
        others = np.ones(w.size)
        others[free] = 0.0
        rest = self._summed(self._sign * (w - others * (elastic + intercept)))
        doubt = _ROUNDING * self._summed(others * (np.abs(elastic) + np.abs(intercept)))
        rest = np.where(np.abs(rest) > doubt, rest, self._summed(self._sign * (1.0 - others) * w))
        return np.asarray(self._sign * rest[self._member])

    def terms(self, factor: float, u: Array, forces: Array) -> Array:
        """Return the sums of the magnitudes of the terms that make up u, shape (m,), for magnitudes of forces."""
        whole = np.abs(factor * self._free) + np.abs(self._compliance) @ self._summed(forces)
        return np.asarray(np.abs(u) + whole[self._member])

    def displacement(self, factor: float, reaction: Array, amplitude: Array) -> Array:
        """Return all free degrees of freedom under forces of the laws, shape (n,)."""
        bends = self._columns @ self._summed(self._sign * reaction)
        return np.asarray(factor * self._load - bends + self._rigid @ amplitude)
