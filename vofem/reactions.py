"""Support reactions from the equations of motion of the supported degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import Model
from vofem.bodies.beam import SUPPORTS, Beam
from vofem.errors import ArgumentError
from vofem.integrators.base import Sampled

Array = NDArray[np.float64]


def support_reaction(
    model: Model,
    beam: Beam,
    where: Any,
    times: Array,
    samples: Sampled,
    contact_force: Array | None,
    modes: tuple[Array, Array] | None = None,
    spring_force: Array | None = None,
) -> tuple[Array, Array]:
    """Return force (N) and moment (N m) that a support exerts, each of shape (n_times,).

    Parameters
    ----------
    modes : (ndarray, ndarray), optional
        Squared frequencies and shapes that modal damping acts on; all modes where not given.
    spring_force : ndarray, shape (n_springs, n_times), optional
        Of springs with memory, springpots last, N.

    Raises
    ------
    ArgumentError
        If there is no support at that place.
    """
    node = beam.node_at(where)
    if node not in beam.supports:
        places = ", ".join(f"x = {beam.nodes[k]:g}" for k in beam.supports) or "none"
        raise ArgumentError(f"Beam {beam.name!r} has no support at {where!r}; its supports: {places}")
    result = np.zeros((2, times.size))
    for dof in SUPPORTS[beam.supports[node]]:
        result[dof] = _residual(
            model, model.offsets[beam] + 2 * node + dof, times, samples, contact_force, modes, spring_force
        )
    return result[0], result[1]


def _residual(
    model: Model,
    dof: int,
    times: Array,
    samples: Sampled,
    contact_force: Array | None,
    modes: tuple[Array, Array] | None,
    spring_force: Array | None,
) -> Array:
    """Return ``M a + C v + K q - f + contact forces`` of one supported degree of freedom."""
    system = model.system

    def product(matrix: Any, kind: str) -> Array:
        return samples.along(matrix[[dof]][:, model.free], kind)

    total = product(model.mass, "a") + product(model.stiffness, "q")
    if model.damping is not None:
        total = total + product(model.damping, "v")
    if system.rayleigh is not None:
        alpha, beta = system.rayleigh
        row = alpha * model.mass[[dof]] + beta * model.stiffness[[dof]]
        total = total + samples.along(row[:, model.free], "v")
    if system.modal_damping is not None:
        from vofem.linalg.eigen import modal_basis

        if modes is None:
            modes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
        squares, shapes = modes
        rates = samples.along((system.mass @ shapes).T, "v")
        force = shapes @ (2.0 * system.modal_damping * np.sqrt(squares)[:, None] * rates)
        total = total + model.mass[[dof]][:, model.free] @ force
    value = np.asarray(total)[0]
    for vector, load in zip(model.load_vectors, system.loads, strict=True):
        if vector[dof]:
            value = value - vector[dof] * load.function(times)
    recorded = 0
    for rows, group in zip(model.law_rows, system.laws, strict=True):
        column = np.asarray(rows[:, [dof]].todense())[:, 0]
        first, recorded = recorded, recorded + len(group) * group.recorded
        if not np.any(column):
            continue
        if group is system.contacts:
            assert contact_force is not None
            value = value + column @ contact_force
        elif group.recorded:
            assert spring_force is not None
            value = value + column @ spring_force[first:recorded]
        else:
            value = value + column @ group.reactions(np.asarray(group.rows @ samples.q))
    return value
