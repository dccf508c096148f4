"""Equilibrium in the coordinates of the scalar laws, once or along a path of loads.

The energy of a structure on laws whose forces never fall is convex, under both force laws of contacts. It is minimised
by Newton's method with an exact line search. Under the displacement law the reaction may take any value in [0, K0 gap]
at the gap. This vertical part of the law is replaced by a steep slope during the iterations, and treated exactly at the
end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.assembly import Model
from vofem.errors import SingularSystemError
from vofem.integrators.rounding import graded
from vofem.laws import CLOSED, OPEN, PINNED, LawSet
from vofem.laws.law import FORCE, TANGENT
from vofem.laws.rows import all_rows
from vofem.linalg.eigen import indefinite
from vofem.linalg.null_space import null_space
from vofem.statics.coordinates import Coordinates
from vofem.system import System

Status = NDArray[np.int64]
Solve = Callable[[Array], Array]

_MOST_ITERATIONS = 500

#: Number of degrees of freedom above which K has lost so many digits that strains are factored in its place.
_MANY_UNKNOWNS = 400

#: Largest coordinate, in m and over those of the last equilibrium, at which an equilibrium is searched.
_BEYOND = 1e40

#: Change of a coordinate, over the terms of its sum, at which Newton's method has converged.
_STILL = 8.0 * float(np.finfo(float).eps)

#: Distance from a gap, over the terms of this difference, that counts as rounding.
_EPS = 2.0 * float(np.finfo(float).eps)

#: Difference of forces, over the terms of their sums, that counts as rounding.
_AGREE = 16.0 * float(np.finfo(float).eps)

#: Newton steps with pinned contacts held, in which the status of others settles.
_MOST_CORRECTIONS = 8

#: Widths, as fractions of the gap, over which the jump of a contact that acts on the displacement is spread.
_RAMPS = (1e-6, 1e-9, 1e-12)


def _factorize(matrix: Any, squares: bool) -> Any:
    """Return a function that solves with a sparse symmetric matrix; `squares` says whether it is a sum of squares."""
    from scipy.sparse.linalg import splu

    # Under compression the energy may have no minimum. Pivots on the diagonal have the signs of its curvatures.
    pivots = None if squares else 0.0
    try:
        factor = splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=pivots, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise SingularSystemError(f"the stiffness matrix is singular ({error}); hold the structure better") from None
    if not squares and np.any(factor.U.diagonal() < 0.0):
        raise indefinite(squares)
    return factor.solve


def solver_of(system: System) -> Solve:
    """Return a function that solves with K, shapes (n,) or (n, k).

    If the structure can move freely without its laws, it is held at as many degrees of freedom as it has rigid motions.
    The response is then one of many that differ by rigid motions. Large systems and graded meshes are solved with their
    strains, because the entries of K hold too few digits.
    """
    from scipy.sparse import vstack

    from vofem.integrators.reduction import holding

    held = holding(system)
    if system.strain is None or (system.size <= _MANY_UNKNOWNS and not graded(system)):
        respond = _factorize(
            system.stiffness if held is None else system.stiffness + held.T @ held, system.strain is not None
        )
    else:
        from vofem.linalg.orthogonal import OrthogonalFactor, elimination_orders

        strain = system.strain if held is None else vstack([system.strain, held], format="csr")
        factor = OrthogonalFactor(strain, elimination_orders(strain, system.rotation)[0])

        def respond(right: Array) -> Array:
            return factor.solve(right) if right.ndim == 1 else np.stack([factor.solve(b) for b in right.T], axis=1)

    if held is None:
        return lambda right: np.asarray(respond(right))
    balance = np.linalg.inv(np.asarray(held @ system.rigid).T)

    def balanced(right: Array) -> Array:
        return np.asarray(respond(right - held.T @ (balance @ (system.rigid.T @ right))))

    return balanced


def check_held(model: Model, rows: Array | None) -> None:
    """Raise `SingularSystemError` if neither supports nor the given contact rows resist some rigid motion."""
    rigid = model.system.rigid
    if not rigid.shape[1]:
        return
    contacts = np.zeros((0, rigid.shape[0])) if rows is None else rows
    free = null_space(contacts @ rigid, np.abs(contacts) @ np.abs(rigid))
    if not free.shape[1]:
        return
    loose = rigid @ free[:, 0]
    full = np.abs(model.expand(loose[:, None])[:, 0])
    weights = {body: full[start : start + body.size].max() for body, start in model.offsets.items()}
    body = max(weights, key=lambda b: float(weights[b]))
    by = "its supports" if model.system.contacts is None else "its supports and the contacts that carry load"
    raise SingularSystemError(
        f"{body.label} can move freely: {by} do not hold it, so it has no equilibrium. "
        "Add a support or a spring; its motion in time can be simulated"
    )


class EquilibriumSolver:
    """Equilibrium of a system under multiples of a load, in the coordinates u of its laws; R is a law of u.

    `rows` (shape (m, n)): the rows B of all laws that take part in statics.
    `u` (shape (m,)): coordinates in the last equilibrium.
    `laws`: with the internal variables that the last accepted equilibrium has left.
    `iterations`: number of Newton steps in total.
    """

    def __init__(self, system: System, force: Array) -> None:
        self.groups = [group for group in system.laws if group.static]
        rows: Any = all_rows(self.groups)
        assert rows is not None
        self.rows = rows
        ends = np.cumsum([0, *(len(group) for group in self.groups)])
        self._parts = [slice(a, b) for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
        self.laws = LawSet(self.groups)
        self.limits = np.concatenate([group.limits() for group in self.groups])
        self.stiffness = np.concatenate([group.steepest(np.zeros(len(group))) for group in self.groups])
        self._contacts = system.contacts
        self._linear_pieces = np.concatenate(
            [np.full(len(group), group.nonlinearity("") is None) for group in self.groups]
        )
        self._coordinates = Coordinates(system, rows, force, solver_of(system))
        self._amplitude = np.zeros(system.rigid.shape[1])
        self.u = np.zeros(self.stiffness.size)
        self.iterations = 0

    def pushes(self) -> bool:
        """Return whether laws push where the last equilibrium is; before the first one, as stops with negative gaps."""
        return bool(np.any(self._law(self.u, _RAMPS[0])[0]))

    def part(self, group: Any) -> slice:
        """Return the positions of the laws of a group among all laws."""
        return self._parts[self.groups.index(group)]

    def _law(self, u: Array, width: float) -> tuple[Array, Array, Array, Status]:
        """Return reaction, tangent, intercept and status; jumps are spread over a width, a fraction of their gap."""
        first = 0 if self._contacts is None else len(self._contacts)
        reaction, tangent, status = np.empty(u.size), np.empty(u.size), np.full(u.size, CLOSED, dtype=np.int64)
        if self._contacts is not None:
            reaction[:first], tangent[:first], status[:first] = self._contacts.respond(u[:first], width)
        if first < u.size:
            reaction[first:], tangent[first:] = (
                self.laws.everywhere(what, u[:, None])[first:, 0] for what in (FORCE, TANGENT)
            )
        return reaction, tangent, reaction - tangent * u, status

    def _near(self, u: Array) -> NDArray[np.int64]:
        """Return the numbers of contacts whose coordinate is their gap to rounding."""
        if self._contacts is None:
            return np.zeros(0, dtype=np.int64)
        gap = self._contacts.gap
        here = u[self._parts[0]]
        return np.flatnonzero(np.abs(here - gap) <= _EPS * (np.abs(here) + np.abs(gap)))

    def _branch(
        self, u: Array, w: Array, width: float, pushed: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, Status]:
        """Return tangent, intercept and status where u follows from forces w.

        Where u is a gap to rounding, the force says whether the contacts there are closed: behind stiff stops
        a penetration is less than the rounding of u. `pushed` says it instead, for all laws.
        """
        _, tangent, intercept, status = self._law(u, width)
        near = self._near(u)
        if near.size and self._contacts is not None:
            laws = self._contacts
            if pushed is None:
                pushed = self._coordinates.left_over(w, tangent * u, intercept, near) > 0.0
            inside = laws.gap + np.where(laws.jump, 0.5 * width * laws.gap, 1.0 + np.abs(laws.gap))
            _, steep, closed = laws.respond(inside, width)
            tangent[near] = np.where(pushed[near], steep[near], 0.0)
            intercept[near] = -tangent[near] * laws.gap[near]
            status[near] = np.where(pushed[near], closed[near], OPEN)
        return tangent, intercept, status

    def _step(self, factor: float, u: Array, w: Array, width: float) -> tuple[Array, Array, Array, Array, Status]:
        """Return u and w of a step of Newton's method, with the tangent, intercept and status that it was made from.

        Contacts at their gap are closed where the step would lead behind it, and open where it would pull on them.
        """
        tangent, intercept, status = self._branch(u, w, width)
        near = self._near(u)
        for _ in range(_MOST_CORRECTIONS):
            u_new, w_new = self._linear(factor, tangent, intercept)
            if not near.size or self._contacts is None:
                break
            gap = self._contacts.gap[near]
            behind = u_new[near] - gap > _EPS * (np.abs(u_new[near]) + np.abs(gap))
            pushed = status != OPEN
            pushed[near] = np.where(pushed[near], w_new[near] >= 0.0, behind)
            if np.array_equal(pushed, status != OPEN):
                break
            tangent, intercept, status = self._branch(u, w, width, pushed)
        return u_new, w_new, tangent, intercept, status

    def _linear(self, factor: float, tangent: Array, intercept: Array) -> tuple[Array, Array]:
        """Return u and the forces w for ``R = tangent u + intercept``."""
        # In a loose structure, laws that carry no force get a very small stiffness.
        for slope in (tangent, np.where(tangent == 0.0, 1e-12 * self.stiffness, tangent)):
            found = self._coordinates.linear(factor, slope, intercept)
            if found is not None:
                u, w, self._amplitude = found
                return u, w
        m = self.u.size
        return np.full(m, np.inf), np.full(m, np.inf)

    def solve(self, factor: float, start: Status | None = None) -> tuple[Status, Array, bool]:
        """Find the equilibrium at a load factor, without changing internal variables.

        `start` (shape (m,)): status from which the search begins. The default is that of the last equilibrium.
        Returns `status` (shape (m,)).
        Returns `reaction` (shape (m,)).
        """
        u, found = self.u, False
        status, reaction = np.zeros(0, dtype=np.int64), np.zeros(0)
        for width in _RAMPS:
            u, reaction, status, found = self._newton(factor, u, width, start)
            start = None
            if PINNED not in status or not found:
                break
            amplitude = self._amplitude
            held = self._pinned(factor, u, reaction, status, width)
            if self._consistent(*held):
                u, reaction, status = held
                break
            self._amplitude = amplitude
        self.u = u
        return status, reaction, found

    def _newton(self, factor: float, u: Array, width: float, start: Status | None) -> tuple[Array, Array, Status, bool]:
        """Return coordinates, forces, status and whether they were found, with jumps spread over a width."""
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
            if settled and self._linear_pieces.all():
                return u, w, before, True
            u_new, w_new, tangent, intercept, status = self._step(factor, u, w, width)
            if not np.all(np.abs(u_new) < _BEYOND * (1.0 + np.abs(self.u))):
                self._amplitude = a
                return u, w, status, settled
            # One more step where the forces agree: soft springs turn their last digits into many of u. Where
            # nothing resists any more it would lead away.
            if settled and np.max(np.abs(u_new - u)) > 1e-6 * np.max(np.abs(u)):
                self._amplitude = a
                return u, w, status, True
            # u is a sum of terms that may cancel, and is no more accurate than these. Among them are forces of steep
            # laws, such as a jump on its ramp, as they follow from coordinates that are known to rounding.
            forces = np.abs(w) + np.abs(tangent * u) + np.abs(intercept)
            terms = self._coordinates.terms(factor, u, forces)
            still = np.array_equal(before, status) and bool(np.all(np.abs(u_new - u) <= _STILL * terms))
            if settled or still or self._settled(u_new, w_new, status, width):
                return u_new, w_new, status, True
            du, dw = u_new - u, w_new - w
            length = self._line_search(u, w, du, dw, width)
            u, w = u + length * du, w + length * dw
            self._amplitude = a + length * (self._amplitude - a)
        return u, w, status, False

    def _settled(self, u: Array, w: Array, before: Status, width: float, held: Any = False) -> bool:
        """Return whether forces w belong to u, and the status is that from which both were computed."""
        tangent, intercept, status = self._branch(u, w, width)
        miss, scale = np.abs(tangent * u + intercept - w), np.abs(tangent * u) + np.abs(intercept) + np.abs(w)
        return bool(np.all(((before == status) & (miss <= _AGREE * scale)) | held))

    def _line_search(self, u: Array, w: Array, du: Array, dw: Array, width: float) -> float:
        """Return the fraction of a step in (0, 1] at which the convex energy is least, by bisection on its slope."""

        def falls(x: float) -> bool:
            return float(du @ (self._law(u + x * du, width)[0] - (w + x * dw))) <= 0.0

        if falls(1.0):
            return 1.0
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if falls(middle) else (low, middle)
        return 0.5 * (low + high)

    def _pinned(self, factor: float, u: Array, w: Array, status: Status, width: float) -> tuple[Array, Array, Status]:
        """Return u, reactions and status with pinned contacts held at their gap exactly.

        Pinned contacts whose rows depend on each other, such as two at one point, share their force in proportion
        to their stiffnesses, as they do while their jumps have a width.
        """
        assert self._contacts is not None
        pinned = status == PINNED
        held = np.full(u.size, np.nan)
        held[pinned] = self._contacts.gap[np.flatnonzero(pinned)]
        beside = self._coordinates.beside(pinned) & ~pinned
        for _ in range(_MOST_CORRECTIONS):
            # Other contacts at the gap of a pinned one have no penetration.
            touching = beside & np.isin(np.arange(u.size), self._near(u))
            tangent, intercept, now = self._branch(u, w, width)
            now[pinned], now[touching] = PINNED, OPEN
            tangent[pinned | touching], intercept[pinned | touching] = 0.0, 0.0
            found = self._coordinates.linear(factor, tangent, intercept, held, self.stiffness)
            if found is None:
                break
            (u, w, self._amplitude), status = found, now
            fixed = pinned | touching
            if not np.any(beside[self._near(u)] & ~fixed[self._near(u)]) and self._settled(u, w, status, width, fixed):
                break
        return u, w, status

    def _consistent(self, u: Array, reaction: Array, status: Status) -> bool:
        """Return whether a solution with pinned contacts agrees with their law, to rounding."""
        assert self._contacts is not None
        part, laws = self._parts[0], self._contacts
        s, most = u[part] - laws.gap, laws.stiffness * laws.gap
        slack = 32.0 * _EPS * (np.abs(laws.gap) + np.abs(u).max(initial=0.0))
        pushed = reaction[part] >= -1e-10 * np.max(np.abs(reaction), initial=0.0)
        fine = np.where(status[part] == CLOSED, (s >= -slack) & pushed, s <= slack)
        held = pushed & (reaction[part] <= most * (1.0 + 1e-10))
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
        self.laws.commit_all(self.u)
        for j, u in enumerate(self.u.tolist()):
            if self.laws.laws[j].remembers:
                energies[:, j] = self.laws.stored(j, u), self.laws.dissipated(j, u)
        return energies[0], energies[1]

    def borne(self, reaction: Array) -> Array:
        """Return reactions without the rounding that would make contacts pull, shape (m,)."""
        if self._contacts is None:
            return reaction
        part = self._parts[0]
        return np.concatenate([np.maximum(reaction[part], 0.0), reaction[part.stop :]])

    def displacement(self, factor: float, reaction: Array) -> Array:
        """Return all free degrees of freedom, shape (n,)."""
        return self._coordinates.displacement(factor, reaction, self._amplitude)
