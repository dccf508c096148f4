"""Equilibrium in the space of the contact coordinates, from any starting set of closed contacts.

The energy of a structure on contacts is convex, under both force laws. It is
minimised by Newton's method with an exact line search, which ends after
finitely many steps; the vertical part of the jump law (the reaction may lie
anywhere in [0, K0 gap] at the gap) is given a steep slope on the way and
treated exactly at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError
from vofem.integrators.rounding import graded
from vofem.statics.line_search import lowest
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws, System

Array = NDArray[np.float64]
Status = NDArray[np.int64]
Solve = Callable[[Array], Array]

_MOST_ITERATIONS = 500

#: Above this many degrees of freedom K has lost enough digits to look for them elsewhere.
_MANY_UNKNOWNS = 400


def _factorize(matrix: Any) -> Any:
    """Return a function that solves with a sparse symmetric matrix."""
    from scipy.sparse.linalg import splu

    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve
    except RuntimeError as error:
        raise SingularSystemError(f"the stiffness matrix is singular ({error}); hold the structure better") from None


def solver_of(system: System, shift: Array) -> Solve:
    """Return a function that solves with K and contacts closed by springs `shift`, (n_contacts,); zero leaves one open.

    Large systems and graded meshes are solved by the strains, as K holds too few digits of them.
    """
    from scipy.sparse import diags, vstack

    rows, closed = None, np.any(shift > 0.0)
    if closed:
        assert system.contacts is not None
        rows = system.contacts.rows
    if system.strain is None or (system.size <= _MANY_UNKNOWNS and not graded(system)):
        return _factorize(system.stiffness if rows is None else system.stiffness + rows.T @ diags(shift) @ rows)
    from vofem.linalg.orthogonal import OrthogonalFactor, elimination_orders

    strain = system.strain if rows is None else vstack([system.strain, diags(np.sqrt(shift)) @ rows], format="csr")
    factor = OrthogonalFactor(strain, elimination_orders(strain, system.rotational)[0])

    def solve(right: Array) -> Array:
        return factor.solve(right) if right.ndim == 1 else np.stack([factor.solve(b) for b in right.T], axis=1)

    return solve


class ContactSolver:
    """Equilibrium in the contact coordinates: ``u = u_f - G (R - shift u)``, R a law of u.

    Where the structure is loose without contacts, all of them are first
    closed (`shift`), so that a matrix can be factored; the shift is taken out
    of the law again.
    """

    def __init__(self, system: System, laws: ContactLaws, force: Array) -> None:
        self.laws = laws
        self.shift = laws.stiffness if system.rigid.shape[1] else np.zeros(len(laws))
        self._solve = solver_of(system, self.shift)
        self._force = force
        self._columns = self._solve(laws.rows.T.toarray())
        self.compliance = np.asarray(laws.rows @ self._columns)
        self.free = np.asarray(laws.rows @ self._solve(force))

    def _law(self, u: Array, ramp: Array) -> tuple[Array, Array, Array, Status]:
        """Return reaction, tangent, and intercept with status, the jump replaced by a ramp of a given width."""
        laws = self.laws
        k, gap = laws.stiffness, laws.gap
        s = u - gap
        beyond = np.where(laws.jump, s > ramp, s > 0)
        within = laws.jump & (s > 0) & ~beyond
        safe = np.where(ramp > 0, ramp, 1.0)
        steep = k * (gap + ramp) / safe
        reaction = np.where(beyond, k * (u - laws.offset), np.where(within, steep * s, 0.0))
        tangent = np.where(beyond, k, np.where(within, steep, 0.0))
        status = np.where(beyond, CLOSED, np.where(within, PINNED, OPEN)).astype(np.int64)
        return reaction, tangent, reaction - tangent * u, status

    def solve(self, start: Status) -> tuple[Status, int, bool]:
        """Return the status in equilibrium, the number of Newton steps and whether they ended there."""
        laws = self.laws
        total = 0
        for width in (1e-6, 1e-9, 1e-12):
            ramp = np.where(laws.jump, width * laws.gap, 0.0)
            status, steps = self._newton(start, ramp)
            total += steps
            if self._consistent(status):
                return status, total, True
            start = status
        return status, total, False

    def _newton(self, start: Status, ramp: Array) -> tuple[Status, int]:
        """Minimise the convex energy; `w` is the force of the law with the shift taken out."""
        laws = self.laws
        tangent = np.where(start == OPEN, 0.0, laws.stiffness)
        intercept = -tangent * laws.offset
        u, w = self._linear(tangent, intercept)
        for step in range(1, _MOST_ITERATIONS + 1):
            reaction, tangent, intercept, status = self._law(u, ramp)
            if np.all(np.abs(reaction - self.shift * u - w) <= 1e-12 * (np.abs(reaction) + np.abs(w) + 1e-300)):
                return status, step
            u_new, w_new = self._linear(tangent, intercept)
            du, dw = u_new - u, w_new - w
            if np.array_equal(self._law(u_new, ramp)[3], status):
                return status, step
            length = self._line_search(u, w, du, dw, ramp)
            u, w = u + length * du, w + length * dw
        return self._law(u, ramp)[3], _MOST_ITERATIONS

    def _linear(self, tangent: Array, intercept: Array) -> tuple[Any, Any]:
        """Return u and w for ``R = tangent u + intercept``."""
        slope = tangent - self.shift
        # Contacts that carry nothing keep a trace of stiffness, so that a loose structure stays solvable.
        trace = np.where((tangent == 0.0) & (self.shift > 0), 1e-12 * self.laws.stiffness, 0.0)
        matrix = np.eye(slope.size) + self.compliance * (slope + trace)
        u = np.linalg.solve(matrix, self.free - self.compliance @ intercept)
        return u, slope * u + intercept

    def _line_search(self, u: Array, w: Array, du: Array, dw: Array, ramp: Array) -> float:
        """Return how far to go along a direction to where the energy is least."""

        def derivative(x: float) -> float:
            reaction = self._law(u + x * du, ramp)[0]
            return float(du @ (reaction - self.shift * (u + x * du) - (w + x * dw)))

        return lowest(derivative)

    def exact(self, status: Status) -> tuple[Array, Array]:
        """Return u and the reactions for a status, pinned contacts held at their gap exactly."""
        laws, g = self.laws, self.compliance
        m = len(laws)
        closed, pinned = status == CLOSED, np.flatnonzero(status == PINNED)
        tangent = np.where(closed, laws.stiffness, 0.0)
        matrix = np.zeros((m + pinned.size, m + pinned.size))
        matrix[:m, :m] = np.eye(m) + g * (tangent - self.shift)
        matrix[:m, m:] = g[:, pinned]
        matrix[m + np.arange(pinned.size), pinned] = 1.0
        right = np.concatenate([self.free + g @ (tangent * laws.offset), laws.gap[pinned]])
        solution = np.linalg.solve(matrix, right)
        u = solution[:m]
        reaction = tangent * (u - laws.offset)
        reaction[pinned] = solution[m:]
        u[pinned] = laws.gap[pinned]
        return u, reaction

    def _consistent(self, status: Status) -> bool:
        """Return whether the exact solution for a status agrees with it, to rounding."""
        laws = self.laws
        try:
            u, reaction = self.exact(status)
        except np.linalg.LinAlgError:
            return False
        slack = 1e-10 * (np.abs(laws.gap) + np.abs(u).max(initial=0.0))
        s = u - laws.gap
        jump = laws.stiffness * laws.gap
        fine = np.where(status == CLOSED, s >= -slack, s <= slack)
        held = (reaction >= -1e-10 * jump) & (reaction <= jump * (1.0 + 1e-10))
        return bool(np.all(np.where(status == PINNED, held, fine)))

    def displacement(self, u: Array, reaction: Array) -> Array:
        """Return all free degrees of freedom, shape (n,)."""
        return self._solve(self._force) - self._columns @ (reaction - self.shift * u)
