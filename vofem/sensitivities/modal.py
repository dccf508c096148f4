"""System and derivatives in the modes of the open system, and the equation of motion of each contact status.

The coordinates are fixed: a mode shape does not change with a parameter, only what holds along it. So nothing is ever
the derivative of an eigenvector.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.sensitivities.system_change import SystemChange
from vofem.system import CLOSED, PINNED, ContactLaws, System

Status = NDArray[np.int64]


@dataclass(frozen=True)
class ModalSystem:
    """A system in fixed modes, in which the mass is the identity."""

    system: System
    shapes: Array  #: Shape (n_free, n).
    stiffness: Array  #: Squared frequencies, shape (n,).
    damping: Array  #: Without contacts, shape (n, n).
    rates: Array  #: The part of it that modal damping gives, shape (n,).
    contacts: Array  #: Shape (n_contacts, n).
    loads: Array  #: Shape (n_loads, n).
    scale: Array  #: Frequencies by which displacements become comparable with velocities, shape (n,).

    @property
    def size(self) -> int:
        """Number of modes."""
        return int(self.stiffness.size)

    @property
    def laws(self) -> ContactLaws | None:
        """The contacts."""
        return self.system.contacts


def modal_system(solution: Any) -> ModalSystem:
    """Return the system of an event-driven run in its modes, or in those of its Ritz vectors."""
    space, shapes = solution.space, solution.modes[1]
    damping = np.diag(space.damping)
    if space.coupling is not None:
        damping = damping + space.coupling
    system: System = solution.system
    rates = np.zeros(space.size) if system.modal_damping is None else system.modal_rates(space.stiffness)
    frequency = np.sqrt(space.stiffness)
    slowest = 1.0 / solution.t_end
    return ModalSystem(
        system, shapes, space.stiffness, damping, rates, space.contacts, space.loads, np.maximum(frequency, slowest)
    )


@dataclass(frozen=True)
class ModalChange:
    """The derivative of a modal system by a parameter; matrices are None where they do not change."""

    #: `mass`, `stiffness`, `damping`: shape (n, n).
    mass: Array | None
    stiffness: Array | None
    damping: Array | None
    contacts: Array | None  #: Shape (n_contacts, n).
    loads: Array | None  #: Shape (n_loads, n).
    #: `displacement`, `velocity`: of the initial state, shape (n,).
    displacement: Array
    velocity: Array
    change: SystemChange


def modal_change(modal: ModalSystem, full: System, change: SystemChange) -> ModalChange:
    """Return the derivative of a system in its modes.

    `full`: over the degrees of freedom.
    """
    shapes = modal.shapes

    def seen(matrix: Any) -> Array | None:
        return None if matrix is None else np.asarray(shapes.T @ (matrix @ shapes))

    mass, stiffness, damping = seen(change.mass), seen(change.stiffness), seen(change.damping)
    n = modal.size
    if change.moves_matrices:
        m = np.zeros((n, n)) if mass is None else mass
        k = np.zeros((n, n)) if stiffness is None else stiffness
        c = np.zeros((n, n)) if damping is None else damping
        alpha, beta = full.rayleigh or (0.0, 0.0)
        c = c + alpha * m + beta * k + np.diag(change.rayleigh[0] + change.rayleigh[1] * modal.stiffness)
        if full.modal_damping is not None:
            c = c + _modal_damping(modal, m, k) + 2.0 * change.modal_damping * np.diag(np.sqrt(modal.stiffness))
        damping = c if np.any(c) else None
    loads = None
    if np.any(change.vectors):
        loads = change.vectors @ shapes
    momentum = full.mass @ np.stack([change.displacement, change.velocity], axis=1)
    displacement, velocity = (shapes.T @ momentum).T
    rows = None if change.rows is None else np.asarray(change.rows @ shapes)
    return ModalChange(mass, stiffness, damping, rows, loads, displacement, velocity, change)


def _modal_damping(modal: ModalSystem, mass: Array, stiffness: Array) -> Array:
    """Return the derivative of the matrix of modal damping, a function of M and K, by divided differences."""
    squares, rates = modal.stiffness, modal.rates
    below = squares[:, None] - squares[None, :]
    near = np.abs(below) <= 1e-6 * (squares[:, None] + squares[None, :])
    frequency = np.sqrt(squares)
    ratio = np.where(frequency > 0.0, 0.5 * rates / np.where(frequency > 0.0, frequency, 1.0), 0.0)
    total = frequency[:, None] + frequency[None, :]
    # With one ratio for both modes the difference of roots is 1/(w_i + w_j), which is never large.
    one = 2.0 * ratio[:, None] / np.where(total > 0.0, total, 1.0)
    alike = near | (ratio[:, None] == ratio[None, :])
    factor = np.where(alike, one, (rates[:, None] - rates[None, :]) / np.where(alike, 1.0, below))
    push = stiffness - mass * squares[None, :]
    return np.asarray(mass * rates[None, :] + push * factor)


class StatusEquation:
    """The equation of motion ``u' = A u + (0, P f)`` of a contact status, u being scaled displacements and velocities.

    `matrix` (shape (2n, 2n)): A.
    `project` (shape (n, n)): P, which removes forces along pinned contacts; None where nothing is pinned.
    `push` (shape (n,)): constant force of the closed contacts.
    """

    def __init__(self, modal: ModalSystem, status: Status) -> None:
        self.modal, self.status = modal, status
        n = modal.size
        self.closed = np.flatnonzero(status == CLOSED)
        self.pinned = np.flatnonzero(status == PINNED)
        self.stiffness, self.damping = np.diag(modal.stiffness), modal.damping
        self.push = np.zeros(n)
        if (laws := modal.laws) is not None and self.closed.size:
            rows = modal.contacts[self.closed]
            self.stiffness = self.stiffness + rows.T @ (laws.stiffness[self.closed, None] * rows)
            self.damping = self.damping + rows.T @ (laws.damping[self.closed, None] * rows)
            self.push = (laws.stiffness * laws.offset)[self.closed] @ rows
        self.project: Array | None = None
        if self.pinned.size:
            held = modal.contacts[self.pinned]
            self.gram = np.linalg.inv(held @ held.T)
            self.project = np.eye(n) - held.T @ self.gram @ held
        self.force = np.hstack([-self.stiffness / modal.scale, -self.damping])
        self.matrix = np.zeros((2 * n, 2 * n))
        self.matrix[:n, n:] = np.diag(modal.scale)
        self.matrix[n:] = self.force if self.project is None else self.project @ self.force

    def changes(self, change: ModalChange) -> tuple[Array | None, Array | None, Array]:
        """Return the derivatives of A (2n, 2n), of the inverse mass or of P (n, n), and of the constant push (n,)."""
        modal, n, laws = self.modal, self.modal.size, self.modal.laws
        stiffness = np.zeros((n, n)) if change.stiffness is None else change.stiffness
        damping = np.zeros((n, n)) if change.damping is None else change.damping
        touched = change.stiffness is not None or change.damping is not None
        push = np.zeros(n)
        if laws is not None and self.closed.size:
            part, rows = self.closed, modal.contacts[self.closed]
            k, c, gap = laws.stiffness[part], laws.damping[part], laws.offset[part]
            k_p, c_p = change.change.contact_stiffness[part], change.change.contact_damping[part]
            gap_p = np.where(laws.jump[part], 0.0, change.change.gap[part])
            push = (k_p * gap + k * gap_p) @ rows
            if np.any(k_p) or np.any(c_p):
                touched = True
                stiffness = stiffness + rows.T @ (k_p[:, None] * rows)
                damping = damping + rows.T @ (c_p[:, None] * rows)
            if change.contacts is not None and np.any(change.contacts[part]):
                touched = True
                moved = change.contacts[part]
                for target, factor in ((0, k), (1, c)):
                    both = rows.T @ (factor[:, None] * moved)
                    both = both + both.T
                    stiffness, damping = (stiffness + both, damping) if target == 0 else (stiffness, damping + both)
                push = push + (k * gap) @ moved
        inverse = self.inverse_change(change)
        if not touched and inverse is None:
            return None, None, push
        lower = np.hstack([-stiffness / modal.scale, -damping])
        if self.project is not None:
            lower = self.project @ lower
        if inverse is not None:
            lower = lower + inverse @ self.force
        matrix = np.zeros((2 * n, 2 * n))
        matrix[n:] = lower
        return matrix, inverse, push

    def inverse_change(self, change: ModalChange) -> Array | None:
        """Return the derivative of what takes forces to accelerations, shape (n, n)."""
        if self.project is None:
            return None if change.mass is None else -change.mass
        held = self.modal.contacts[self.pinned]
        moved = None if change.contacts is None else change.contacts[self.pinned]
        if change.mass is None and (moved is None or not np.any(moved)):
            return None
        h = np.zeros((held.shape[1],) * 2) if change.mass is None else -change.mass
        c = np.zeros_like(held) if moved is None else moved
        g = self.gram
        side = (h @ held.T + c.T) @ g @ held
        inner = c @ held.T + held @ h @ held.T + held @ c.T
        return np.asarray(h - side - side.T + held.T @ g @ inner @ g @ held)

    def reaction(self) -> tuple[Array, Array]:
        """Return the rows over u (k, 2n), and over modal forces (k, n), that give the reactions of pinned contacts."""
        held = self.modal.contacts[self.pinned]
        share = self.gram @ held
        return np.asarray(share @ self.force), np.asarray(share)

    def reaction_changes(self, change: ModalChange, lower: Array) -> tuple[Array, Array]:
        """Return the derivatives of the rows of `reaction` by a parameter.

        `lower` (shape (n, 2n)): derivative of `force` at fixed projection.
        """
        held = self.modal.contacts[self.pinned]
        c = np.zeros_like(held) if change.contacts is None else change.contacts[self.pinned]
        h = np.zeros((held.shape[1],) * 2) if change.mass is None else -change.mass
        inner = c @ held.T + held @ h @ held.T + held @ c.T
        share_p = self.gram @ (c + held @ h) - self.gram @ inner @ self.gram @ held
        share = self.gram @ held
        return np.asarray(share_p @ self.force + share @ lower), np.asarray(share_p)


def check_modal_damping(full: System, names: list[str], changes: list[SystemChange]) -> None:
    """Raise where modal damping meets a parameter that gives stiffness to a rigid motion: a root of zero."""
    if full.modal_damping is None or not full.rigid.shape[1]:
        return
    for name, change in zip(names, changes, strict=True):
        if change.stiffness is not None and np.any(
            np.abs(change.stiffness @ full.rigid) > 1e-9 * abs(change.stiffness).max()
        ):
            raise ArgumentError(
                f"Parameter {name}: with ModalDamping a rigid motion that gets a stiffness of zero has no derivative, "
                "because its frequency is a root; hold the body, or use RayleighDamping"
            )
