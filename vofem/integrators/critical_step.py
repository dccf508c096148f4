"""The stability limit of explicit methods, with every contact closed."""

from __future__ import annotations

import numpy as np

from vofem.system import Counters, State, System

#: Up to this size the spectrum is computed with dense matrices.
_DENSE = 600


def highest_frequency(system: System, start: State | None = None) -> float:
    """Return an upper estimate of the highest natural frequency in rad/s, all contacts closed.

    Laws whose tangent nothing bounds count with the one that they have at the state `start`, or at rest.
    """
    stiffness = system.stiffness
    if system.laws:
        from scipy.sparse import diags

        q = np.zeros(system.size) if start is None else start.q
        for group in system.laws:
            slope = np.maximum(group.steepest(np.asarray(group.rows @ q)), 0.0)
            stiffness = stiffness + group.rows.T @ diags(slope) @ group.rows
    n = system.size
    if n <= _DENSE:
        from scipy.linalg import eigh

        balance = 1.0 / system.scale
        k = stiffness.toarray() * balance[:, None] * balance
        m = system.mass.toarray() * balance[:, None] * balance
        return float(np.sqrt(max(eigh(k, m, eigvals_only=True, driver="gvd")[-1], 0.0)))
    from scipy.sparse.linalg import eigsh

    guess = np.random.default_rng(0).standard_normal(n)
    top = eigsh(stiffness.tocsc(), k=1, M=system.mass, which="LA", v0=guess, tol=1e-6, return_eigenvectors=False)[0]
    return float(np.sqrt(max(top, 0.0)) * (1.0 + 1e-5))


def critical_step(system: System, start: State | None = None, counters: Counters | None = None) -> float:
    """Return the critical time step of central differences, ``2/omega_max``, in s."""

    def solve() -> float:
        if counters is not None:
            counters.eigensolves += 1
        return highest_frequency(system, start)

    # Where something bounds all tangents the start does not matter.
    free = start is not None and not all(group.bounded for group in system.laws)
    omega = system.cache.get("highest frequency", start.q.tobytes() if start is not None and free else None, solve, 8)
    return 2.0 / omega if omega > 0 else np.inf
