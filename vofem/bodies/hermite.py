"""The Hermite element for scikit-fem, evaluated in element coordinates.

scikit-fem's own `ElementLineHermite` inverts a monomial basis in global coordinates, which loses digits with the number
of elements and with the distance from the origin, and keeps the first mesh's basis when the element is used on a second
mesh. The element here has the same degrees of freedom, ``(eta, eta')`` per node, and no state.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from skfem import Basis, BilinearForm, LinearForm, MeshLine
from skfem.element import ElementLineHermite
from skfem.element.discrete_field import DiscreteField
from skfem.mapping import MappingAffine
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine

from vofem.arrays import Array
from vofem.bodies.cubics import hermite


class HermiteElement(ElementLineHermite):
    """The C1 cubic line element with value, first and second derivative."""

    def gbasis(self, mapping: Any, X: Array, i: int, tind: Any = None) -> tuple[DiscreteField]:
        """Return the i-th basis function on the elements `tind`."""
        h = mapping.detDF(X, tind=tind)
        xi = np.broadcast_to(X[0], h.shape)
        return (
            DiscreteField(
                value=hermite(i, xi, h), grad=hermite(i, xi, h, 1)[None], hess=hermite(i, xi, h, 2)[None, None]
            ),
        )


class LengthMapping(MappingAffine):
    """The affine map of a line mesh whose element lengths are known better than from its nodes.

    With 1e5 uniform elements on a unit length, a difference of nodal
    coordinates is good to eleven digits only; ``length / elements`` is exact.
    """

    def __init__(self, mesh: MeshLine, lengths: Array) -> None:
        super().__init__(mesh)
        self._A = lengths[None, None, :]
        self._b = mesh.p[:, mesh.t[0]]


def line_basis(nodes: Array, lengths: Array, order: int) -> Basis:
    """Return a Hermite basis over sorted nodes, with quadrature exact for polynomials of the given order.

    `nodes` (shape (n + 1,)): arc length of the nodes in m, increasing from 0.
    `lengths` (shape (n,)): element lengths in m.
    `order`: 6 integrates the mass matrix of a constant rhoA exactly.
    """
    mesh = MeshLine(nodes)
    mapping = LengthMapping(mesh, lengths)
    return Basis(mesh, HermiteElement(), mapping=mapping, quadrature=_quadrature(order), disable_doflocs=True)


@cache
def _quadrature(order: int) -> tuple[Array, Array]:
    """Return points (1, k) and weights (k,) on [0, 1] exact for polynomials of the given order."""
    points, weights = get_quadrature(RefLine, order)
    return points, weights


@BilinearForm
def bending(u: Any, v: Any, w: Any) -> Any:
    """Bending stiffness, the weak form of ``(EI eta'')''``."""
    return w.coefficient * u.hess[0, 0] * v.hess[0, 0]


@BilinearForm
def inertia(u: Any, v: Any, w: Any) -> Any:
    """Consistent mass, the weak form of ``rhoA eta``; also a Winkler foundation."""
    return w.coefficient * u * v


@BilinearForm
def string(u: Any, v: Any, w: Any) -> Any:
    """Geometric stiffness of an axial tension, the weak form of ``-(T eta')'``."""
    return w.coefficient * u.grad[0] * v.grad[0]


@LinearForm
def distributed(v: Any, w: Any) -> Any:
    """Load vector of a force per length."""
    return w.coefficient * v
