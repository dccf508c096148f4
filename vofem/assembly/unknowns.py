"""The unknowns of a System: the degrees of freedom that neither supports nor joints eliminate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.assembly.triplets import restricted, stacked
from vofem.bodies.base import Array, IntArray, Row
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

#: A condition whose largest coefficient falls below this, after the others have been solved, does not count as a
#: condition of its own: coefficients of displacements are of order 1.
_REDUNDANT = 1e-8

#: Of pivots that differ by less than this ratio the last one is taken, so that the order along the bodies stays.
_TIE = 1.0 - 1e-9

#: Coefficients, over the largest one, that count as zero after elimination.
_ROUNDING = 1e-14


@dataclass(frozen=True)
class Constraint:
    """A condition ``b.q = 0`` that holds exactly."""

    row: Row  #: b over all degrees of freedom.
    label: str  #: What messages call the condition, such as ``Joint 'knee': rotation``.


@dataclass(frozen=True)
class Unknowns:
    """Which degrees of freedom are the unknowns, and how all follow from them."""

    free: IntArray  #: The unknowns among all degrees of freedom, shape (n,).
    #: All degrees of freedom from the unknowns and the supported ones; the columns of eliminated ones are empty. None
    #: where no joint eliminates any. Shape (N, N).
    transform: csr_matrix | None = None

    def rows(self, matrix: Any) -> Any:
        """Return rows over all degrees of freedom, shape (k, N), as rows over the unknowns, csr_matrix (k, n)."""
        if self.transform is None:
            return matrix[:, self.free].tocsr()
        chosen = self.transform[:, self.free]
        reduced, bound = matrix @ chosen, abs(matrix) @ abs(chosen)
        return reduced.multiply(abs(reduced) > _ROUNDING * bound).tocsr()

    def square(self, matrix: csr_matrix) -> Any:
        """Return a square matrix over all degrees of freedom as one over the unknowns, csc_matrix (n, n)."""
        if self.transform is None:
            return restricted(matrix, self.free)
        chosen = self.transform[:, self.free]
        return (chosen.T @ matrix @ chosen).tocsc()

    def support_row(self, dof: int, size: int) -> csr_matrix:
        """Return the row, shape (1, N), that gives the reaction of a support from what the equations leave over.

        Beside its own degree of freedom it holds those that follow from it through joints.
        """
        from scipy.sparse import csr_matrix

        if self.transform is None:
            return csr_matrix(([1.0], ([0], [dof])), shape=(1, size))
        return csr_matrix(self.transform[:, [dof]].T)

    def vector(self, forces: Array) -> Array:
        """Return forces on all degrees of freedom, shape (N, ...), as forces on the unknowns (n, ...)."""
        if self.transform is None:
            return forces[self.free]
        return np.asarray(self.transform[:, self.free].T @ forces)

    def scale(self, scale: Array) -> Array:
        """Return the lengths that make the unknowns displacements; two that are joined take the smaller one."""
        if self.transform is None:
            return scale[self.free]
        single = np.diff(self.transform.indptr) == 1
        smallest = scale.copy()
        columns = self.transform.indices[self.transform.indptr[:-1][single]]
        np.minimum.at(smallest, columns, scale[single])
        return smallest[self.free]


def unknowns(
    constraints: Sequence[Constraint], held: IntArray, scale: Array
) -> tuple[Unknowns, csr_matrix | None, csr_matrix | None]:
    """Return the unknowns, the rows of the conditions, and the rows that give the force of each condition.

    Each condition eliminates the degree of freedom with its largest coefficient.

    `held`: supported degrees of freedom.
    `scale` (shape (N,)): lengths that make degrees of freedom displacements.
    Returns `conditions` (shape (n_constraints, N)): B with ``B q = 0``.
    Returns `forces` (shape (n_constraints, N)): L with ``lambda = L r``, where ``r = B' lambda`` is what the equations
    of motion leave over at the degrees of freedom that no support holds.
    Raises `ArgumentError` if a condition follows from supports and other conditions, exactly or nearly.
    """
    fixed = np.zeros(scale.size, dtype=bool)
    fixed[held] = True
    if not constraints:
        return Unknowns(np.flatnonzero(~fixed)), None, None
    from scipy.sparse import csr_matrix, identity
    from scipy.sparse.csgraph import connected_components

    conditions = stacked([constraint.row for constraint in constraints], scale.size)
    conditions.sum_duplicates()
    pattern = abs(conditions)[:, ~fixed]
    _, component = connected_components(pattern @ pattern.T, directed=False)
    entries: list[tuple[IntArray, IntArray, Array]] = []
    forces: list[tuple[IntArray, IntArray, Array]] = []
    eliminated = np.zeros(scale.size, dtype=bool)
    for number in range(int(component.max()) + 1):
        members = np.flatnonzero(component == number)
        part = conditions[members]
        touched = np.unique(part.indices)
        labels = [constraints[k].label for k in members.tolist()]
        pivots, solved, inverse = _solved(part[:, touched].toarray(), fixed[touched], scale[touched], labels)
        eliminated[touched[pivots]] = True
        row, column = np.nonzero(solved)
        entries.append((touched[pivots][row], touched[column], solved[row, column]))
        row, column = np.nonzero(inverse)
        forces.append((members[row], touched[pivots][column], inverse[row, column]))
    shape = scale.size, scale.size
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    kept = identity(scale.size, format="csr")
    kept.data[eliminated] = 0.0
    transform = (kept + csr_matrix((values, (rows, columns)), shape=shape)).tocsr()
    transform.eliminate_zeros()
    rows, columns, values = (np.concatenate(parts) for parts in zip(*forces, strict=True))
    return (
        Unknowns(np.flatnonzero(~fixed & ~eliminated), transform),
        conditions,
        csr_matrix((values, (rows, columns)), shape=conditions.shape),
    )


def _solved(matrix: Array, fixed: Any, scale: Array, labels: Sequence[str]) -> tuple[IntArray, Array, Array]:
    """Solve conditions for one degree of freedom each, by elimination with full pivoting.

    `matrix` has shape (m, k).
    `fixed` (shape (k,)): what a support holds is no pivot.
    `scale` has shape (k,).
    Returns `pivots` (shape (m,)): the degrees of freedom that are eliminated.
    Returns `solved` (shape (m, k)): them as combinations of the others; zero in the columns of `pivots`.
    Returns `inverse` (shape (m, m)): the transposed inverse of the columns of `pivots`.
    """
    count = matrix.shape[0]
    work = matrix / scale
    size = np.max(np.abs(work), axis=1)
    moving = np.where(fixed, 0.0, work)
    if np.any(np.max(np.abs(moving), axis=1) <= _REDUNDANT * size):
        k = int(np.argmax(np.max(np.abs(moving), axis=1) <= _REDUNDANT * size))
        raise ArgumentError(
            f"{labels[k]} is held at both points by supports already, so the joint has nothing to tie; remove it, or "
            "remove a support"
        )
    size = np.max(np.abs(moving), axis=1)
    work = np.hstack([work / size[:, None], np.eye(count)])
    pivots = np.full(count, -1)
    free = np.flatnonzero(~fixed)
    for _ in range(count):
        left = np.flatnonzero(pivots < 0)
        candidates = np.abs(work[np.ix_(left, free)])
        best = candidates.max()
        if best < _REDUNDANT:
            k = int(left[np.argmin(candidates.max(axis=1))])
            others = sorted({label.partition(":")[0] for label in labels} - {labels[k].partition(":")[0]})
            also = f" of {', '.join(others[:5])}" if others else ""
            raise ArgumentError(
                f"{labels[k]} is tied already, or within rounding, by supports and other joints{also}: two joints at "
                "one point, or more of them in one element than it has degrees of freedom. Remove one of them, or "
                "refine the mesh there"
            )
        flat = np.flatnonzero((candidates >= _TIE * best).T.ravel())[-1]
        column, row = int(free[flat // left.size]), int(left[flat % left.size])
        work[row] /= work[row, column]
        rest = np.arange(count) != row
        work[rest] -= np.outer(work[rest, column], work[row])
        work[rest, column] = 0.0
        pivots[row] = column
    solved = -work[:, : scale.size] * scale / scale[pivots][:, None]
    solved[:, pivots] = 0.0
    solved[np.abs(solved * scale[pivots][:, None] / scale) < _ROUNDING] = 0.0
    # Degrees of freedom that are equal must be so to the last bit.
    equal = np.abs(np.abs(solved) - 1.0) < _ROUNDING
    solved[equal] = np.sign(solved[equal])
    inverse = work[:, scale.size :].T / size[:, None] / scale[pivots]
    return pivots, solved, inverse
