"""Support reactions from the equations of motion of the supported degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.assembly import Model
from vofem.bodies.base import Body
from vofem.integrators.base import Sampled
from vofem.laws.moving import Moving


def support_reaction(
    model: Model,
    body: Body,
    where: Any,
    times: Array,
    samples: Sampled,
    forces: Sequence[Array | None],
    modes: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return force (N) and moment (N m) that a support exerts, each of shape (n_times,).

    `forces`: of the laws of each group in N, shape (n_laws, n_times); None where they are not known.
    `modes`: squared frequencies and shapes that modal damping acts on; all modes where not given.
    Raises `ArgumentError` if there is no support at that place.
    """
    result = np.zeros((2, times.size))
    for dof in body.supported_at(where).tolist():
        row = model.unknowns.support_row(model.offsets[body] + dof, model.size)
        kind = int(body.degrees_of_freedom.rotation[dof])
        result[kind] += residual(model, row, times, samples, forces, modes)
    return result[0], result[1]


def residual(
    model: Model,
    weights: Any,
    times: Array,
    samples: Sampled,
    forces: Sequence[Array | None],
    modes: tuple[Array, Array] | None,
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
    for rows, group, known in zip(model.law_rows, system.laws, forces, strict=True):
        shares = _shares(model, rows, group.moving, weights, times)
        if not np.any(shares):
            continue
        value = value + np.sum(np.where(shares, np.nan, 0.0) if known is None else shares * known, axis=0)
    return value


def _shares(model: Model, rows: Any, moving: Moving | None, weights: Any, times: Array) -> Array:
    """Return by how much the force of each law counts, shape (n_laws, 1), or (n_laws, n_times) if some travel."""
    shares = np.asarray((rows @ weights.T).todense())
    if moving is None or not moving.riders:
        return shares
    shares, every = np.repeat(shares, times.size, axis=1), weights.toarray()[0]
    for law, rider in moving.riders.items():
        dofs, parts = rider.track.cubics(rider.start + times)
        shares[law] += rider.sign * np.sum(parts * every[model.offsets[rider.track.body] + dofs], axis=1)
    return shares
