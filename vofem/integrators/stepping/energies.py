"""Energies that a system stores, in the common form of all stepping methods."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.laws import LawGroup
from vofem.system import ContactLaws, System


def kinetic_energy(system: System, v: Array) -> Array:
    """Return the kinetic energy in J for velocities of shape (n, n_times), or of shape (n,)."""
    return np.asarray(0.5 * np.sum(v * (system.mass @ v), axis=0))


def strain_energy(system: System, q: Array, times: Array) -> Array:
    """Return the energy in J of bodies and springs at times, nonlinear ones included, for q of shape (n, n_times)."""
    return _linear_energy(system, q) + _law_energy(system, q, times)


def contact_energy(laws: ContactLaws | None, q: Array, times: Array) -> Array:
    """Return the energy in J stored in closed contacts at times for q of shape (n, n_times)."""
    return np.zeros(q.shape[1]) if laws is None else _potential(laws, q, times)


def stored_energy(system: System, q: Array, v: Array, t: float = 0.0) -> float:
    """Return the kinetic, strain and contact energy of one state q, v at a time in s, J, in the system's order."""
    # Products with vectors take a third of the time of products with matrices of one column.
    column = q[:, None]
    laws = _law_energy(system, column, np.array([t])) + contact_energy(system.contacts, column, np.array([t]))
    return float(kinetic_energy(system, v) + _linear_energy(system, q) + laws[0])


def _linear_energy(system: System, q: Array) -> Array:
    """Return the energy in J of all that is linear, for q of shape (n, n_times) or (n,)."""
    if system.strain is not None:
        return np.asarray(0.5 * np.sum(np.asarray(system.strain @ q) ** 2, axis=0))
    return np.asarray(0.5 * np.sum(q * (system.stiffness @ q), axis=0))


def _potential(group: LawGroup, q: Array, times: Array) -> Array:
    """Return the energy in J of the laws of a group at times for q of shape (n, n_times)."""
    u = group.coordinates(q, times)
    # A law at a point that is not on its beam stores nothing, as one does that is far below its gap.
    return group.potential(u if group.moving is None else np.where(np.isnan(u), group.away[:, None], u))


def _law_energy(system: System, q: Array, times: Array) -> Array:
    """Return the energy in J of all laws but contacts for q of shape (n, n_times)."""
    total = np.zeros(q.shape[1])
    for group in system.laws:
        if group.place > 0:
            total += _potential(group, q, times)
    return total
