"""Energies that a system stores, in the common form of all stepping methods."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.system import ContactLaws, System

Array = NDArray[np.float64]


def kinetic_energy(system: System, v: Array) -> Array:
    """Return the kinetic energy in J for velocities of shape (n, n_times)."""
    return np.asarray(0.5 * np.sum(v * (system.mass @ v), axis=0))


def strain_energy(system: System, q: Array) -> Array:
    """Return the energy in J of bodies and springs, nonlinear ones included, for q of shape (n, n_times)."""
    if system.strain is not None:
        strain = 0.5 * np.sum(np.asarray(system.strain @ q) ** 2, axis=0)
    else:
        strain = 0.5 * np.sum(q * (system.stiffness @ q), axis=0)
    for group in system.laws:
        if group.place > 0:
            strain += group.potential(np.asarray(group.rows @ q))
    return np.asarray(strain)


def contact_energy(laws: ContactLaws | None, q: Array) -> Array:
    """Return the energy in J stored in closed contacts for q of shape (n, n_times)."""
    return np.zeros(q.shape[1]) if laws is None else laws.potential(np.asarray(laws.rows @ q))
