"""Energies that a system stores, in the common form of all stepping methods."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import spring_potential
from vofem.system import CLOSED, OPEN, ContactLaws, System

Array = NDArray[np.float64]


def kinetic_energy(system: System, v: Array) -> Array:
    """Return the kinetic energy in J for velocities of shape (n, n_times)."""
    return np.asarray(0.5 * np.sum(v * (system.mass @ v), axis=0))


def strain_energy(system: System, q: Array) -> Array:
    """Return the energy in J of bodies and springs, smooth nonlinear ones included, for q of shape (n, n_times)."""
    if system.strain is not None:
        strain = 0.5 * np.sum(np.asarray(system.strain @ q) ** 2, axis=0)
    else:
        strain = 0.5 * np.sum(q * (system.stiffness @ q), axis=0)
    if system.nonlinear is not None:
        for law, u in zip(system.nonlinear.laws, system.nonlinear.rows @ q, strict=True):
            strain += np.array([law.energy(float(x)) for x in u])
    return np.asarray(strain)


def contact_energy(laws: ContactLaws | None, q: Array) -> Array:
    """Return the energy in J stored in closed contacts; of a resolved switch by quadrature over its law."""
    if laws is None:
        return np.zeros(q.shape[1])
    u = np.asarray(laws.rows @ q)
    status = np.where(u > laws.gap[:, None], CLOSED, OPEN)
    status[np.isfinite(laws.resolution)] = OPEN
    total = spring_potential(laws, u, status)
    resolved_ones = np.flatnonzero(np.isfinite(laws.resolution))
    if not resolved_ones.size:
        return total
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for j in resolved_ones:
        from vofem.fractional.constants import resolved

        s = np.maximum(u[j] - laws.gap[j], 0.0)
        # Panels between multiples of the switching length resolve the rise; beyond 40 of them K_eq is K0.
        s0 = laws.resolution[j]
        edges = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0]) / s0
        for low, high in pairwise(edges):
            width = np.clip(s, low, high) - low
            at = low + 0.5 * width[:, None] * (1.0 + nodes)
            lever = at + laws.gap[j] - laws.offset[j]
            total += 0.5 * width * ((resolved(laws.stiffness[j], at, s0) * lever) @ weights)
        beyond = np.maximum(s - edges[-1], 0.0)
        lever = laws.gap[j] - laws.offset[j] + edges[-1]
        total += laws.stiffness[j] * beyond * (lever + 0.5 * beyond)
    return total
