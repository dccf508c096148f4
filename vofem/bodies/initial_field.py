"""Initial displacements and velocities of a beam, projected on its elements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem._validate import number
from vofem.bodies.axis import Axis
from vofem.bodies.base import Array
from vofem.bodies.coefficient import Coefficient, basis_for
from vofem.bodies.supports import SUPPORTS, supported_dofs
from vofem.errors import ArgumentError


def project(label: str, field: Any, axis: Axis, supports: Mapping[int, str]) -> Array:
    """Return the degrees of freedom, shape (size,), of a field projected in L2 on the supported space.

    `label`: the field, for messages, such as ``initial velocity of Beam 'deck'``.
    `field`: the field: a number or a callable of x, m or m/s.
    `supports`: the kind of support of every supported node.
    Raises `ArgumentError` if the field is not finite, or is not zero at a support.
    """
    if not callable(field):
        constant = number(label, field)
        if constant == 0.0:
            return np.zeros(axis.size)
        return project(label, lambda x: np.full(np.shape(x), constant), axis, supports)
    given = Coefficient(label, field, axis, positive=False)
    _check_supports(given, supports)
    from scipy.sparse.linalg import spsolve

    from vofem.bodies import hermite as forms

    basis = basis_for(axis, field)
    values = given.at_quadrature(basis)
    free = np.setdiff1d(np.arange(axis.size), supported_dofs(supports))
    gram = forms.inertia.assemble(basis, coefficient=1.0)
    moments = np.asarray(forms.distributed.assemble(basis, coefficient=values))
    result = np.zeros(axis.size)
    if free.size:
        # Slopes in units of one element length keep the system well conditioned on any mesh.
        balance = 1.0 / axis.scale[free]
        scaled = gram.tocsc()[free][:, free].multiply(balance[:, None]).multiply(balance[None, :])
        result[free] = balance * spsolve(scaled.tocsc(), balance * moments[free])
    return result


def _check_supports(field: Coefficient, supports: Mapping[int, str]) -> None:
    axis, nodes = field.axis, field.axis.nodes
    values = field.evaluate(nodes)
    # At the nodes alone a field on one element between two supports would count as zero.
    size = float(np.max(np.abs(np.append(values, field.evaluate(0.5 * (nodes[:-1] + nodes[1:]))))))
    for node, kind in supports.items():
        x = nodes[node]
        where = f"at x = {x:g} m, where the beam is {kind}; expected 0"
        if 0 in SUPPORTS[kind] and abs(values[node]) > 1e-9 * size:
            raise ArgumentError(f"{field.what} is {values[node]:g} {where}")
        if 1 in SUPPORTS[kind]:
            slope = _slope(field, node, x)
            if abs(slope) * axis.length > 1e-6 * size:
                raise ArgumentError(f"{field.what} has the slope {slope:g} {where}")


def _slope(field: Coefficient, node: int, x: float) -> float:
    """Return the slope of a callable at a node by a difference of third order into the beam."""
    inward = 1.0 if node == 0 else -1.0
    element = 0 if node == 0 else node - 1
    step = 1e-3 * field.axis.element_lengths[element] * inward
    near = field.evaluate(x + step * np.arange(4))
    return float(near @ np.array([-11.0, 18.0, -9.0, 2.0])) / (6.0 * step)
