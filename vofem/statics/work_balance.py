"""A check of load paths: the work of the loads against the energy stored and dissipated."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.integrators.stepping.energies import contact_energy, strain_energy
from vofem.system import System

#: Missing energy, over the largest energy, above which there is a note.
_WORTH = 1e-6


def taken(system: System, q: Array, energies: Array) -> Array:
    """Return the energy in J stored and dissipated by bodies, springs and contacts at each factor, (n_factors,).

    `q` has shape (n, n_factors).
    `energies` (shape (2, m, n_factors)): energy stored and energy dissipated by laws with internal variables, J.
    """
    times = np.zeros(q.shape[1])
    whole = strain_energy(system, q, times) + contact_energy(system.contacts, q, times) + energies.sum(axis=(0, 1))
    return np.asarray(whole)


def work_notes(factors: Array, way: Array, energy: Array) -> list[str]:
    """Return a note if the work is not balanced along a path from the unloaded state.

    The force of every law rises along rising elongations and falls along falling ones. The same holds for the load over
    the displacement on which it does work. The work of a step therefore lies between the products of this displacement
    with the load at the two ends of the step. A wrong equilibrium lies outside these bounds.

    `factors` has shape (n_factors,).
    `way` (shape (n_factors,)): product of the load vector at factor 1 with the displacements, J.
    `energy` (shape (n_factors,)): energy stored and dissipated since the path began, J.
    """
    load, far, held = (np.concatenate([[0.0], part]) for part in (factors, way, energy))
    ends = np.diff(far) * np.stack([load[:-1], load[1:]])
    gained = np.diff(held)
    off = np.maximum(ends.min(axis=0) - gained, gained - ends.max(axis=0))
    scale = float(max(np.max(np.abs(held)), np.max(np.abs(load * far))))
    worst = int(np.argmax(off))
    if not off[worst] > _WORTH * scale:
        return []
    return [
        f"energy: from load factor {load[worst]:g} to {load[worst + 1]:g} bodies, springs and contacts take "
        f"{gained[worst]:.4g} J, while the loads' work lies between {ends[:, worst].min():.4g} and "
        f"{ends[:, worst].max():.4g} J: rounding has spoilt an equilibrium there, or a law's force falls while its "
        "elongation rises; make stiff parts less stiff, or check the laws"
    ]


def printed_notes(name: str, factors: Array, lost: Array) -> list[str]:
    """Return a note if the law of Eq. 22 returns energy that it had dissipated; energies in J, shape (n_factors,)."""
    steps = np.diff(lost, prepend=0.0)
    worst = int(np.argmin(steps))
    if not steps[worst] < -_WORTH * float(np.max(np.abs(lost))):
        return []
    before = factors[worst - 1] if worst else 0.0
    return [
        f"energy: from load factor {before:g} to {factors[worst]:g} HystereticSpring {name!r} gives back "
        f"{-steps[worst]:.4g} J that it had dissipated, as Eqs. 22-25 forget the residual elongation when the load "
        "rises again; memory='cyclic' remembers it"
    ]
