"""Equilibria one after the other, of contacts and of springs that remember the ones before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.stepping.memory import (
    build_memory,
    commit,
    memory_force,
)
from vofem.integrators.stepping.recall import memory_energy_of
from vofem.statics.line_search import lowest
from vofem.statics.solver import Solve, solver_of
from vofem.system import CLOSED, OPEN, PINNED, System

Array = NDArray[np.float64]
Status = NDArray[np.int64]

_MOST_ITERATIONS = 200

#: Elongations in m, and over the last ones, beyond which an equilibrium is not looked for.
_BEYOND = 1e40

#: Widths, as fractions of the gap, over which the jump of a contact that acts on the displacement is spread.
_RAMPS = (1e-6, 1e-9, 1e-12)


class PathSolver:
    """Equilibrium in the coordinates of contacts and springs, R a law of u.

        u = u_f - G R + D a,    D' R = r' f

    r are the rigid motions of what is loose without contacts and springs,
    ``D = B r``, a their amplitudes, and G the compliance with these taken
    out. The energy of a step is convex, as all laws are monotone.
    """

    def __init__(self, system: System, force: Array) -> None:
        from scipy.sparse import vstack

        assert system.memory is not None or system.contacts is not None
        parts = [part.rows for part in (system.contacts, system.memory) if part is not None]
        self.rows: Any = vstack(parts, format="csr")
        self._contacts = system.contacts
        self.count = 0 if system.contacts is None else len(system.contacts)
        springs = () if system.memory is None else system.memory.laws
        self.limits = np.array([law.limit for law in springs])
        self.memory, self.state = build_memory(springs)
        stiffness = [] if system.contacts is None else system.contacts.stiffness.tolist()
        self.stiffness = np.array([*stiffness, *(law.stiffness for law in springs)])
        self._rigid = system.rigid
        solve = _bordered(system) if system.rigid.shape[1] else solver_of(system, np.zeros(0))
        self._columns = np.reshape(solve(self.rows.T.toarray()), (force.size, -1))
        self._compliance = np.asarray(self.rows @ self._columns)
        self._load = solve(force)
        self._free = np.asarray(self.rows @ self._load)
        self._moves = np.asarray(self.rows @ self._rigid)
        self._push = self._rigid.T @ force
        self._amplitude = np.zeros(self._push.size)
        self.u = np.zeros(self.stiffness.size)
        self.iterations = 0

    def _law(self, u: Array, width: float) -> tuple[Array, Array, Array, Status]:
        """Return reaction, tangent, intercept and status; jumps are spread over a width of their gap."""
        reaction, tangent = np.zeros(u.size), np.zeros(u.size)
        status = np.full(u.size, CLOSED, dtype=np.int64)
        n = self.count
        if self._contacts is not None:
            laws = self._contacts
            k, gap, s = laws.stiffness, laws.gap, u[:n] - laws.gap
            ramp = np.where(laws.jump, width * gap, 0.0)
            beyond = s > ramp
            within = (s > 0.0) & ~beyond
            steep = k * (gap + ramp) / np.where(ramp > 0.0, ramp, 1.0)
            reaction[:n] = np.where(beyond, k * (u[:n] - laws.offset), np.where(within, steep * s, 0.0))
            tangent[:n] = np.where(beyond, k, np.where(within, steep, 0.0))
            status[:n] = np.where(beyond, CLOSED, np.where(within, PINNED, OPEN))
        for i in range(u.size - n):
            reaction[n + i], tangent[n + i] = memory_force(self.memory, self.state, i, float(u[n + i]))
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

    def step(self, factor: float) -> tuple[Status, Array, bool]:
        """Go on to a load factor, without making it part of the past; return status, reactions and success."""
        u, found = self.u, False
        status, reaction = np.zeros(0, dtype=np.int64), np.zeros(0)
        for width in _RAMPS:
            u, found = self._newton(factor, u, width)
            reaction, tangent, intercept, status = self._law(u, width)
            if PINNED not in status:
                break
            u, reaction = self._pinned(factor, tangent, intercept, status)
            held = reaction[: self.count][status[: self.count] == PINNED]
            assert self._contacts is not None
            most = (self._contacts.stiffness * self._contacts.gap)[status[: self.count] == PINNED]
            if np.all((held >= -1e-10 * most) & (held <= most * (1.0 + 1e-10))):
                break
        self.u = u
        return status, reaction, found

    def _newton(self, factor: float, u: Array, width: float) -> tuple[Array, bool]:
        _, tangent, intercept, status = self._law(u, width)
        u, w = self._linear(factor, tangent, intercept)
        for _ in range(_MOST_ITERATIONS):
            self.iterations += 1
            a, before = self._amplitude, status
            settled = self._settled(u, w, before, width)
            _, tangent, intercept, status = self._law(u, width)
            u_new, w_new = self._linear(factor, tangent, intercept)
            if not np.all(np.abs(u_new) < _BEYOND * (1.0 + np.abs(self.u))):
                self._amplitude = a
                return u, settled
            # One more step where the forces agree: soft springs turn their last digits into many of u. Where
            # nothing resists any more it would lead away.
            if settled and np.max(np.abs(u_new - u)) > 1e-6 * np.max(np.abs(u)):
                self._amplitude = a
                return u, True
            if settled or self._settled(u_new, w_new, status, width):
                return u_new, True
            du, dw = u_new - u, w_new - w
            length = self._line_search(u, w, du, dw, width)
            u, w = u + length * du, w + length * dw
            self._amplitude = a + length * (self._amplitude - a)
        return u, False

    def _settled(self, u: Array, w: Array, status: Status, width: float) -> bool:
        """Return whether forces w belong to u; of contacts, which are piecewise linear, the status says all."""
        reaction, tangent, _, now = self._law(u, width)
        miss = np.abs(reaction - w)[self.count :]
        scale = (np.abs(reaction) + np.abs(w) + np.abs(tangent * u))[self.count :]
        return bool(np.all(miss <= 4e-15 * scale)) and np.array_equal(now, status)

    def _line_search(self, u: Array, w: Array, du: Array, dw: Array, width: float) -> float:
        """Return how far to go along a direction to where the energy is least."""

        def derivative(x: float) -> float:
            reaction = self._law(u + x * du, width)[0]
            return float(du @ (reaction - (w + x * dw)))

        return lowest(derivative)

    def _pinned(self, factor: float, tangent: Array, intercept: Array, status: Status) -> tuple[Array, Array]:
        """Return u and reactions with pinned contacts held at their gap exactly; springs by their tangents."""
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

    def tangents(self) -> Array:
        """Return the springs' tangent stiffness at the present, N/m, shape (n_springs,)."""
        return self._law(self.u, _RAMPS[0])[1][self.count :]

    def accept(self) -> tuple[Array, Array]:
        """Make the present part of the past; return what the springs store and have lost, J, each (n_springs,)."""
        pulls = self.u[self.count :]
        for i, u in enumerate(pulls.tolist()):
            commit(self.memory, self.state, i, u)
        return memory_energy_of(self.memory, self.state, pulls)

    def displacement(self, factor: float, reaction: Array) -> Array:
        """Return all free degrees of freedom, shape (n,)."""
        return np.asarray(factor * self._load - self._columns @ reaction + self._rigid @ self._amplitude)

    def stuck(self, factor: float) -> ConvergenceError:
        """Return the error of a step without a solution."""
        return ConvergenceError(
            f"quasi_static: no equilibrium was found at load factor {factor:g} in {_MOST_ITERATIONS} steps; "
            f"stiffnesses of {self.stiffness.min():g} to {self.stiffness.max():g} N/m may differ too much"
        )


def _bordered(system: System) -> Solve:
    """Return a function that solves with a K that is singular: rigid motions, and their loads, are taken out."""
    from scipy.sparse import bmat
    from scipy.sparse.linalg import splu

    n, k = system.rigid.shape
    size = float(np.max(np.abs(system.stiffness.diagonal()), initial=0.0)) or 1.0
    border = size * system.rigid / np.linalg.norm(system.rigid, axis=0)
    factor = splu(bmat([[system.stiffness, border], [border.T, None]], format="csc"))

    def solve(right: Array) -> Array:
        padded = np.concatenate([right, np.zeros((k, *right.shape[1:]))])
        return np.asarray(factor.solve(padded)[:n])

    return solve
