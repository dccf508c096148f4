"""The damping matrix of a system for methods that step in time."""

from __future__ import annotations

from typing import Any

from vofem.errors import MethodError
from vofem.system import Counters, System

#: Modal damping makes C a full matrix; beyond this size that is refused.
_LARGEST_FULL = 3000


def damping_matrix(system: System, counters: Counters) -> Any:
    """Return C as a sparse matrix, or None where nothing is damped.

    Raises
    ------
    MethodError
        If modal damping is asked of a system too large for a full matrix.
    """
    if system.modal_damping is None:
        return system.sparse_damping
    if system.size > _LARGEST_FULL:
        raise MethodError(
            f"ModalDamping makes C a full matrix, too large for {system.size} degrees of freedom "
            f"(at most {_LARGEST_FULL}); use RayleighDamping, or method='event_driven'"
        )
    from scipy.sparse import csc_matrix

    from vofem.linalg.eigen import modal_basis

    squares, shapes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
    counters.eigensolves += 1
    momentum = system.mass @ shapes
    full = (momentum * system.modal_rates(squares)) @ momentum.T
    full = csc_matrix(0.5 * (full + full.T))
    return full if system.sparse_damping is None else full + system.sparse_damping
