"""The contact-free system in its own modes. All computations of the event-driven method use this form.

In these coordinates M is the identity, K and classical damping C are diagonal, and a contact is a row c. The finite
element model is no longer needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError
from vofem.integrators.registry import advice
from vofem.linalg.eigen import modal_basis
from vofem.system import Counters, System

Array = NDArray[np.float64]

#: Damping counts as classical while its off-diagonal part stays below this fraction.
_CLASSICAL = 1e-13


@dataclass(frozen=True)
class ModalSpace:
    """The contact-free system in its own modes.

    Attributes
    ----------
    shapes : ndarray, shape (n, n)
        Phi, M-orthonormal columns.
    stiffness : ndarray, shape (n,)
        omega^2, ascending; 0 for rigid motions.
    damping : ndarray, shape (n,)
        Diagonal part of ``Phi' C Phi`` from Rayleigh and modal damping.
    coupling : ndarray, shape (n, n), optional
        ``Phi' C Phi`` of the dashpots where they couple modes.
    contacts : ndarray, shape (n_contacts, n)
        Rows c.
    loads : ndarray, shape (n_loads, n)
        Modal load vectors.
    """

    shapes: Array
    stiffness: Array
    damping: Array
    coupling: Array | None
    contacts: Array
    loads: Array

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
