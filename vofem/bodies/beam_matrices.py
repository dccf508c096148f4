"""Mass, stiffness, strains and loads of an Euler-Bernoulli beam on Hermite elements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from vofem.bodies.axis import Axis, supported_dofs
from vofem.bodies.base import Array, BodyMatrices
from vofem.bodies.coefficient import VARIABLE_ORDER, Coefficient, basis_for
from vofem.bodies.cubics import hermite, rows_on_elements

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def beam_matrices(
    axis: Axis, EI: Coefficient, rhoA: Coefficient, tension: float, supports: Mapping[int, str]
) -> BodyMatrices:
    """Return mass and stiffness over all nodes, and the supported degrees of freedom.

    `EI`, `rhoA`: bending stiffness, N m^2, and mass per length, kg/m.
    `tension`: axial force in N.
    `supports`: the kind of support of every supported node.
    """
    from vofem.bodies import hermite as forms

    basis = basis_for(axis, EI.value, rhoA.value)
    bending = EI.at_quadrature(basis)
    inertia = rhoA.at_quadrature(basis)
    # What overflows here is found, and named, when the matrices are gathered.
    with np.errstate(over="ignore", invalid="ignore"):
        stiffness = forms.bending.assemble(basis, coefficient=bending)
        mass = forms.inertia.assemble(basis, coefficient=inertia)
    if tension:
        stiffness = stiffness + forms.string.assemble(basis, coefficient=tension)
    return BodyMatrices(
        mass=mass.tocsr(),
        stiffness=stiffness.tocsr(),
        damping=None,
        supported=supported_dofs(supports),
        scale=axis.scale,
    )


@np.errstate(over="ignore")
def beam_strains(axis: Axis, EI: Coefficient, tension: float) -> csr_matrix:
    """Return rows, shape (n_strains, size), of strains whose squares sum to twice the energy of bending and tension.

    Of an element with constant EI they are the difference of its slopes and its deviation from a parabola, both free of
    the cancellation in K; tension, not negative, adds slopes at three Gauss points.
    """
    h = axis.element_lengths
    if callable(EI.value):
        nodes, weights = np.polynomial.legendre.leggauss(VARIABLE_ORDER // 2 + 1)
        xi = 0.5 * (1.0 + nodes)
        x = axis.origin + axis.arc[:-1, None] + xi * h[:, None]
        root = np.sqrt(EI.evaluate(x) * 0.5 * weights * h[:, None])
        entries = np.stack([root * hermite(i, xi, h[:, None], 2) for i in range(4)], axis=-1)
    else:
        stiffness = np.broadcast_to(np.asarray(EI.value, dtype=float), h.shape)
        entries = np.zeros((h.size, 2, 4))
        entries[:, 0] = np.sqrt(12.0 * stiffness / h**3)[:, None] * np.stack(
            [np.ones_like(h), 0.5 * h, -np.ones_like(h), 0.5 * h], axis=1
        )
        entries[:, 1, 1] = np.sqrt(stiffness / h)
        entries[:, 1, 3] = -entries[:, 1, 1]
    if tension:
        nodes, weights = np.polynomial.legendre.leggauss(3)
        xi = 0.5 * (1.0 + nodes)
        root = np.sqrt(tension * 0.5 * weights * h[:, None])
        slopes = np.stack([root * hermite(i, xi, h[:, None], 1) for i in range(4)], axis=-1)
        entries = np.concatenate([entries, slopes], axis=1)
    return rows_on_elements(entries)


def consistent_load(load: Coefficient) -> Array:
    """Return the consistent load vector, shape (size,), of a force per length in N/m."""
    from vofem.bodies import hermite as forms

    basis = basis_for(load.axis, load.value)
    return np.asarray(forms.distributed.assemble(basis, coefficient=load.at_quadrature(basis)))
