"""Support reactions from the equations of motion of the supported degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.assembly import Model
from vofem.bodies.base import Body
from vofem.integrators.base import Sampled


def support_reaction(
    model: Model,
    body: Body,
    where: Any,
    times: Array,
    samples: Sampled,
    contact_force: Array | None,
    modes: tuple[Array, Array] | None = None,
    spring_force: Array | None = None,
) -> tuple[Array, Array]:
    """Return force (N) and moment (N m) that a support exerts, each of shape (n_times,).

    `modes`: squared frequencies and shapes that modal damping acts on; all modes where not given.
    `spring_force` (shape (n_springs, n_times)): forces of hysteretic springs, those of springpots last, N.
    Raises `ArgumentError` if there is no support at that place.
    """
    result = np.zeros((2, times.size))
    for dof in body.supported_at(where).tolist():
        row = model.unknowns.support_row(model.offsets[body] + dof, model.size)
        kind = int(body.degrees_of_freedom.rotation[dof])
        result[kind] += residual(model, row, times, samples, contact_force, modes, spring_force)
    return result[0], result[1]


def residual(
    model: Model,
    weights: Any,
    times: Array,
    samples: Sampled,
    contact_force: Array | None,
    modes: tuple[Array, Array] | None,
    spring_force: Array | None,
) -> Array:
    """Return ``w.(M a + C v + K q - f + forces of laws)``, shape (n_times,), w being a row, csr_matrix (1, N).

    Of a single supported degree of freedom it is what the support exerts.
    """
    system = model.system
    reduce = model.unknowns.rows

    def product(matrix: Any, kind: str) -> Array:
        return samples.along(reduce(weights @ matrix), kind)

    total = product(model.mass, "a") + product(model.stiffness, "q")
    if model.damping is not None:
        total = total + product(model.damping, "v")
    if system.rayleigh is not None:
        alpha, beta = system.rayleigh
        row = weights @ (alpha * model.mass + beta * model.stiffness)
        total = total + samples.along(reduce(row), "v")
    if system.modal_damping is not None:
        from vofem.linalg.eigen import modal_basis

        if modes is None:
            modes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
        squares, shapes = modes
        rates = samples.along((system.mass @ shapes).T, "v")
        force = shapes @ (system.modal_rates(squares)[:, None] * rates)
        total = total + reduce(weights @ model.mass) @ force
    value = np.asarray(total)[0]
    for vector, load in zip(model.load_vectors, system.loads, strict=True):
        share = float((weights @ vector)[0])
        if share:
            value = value - share * load.function(times)
    recorded = 0
    for rows, group in zip(model.law_rows, system.laws, strict=True):
        column = _shares(rows, weights)
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


def _shares(rows: Any, weights: Any) -> Array:
    """Return by how much the force of each law counts, shape (n_laws,)."""
    return np.asarray((rows @ weights.T).todense())[:, 0]
