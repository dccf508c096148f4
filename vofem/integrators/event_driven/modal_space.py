"""The contact-free system in its own modes. All computations of the event-driven method use this form.

In these coordinates M is the identity, K and classical damping C are diagonal, and a contact is a row c. The finite
element model is no longer needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem.arrays import Array
from vofem.errors import SingularSystemError
from vofem.integrators.registry import advice
from vofem.linalg.eigen import modal_basis
from vofem.system import Counters, System

#: Damping counts as classical while its off-diagonal part stays below this fraction.
_CLASSICAL = 1e-13


@dataclass(frozen=True)
class ModalSpace:
    """The contact-free system in its own modes."""

    shapes: Array  #: Phi, M-orthonormal columns, shape (n, n).
    stiffness: Array  #: omega^2, ascending; 0 for rigid motions. Shape (n,).
    damping: Array  #: Diagonal part of ``Phi' C Phi`` from Rayleigh and modal damping, shape (n,).
    coupling: Array | None  #: ``Phi' C Phi`` of the dashpots where they couple modes, shape (n, n).
    contacts: Array  #: Rows c, shape (n_contacts, n).
    loads: Array  #: Modal load vectors, shape (n_loads, n).

    @property
    def size(self) -> int:
        """Number of modes."""
        return int(self.stiffness.size)

    def damping_force(self, velocity: Array) -> Array:
        """Return ``C v`` of a modal velocity, shape (n,) or (n, n_times), without contact dampers."""
        diagonal = self.damping if velocity.ndim == 1 else self.damping[:, None]
        force = diagonal * velocity
        return force if self.coupling is None else force + self.coupling @ velocity


def modal_space(system: System, counters: Counters) -> ModalSpace:
    """Solve the contact-free eigenproblem and express all rows in its modes."""
    try:
        squares, shapes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
    except SingularSystemError as error:
        cure = f" with {advice(conserves=True)}" if str(error).endswith("step in time") else ""
        raise SingularSystemError(f"{error}{cure}") from None
    counters.eigensolves += 1
    n = squares.size
    damping, coupling = np.zeros(n), None
    if system.damped:
        counters.damping_evaluations += 1
        if system.rayleigh is not None:
            damping += system.rayleigh[0] + system.rayleigh[1] * squares
        if system.modal_damping is not None:
            damping += system.modal_rates(squares)
        if system.damping is not None:
            coupling = shapes.T @ (system.damping @ shapes)
            diagonal = np.diag(coupling)
            bound = _CLASSICAL * np.sqrt(np.abs(np.outer(diagonal, diagonal)))
            if np.all(np.abs(coupling - np.diag(diagonal)) <= bound):
                damping, coupling = damping + diagonal, None
    contacts = np.empty((0, n)) if system.contacts is None else np.asarray(system.contacts.rows @ shapes)
    loads = np.empty((0, n))
    if system.loads:
        loads = np.stack([load.vector for load in system.loads]) @ shapes
    return ModalSpace(shapes, squares, damping, coupling, contacts, loads)
