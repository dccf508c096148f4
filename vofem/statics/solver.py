"""Equilibrium in the coordinates of the scalar laws, once or along a path of loads.

The energy of a structure on laws whose forces never fall is convex, under both
force laws of contacts. It is minimised by Newton's method with an exact line
search. Under the displacement law the reaction may take any value in
[0, K0 gap] at the gap. This vertical part of the law is replaced by a steep slope
during the iterations, and treated exactly at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError
from vofem.integrators.rounding import graded
from vofem.laws import CLOSED, OPEN, PINNED
from vofem.laws.evaluate import commit_all, lost, response, stored
from vofem.laws.rows import all_rows
from vofem.laws.table import build_laws
from vofem.statics.line_search import lowest
from vofem.system import System

Array = NDArray[np.float64]
Status = NDArray[np.int64]
Solve = Callable[[Array], Array]

_MOST_ITERATIONS = 500

#: Above this many degrees of freedom K has lost enough digits to look for them elsewhere.
_MANY_UNKNOWNS = 400

#: Coordinates in m, and over those of the last equilibrium, beyond which none is looked for.
_BEYOND = 1e40

#: Change of a coordinate over the terms that it is a sum of, at which Newton's method stands still.
_STILL = 8.0 * float(np.finfo(float).eps)

#: Widths, as fractions of the gap, over which the jump of a contact that acts on the displacement is spread.
_RAMPS = (1e-6, 1e-9, 1e-12)


#: Seconds in plain Python for a law in an equilibrium, and for an unknown where strains are factored.
_LAW, _STRAIN = 3e-3, 5e-3


def effort(system: System, count: int = 1) -> float:
    """Return an estimate of the seconds that some equilibria take in plain Python."""
    laws = sum(len(group) for group in system.laws if group.static)
    strains = _STRAIN * system.size if system.strain is not None and system.size > _MANY_UNKNOWNS else 0.0
    return strains + _LAW * laws * count


def _factorize(matrix: Any) -> Any:
    """Return a function that solves with a sparse symmetric matrix."""
    from scipy.sparse.linalg import splu

    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve
    except RuntimeError as error:
        raise SingularSystemError(f"the stiffness matrix is singular ({error}); hold the structure better") from None


def solver_of(system: System) -> Solve:
    """Return a function that solves with K, shapes (n,) or (n, k).

    If the structure can move freely without its laws, it is held at as many
    degrees of freedom as it has rigid motions. The response is then one of many
    that differ by rigid motions. Large systems and graded meshes are solved with
    their strains, because the entries of K hold too few digits.
    """
    from scipy.sparse import vstack

    from vofem.integrators.event_driven.reduction import holding

    held = holding(system)
    if system.strain is None or (system.size <= _MANY_UNKNOWNS and not graded(system)):
        respond = _factorize(system.stiffness if held is None else system.stiffness + held.T @ held)
    else:
        from vofem.linalg.orthogonal import OrthogonalFactor, elimination_orders

        strain = system.strain if held is None else vstack([system.strain, held], format="csr")
        factor = OrthogonalFactor(strain, elimination_orders(strain, system.rotational)[0])

        def respond(right: Array) -> Array:
            return factor.solve(right) if right.ndim == 1 else np.stack([factor.solve(b) for b in right.T], axis=1)

    if held is None:
        return lambda right: np.asarray(respond(right))
    balance = np.linalg.inv(np.asarray(held @ system.rigid).T)

    def balanced(right: Array) -> Array:
        return np.asarray(respond(right - held.T @ (balance @ (system.rigid.T @ right))))

    return balanced


class EquilibriumSolver:
    """Equilibrium of a system under multiples of a load, in the coordinates of its laws; R is a law of u.

        u = factor u_f - G R + D a,    D' R = factor r' f

    Here r are the rigid motions of parts that are free without laws, a their
    amplitudes, ``D = B r``, and G is the compliance without these motions.

    Attributes
    ----------
    rows : csr_matrix, shape (m, n)
        The rows B of all laws that take part in statics.
    u : ndarray, shape (m,)
        Coordinates in the last equilibrium.
    laws : Laws
        With the internal variables that the last accepted equilibrium has left.
    iterations : int
        Number of Newton steps in total.
    """

    def __init__(self, system: System, force: Array) -> None:
        self.groups = [group for group in system.laws if group.static]
        rows: Any = all_rows(self.groups)
        assert rows is not None
        self.rows = rows
        ends = np.cumsum([0, *(len(group) for group in self.groups)])
        self._parts = [slice(a, b) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
        self.laws = build_laws(self.groups)
        self.limits = np.concatenate([group.limits() for group in self.groups])
        self.stiffness = np.concatenate([group.steepest(np.zeros(len(group))) for group in self.groups])
        self._contacts = system.contacts
        self._linear_pieces = np.concatenate(
            [np.full(len(group), group.nonlinearity("") is None) for group in self.groups]
        )
        self._rigid = system.rigid
        solve = solver_of(system)
        self._columns = np.reshape(solve(rows.T.toarray()), (force.size, -1))
        self._compliance = np.asarray(rows @ self._columns)
        self._load = solve(force)
        self._free = np.asarray(rows @ self._load)
        self._moves = np.asarray(rows @ self._rigid)
        self._push = self._rigid.T @ force
        self._amplitude = np.zeros(self._push.size)
        self.u = np.zeros(self.stiffness.size)
        self.iterations = 0

    def part(self, group: Any) -> slice:
        """Return the positions of the laws of a group among all laws."""
        return self._parts[self.groups.index(group)]

    def _law(self, u: Array, width: float) -> tuple[Array, Array, Array, Status]:
        """Return reaction, tangent, intercept and status; jumps are spread over a width, a fraction of their gap."""
        found = [
            response(group, self.laws, part.start, u[part], width)
            for group, part in zip(self.groups, self._parts, strict=True)
        ]
        reaction, tangent, status = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return reaction, tangent, reaction - tangent * u, status

    def _linear(self, factor: float, tangent: Array, intercept: Array) -> tuple[Array, Array]:
        """Return u and the forces w for ``R = tangent u + intercept``."""
        m, k = self._moves.shape
        right = [factor * self._free - self._compliance @ intercept, factor * self._push - self._moves.T @ intercept]
        # Where a structure is loose, what carries nothing is given a trace of stiffness.
        for slope in (tangent, np.where(tangent == 0.0, 1e-12 * self.stiffness, tangent)):
            matrix = np.zeros((m + k, m + k))
            matrix[:m, :m] = np.eye(m) + self._compliance * slope
            matrix[:m, m:] = -self._moves
            matrix[m:, :m] = self._moves.T * slope
            try:
                solution = np.linalg.solve(matrix, np.concatenate(right))
            except np.linalg.LinAlgError:
                continue
            u: Array = solution[:m]
            self._amplitude = solution[m:]
            return u, slope * u + intercept
        return np.full(m, np.inf), np.full(m, np.inf)

    def solve(self, factor: float, start: Status | None = None) -> tuple[Status, Array, bool]:
        """Find the equilibrium at a load factor, without changing internal variables.

        Parameters
        ----------
        factor : float
        start : ndarray of int, shape (m,), optional
            Status from which the search begins. The default is that of the last equilibrium.

        Returns
        -------
        status : ndarray of int, shape (m,)
        reaction : ndarray, shape (m,)
        found : bool
        """
        u, found = self.u, False
        status, reaction = np.zeros(0, dtype=np.int64), np.zeros(0)
        for width in _RAMPS:
            u, found = self._newton(factor, u, width, start)
            start = None
            reaction, tangent, intercept, status = self._law(u, width)
            if PINNED not in status:
                break
            u, reaction = self._pinned(factor, tangent, intercept, status)
            if self._consistent(u, reaction, status):
                break
        self.u = u
        return status, reaction, found

    def _newton(self, factor: float, u: Array, width: float, start: Status | None) -> tuple[Array, bool]:
        _, tangent, intercept, status = self._law(u, width)
        if start is not None and self._contacts is not None:
            part, laws = self._parts[0], self._contacts
            status = np.concatenate([start[part], status[part.stop :]])
            tangent[part] = np.where(start[part] == OPEN, 0.0, laws.stiffness)
            intercept[part] = -tangent[part] * laws.offset
        u, w = self._linear(factor, tangent, intercept)
        for _ in range(_MOST_ITERATIONS):
            self.iterations += 1
            a, before = self._amplitude, status
            settled = self._settled(u, w, before, width)
            _, tangent, intercept, status = self._law(u, width)
            if settled and self._linear_pieces.all():
                return u, True
            u_new, w_new = self._linear(factor, tangent, intercept)
            if not np.all(np.abs(u_new) < _BEYOND * (1.0 + np.abs(self.u))):
                self._amplitude = a
                return u, settled
            # One more step where the forces agree: soft springs turn their last digits into many of u. Where
            # nothing resists any more it would lead away.
            if settled and np.max(np.abs(u_new - u)) > 1e-6 * np.max(np.abs(u)):
                self._amplitude = a
                return u, True
            # u is a sum of terms that may cancel, and is no more accurate than these. Among them are forces of steep
            # laws, such as a jump on its ramp, as they follow from coordinates that are known to rounding.
            forces = np.abs(w) + np.abs(tangent * u) + np.abs(intercept)
            terms = np.abs(u) + np.abs(factor * self._free) + np.abs(self._compliance) @ forces
            still = np.array_equal(before, status) and bool(np.all(np.abs(u_new - u) <= _STILL * terms))
            if settled or still or self._settled(u_new, w_new, status, width):
                return u_new, True
            du, dw = u_new - u, w_new - w
            length = self._line_search(u, w, du, dw, width)
            u, w = u + length * du, w + length * dw
            self._amplitude = a + length * (self._amplitude - a)
        return u, False

    def _settled(self, u: Array, w: Array, status: Status, width: float) -> bool:
        """Return whether forces w belong to u; of laws that are piecewise linear the status says all."""
        reaction, tangent, _, now = self._law(u, width)
        curved = ~self._linear_pieces
        miss = np.abs(reaction - w)[curved]
        scale = (np.abs(reaction) + np.abs(w) + np.abs(tangent * u))[curved]
        return bool(np.all(miss <= 4e-15 * scale)) and np.array_equal(now, status)

    def _line_search(self, u: Array, w: Array, du: Array, dw: Array, width: float) -> float:
        """Return how far to go along a direction to where the energy is least."""

        def derivative(x: float) -> float:
            reaction = self._law(u + x * du, width)[0]
            return float(du @ (reaction - (w + x * dw)))

        return lowest(derivative)

    def _pinned(self, factor: float, tangent: Array, intercept: Array, status: Status) -> tuple[Array, Array]:
        """Return u and reactions with pinned contacts held at their gap exactly; other laws by their tangents."""
        assert self._contacts is not None
        m, pinned = status.size, np.flatnonzero(status == PINNED)
        g, gap = self._compliance, self._contacts.gap[pinned]
        slope, part = tangent.copy(), intercept.copy()
        slope[pinned], part[pinned] = 0.0, 0.0
        k, held = self._push.size, pinned.size
        matrix = np.zeros((m + k + held, m + k + held))
        matrix[:m, :m] = np.eye(m) + g * slope
        matrix[:m, m : m + k] = -self._moves
        matrix[:m, m + k :] = g[:, pinned]
        matrix[m : m + k, :m] = self._moves.T * slope
        matrix[m : m + k, m + k :] = self._moves[pinned].T
        matrix[m + k + np.arange(held), pinned] = 1.0
        push = factor * self._push - self._moves.T @ part
        solution = np.linalg.solve(matrix, np.concatenate([factor * self._free - g @ part, push, gap]))
        u = solution[:m]
        self._amplitude = solution[m : m + k]
        reaction = slope * u + part
        reaction[pinned], u[pinned] = solution[m + k :], gap
        return u, reaction

    def _consistent(self, u: Array, reaction: Array, status: Status) -> bool:
        """Return whether a solution with pinned contacts agrees with their law, to rounding."""
        assert self._contacts is not None
        part, laws = self._parts[0], self._contacts
        s, most = u[part] - laws.gap, laws.stiffness * laws.gap
        slack = 1e-10 * (np.abs(laws.gap) + np.abs(u).max(initial=0.0))
        fine = np.where(status[part] == CLOSED, s >= -slack, s <= slack)
        held = (reaction[part] >= -1e-10 * most) & (reaction[part] <= most * (1.0 + 1e-10))
        return bool(np.all(np.where(status[part] == PINNED, held, fine)))

    def bearing(self, status: Status) -> Array | None:
        """Return the rows of the laws that resist a small motion, shape (k, n), or None where there are none."""
        tangent = self._law(self.u, _RAMPS[0])[1]
        bears = np.where(self._linear_pieces, status != OPEN, tangent > 0.0)
        return self.rows[bears].toarray() if np.any(bears) else None

    def accept(self) -> tuple[Array, Array]:
        """Update the internal variables; return the energy stored and dissipated by each law in J, each (m,).

        Both are zero for laws without internal variables.
        """
        energies = np.zeros((2, self.u.size))
        if not self.laws.state.size:
            return energies[0], energies[1]
        commit_all(self.laws, self.u)
        for j, u in enumerate(self.u.tolist()):
            if self.laws.table[j]["end"] > self.laws.table[j]["start"]:
                energies[:, j] = stored(self.laws, j, u), lost(self.laws, j, u)
        return energies[0], energies[1]

    def displacement(self, factor: float, reaction: Array) -> Array:
        """Return all free degrees of freedom, shape (n,)."""
        return np.asarray(factor * self._load - self._columns @ reaction + self._rigid @ self._amplitude)
