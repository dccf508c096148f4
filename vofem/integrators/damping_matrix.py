"""The damping matrix of a system for methods that step in time."""

from __future__ import annotations

from typing import Any

from vofem.errors import MethodError
from vofem.integrators.registry import advice
from vofem.system import Counters, System

#: Modal damping makes C a full matrix; beyond this size that is refused.
_LARGEST_FULL = 3000


def too_full(system: System) -> str | None:
    """Return why modal damping of a system is beyond methods that need C as a matrix, or None."""
    if system.modal_damping is None or system.size <= _LARGEST_FULL:
        return None
    return (
        f"ModalDamping makes C a full matrix, too large for {system.size} degrees of freedom "
        f"(at most {_LARGEST_FULL}); use RayleighDamping, or {advice(exact=True)}"
    )


def damping_matrix(system: System, counters: Counters) -> Any:
    """Return C as a sparse matrix, or None where nothing is damped.

    Raises `MethodError` if modal damping is asked of a system too large for a full matrix.
    """
    if system.modal_damping is None:
        return system.sparse_damping
    return system.cache.get("damping matrix", None, lambda: _in_full(system, counters))


def _in_full(system: System, counters: Counters) -> Any:
    """Return C with modal damping."""
    assert system.modal_damping is not None
    reason = too_full(system)
    if reason is not None:
        raise MethodError(reason)
    from scipy.sparse import csc_matrix

    from vofem.linalg.eigen import modal_basis

    squares, shapes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
    counters.eigensolves += 1
    momentum = system.mass @ shapes
    full = (momentum * system.modal_rates(squares)) @ momentum.T
    full = csc_matrix(0.5 * (full + full.T))
    return full if system.sparse_damping is None else full + system.sparse_damping
