"""The stability limit of explicit methods, with every contact closed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.switch import steepest
from vofem.system import Counters, System

Array = NDArray[np.float64]

#: Up to this size the spectrum is computed with dense matrices.
_DENSE = 600


def highest_frequency(system: System, tangents: Array | None = None) -> float:
    """Return an upper estimate of the highest natural frequency in rad/s, all contacts closed.

    `tangents` are stiffnesses of the nonlinear springs in N/m, shape (n_laws,).
    """
    stiffness = system.stiffness
    laws = system.contacts
    if laws is not None:
        from scipy.sparse import diags

        slope = [steepest(g, bool(j), s0) for g, j, s0 in zip(laws.gap, laws.jump, laws.resolution, strict=True)]
        stiffness = stiffness + laws.rows.T @ diags(laws.stiffness * np.array(slope)) @ laws.rows
    if system.nonlinear is not None and tangents is not None:
        from scipy.sparse import diags

        rows = system.nonlinear.rows
        stiffness = stiffness + rows.T @ diags(np.maximum(tangents, 0.0)) @ rows
    if system.memory is not None:
        from scipy.sparse import diags

        rows = system.memory.rows
        # No law with memory is ever stiffer than before its first load.
        stiffness = stiffness + rows.T @ diags([law.stiffness for law in system.memory.laws]) @ rows
    n = system.size
    if n <= _DENSE:
        from scipy.linalg import eigh

        balance = 1.0 / system.scale
        k = stiffness.toarray() * balance[:, None] * balance
        m = system.mass.toarray() * balance[:, None] * balance
        return float(np.sqrt(max(eigh(k, m, eigvals_only=True, driver="gvd")[-1], 0.0)))
    from scipy.sparse.linalg import eigsh

    start = np.random.default_rng(0).standard_normal(n)
    top = eigsh(stiffness.tocsc(), k=1, M=system.mass, which="LA", v0=start, tol=1e-6, return_eigenvectors=False)[0]
    return float(np.sqrt(max(top, 0.0)) * (1.0 + 1e-5))


def critical_step(system: System, tangents: Array | None = None, counters: Counters | None = None) -> float:
    """Return the critical time step of central differences, ``2/omega_max``, in s."""

    def solve() -> float:
        if counters is not None:
            counters.eigensolves += 1
        return highest_frequency(system, tangents)

    omega = system.cache.get("highest frequency", None if tangents is None else tangents.tobytes(), solve, 8)
    return 2.0 / omega if omega > 0 else np.inf
