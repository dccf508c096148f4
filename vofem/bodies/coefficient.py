"""Quantities along a beam, such as EI or a load: a number, one per element or subdomain, or a callable of x."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import TINY, array, nearest, number, one_of, wrong
from vofem.bodies.axis import SUPPORTS, Axis, supported_dofs
from vofem.bodies.base import Array
from vofem.bodies.mesh import LineMesh
from vofem.errors import ArgumentError, MissingCallableError

if TYPE_CHECKING:
    from skfem import Basis

#: Quadrature for coefficients that vary: exact for a product of degree 12.
VARIABLE_ORDER = 12

#: Quadrature for coefficients that are constant in an element: exact for the mass matrix.
_CONSTANT_ORDER = 6


def evaluate_along(what: str, function: Any, x: Array, *, positive: bool = False, negative: bool = True) -> Array:
    """Return a number, or what a callable of x gives, checked, at points x, in the shape of x.

    `what`: what messages call the coefficient.
    `x`: places on the axis, m.
    `positive`, `negative`: whether values must be positive, and whether they may be negative.
    Raises `ArgumentError` if it is a function of time, fails, or returns what is not allowed.
    """
    if not callable(function):
        return np.full(x.shape, function)
    if hasattr(function, "breakpoints"):
        raise ArgumentError(
            f"{what} is {function!r}, a function of time, where a function of x is meant; "
            "a load's course in time is given as f="
        )
    try:
        values = np.broadcast_to(np.asarray(function(x), dtype=float), x.shape)
    except MissingCallableError:
        raise
    except Exception as error:
        raise ArgumentError(
            f"{what} must be a callable that takes an array of x (any shape) and returns one value for each; it "
            f"raised: {error}. Where it branches, use np.where(x < 2.0, ..., ...)"
        ) from error
    bad = ~np.isfinite(values)
    expected = "a finite number"
    if positive or not negative:
        bad |= (values < TINY) if positive else (values < 0)
        expected = f"a positive number of at least {TINY:g}" if positive else "a number that is not negative"
    if np.any(bad):
        k = np.unravel_index(int(np.argmax(bad)), x.shape)
        raise wrong(what, f"{values[k]:g} at x = {x[k]:g} m", expected)
    return values


@dataclass(frozen=True, eq=False)
class Coefficient:
    """A quantity along an axis, whose values are checked when they are taken."""

    what: str  #: The name for messages, such as ``Beam 'deck': EI``.
    value: Any  #: Shape (n_elements,).
    axis: Axis
    positive: bool = True  #: Whether a callable that returns zero or less is refused.

    def evaluate(self, x: Array) -> Array:
        """Return what the callable gives at x, in the shape of x.

        Raises `ArgumentError` if it fails, or returns what is not finite or not positive.
        """
        return evaluate_along(self.what, self.value, x, positive=self.positive)

    def at_quadrature(self, basis: Basis) -> Any:
        """Return the values where scikit-fem wants them: a number, or an array of shape (n_elements, n_points)."""
        if callable(self.value):
            return self.evaluate(self.axis.origin + basis.mapping.F(basis.X)[0])
        if np.ndim(self.value) == 0:
            return float(self.value)
        shape = (self.axis.element_lengths.size, basis.X.shape[-1])
        return np.broadcast_to(np.asarray(self.value)[:, None], shape).copy()

    def with_slope(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return value and derivative by x at the points x, each of shape (k,); at a node, to its right."""
        x = np.atleast_1d(array(f"a point of {self.axis.label}", x))
        element, xi = self.axis.locate(x)
        if np.ndim(self.value) == 1:
            return self.value[element], np.zeros(x.shape)
        if not callable(self.value):
            return np.full(x.shape, self.value), np.zeros(x.shape)
        # The polynomial through five Chebyshev points of the element: exact for a tapered section.
        points = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)
        h = self.axis.element_lengths[element]
        values = self.evaluate(self.axis.origin + self.axis.arc[element][:, None] + points * h[:, None])
        coefficients = np.linalg.solve(np.vander(points, 5, increasing=True), values.T)
        powers = np.arange(1, 5)
        slope = np.sum(powers[:, None] * coefficients[1:] * xi ** (powers[:, None] - 1), axis=0) / h
        return self.evaluate(x), slope


def positive_coefficient(what: str, value: Any, axis: Axis) -> Coefficient:
    """Return a coefficient that is positive along the axis.

    A callable is tried in the middle of every element; elsewhere it is checked where it is used.

    Raises `ArgumentError` for values that are not positive, or do not fit elements or subdomains.
    """
    if callable(value):
        coefficient = Coefficient(what, value, axis)
        coefficient.evaluate(axis.origin + 0.5 * (axis.arc[:-1] + axis.arc[1:]))
        return coefficient
    if isinstance(value, Mapping):
        if axis.mesh is None:
            raise ArgumentError(f"{what} is {value!r}, but only a beam from a mesh has named subdomains")
        return Coefficient(what, _by_subdomain(what, value, axis.mesh), axis)
    if not isinstance(value, (list, tuple)) and np.ndim(value) == 0:
        return Coefficient(what, number(what, value, positive=True), axis)
    values = array(what, value, shape=axis.element_lengths.shape)
    if np.any(values < TINY):
        raise ArgumentError(
            f"{what} is {values.min():g} in element {values.argmin()}, expected a positive number of at least {TINY:g}"
        )
    return Coefficient(what, values, axis)


def _by_subdomain(what: str, values: Mapping[Any, Any], mesh: LineMesh) -> Array:
    """Return one value per element, shape (n_elements,), from one per named subdomain."""
    known = tuple(mesh.subdomains)
    result = np.zeros(mesh.lengths.size)
    owner: dict[int, str] = {}
    for name, value in values.items():
        if name not in mesh.subdomains:
            expected = one_of(known) if known else "none: the mesh has no named subdomain"
            raise ArgumentError(f"{what} names the subdomain {name!r}, expected {expected}{nearest(name, known)}")
        one = number(f"{what} of subdomain {name!r}", value, positive=True)
        for element in mesh.subdomains[name].tolist():
            if element in owner:
                raise ArgumentError(
                    f"{what}: the subdomains {owner[element]!r} and {name!r} overlap in "
                    f"{mesh.describe_element(element)}; give values for subdomains that share no element"
                )
            owner[element] = name
        result[mesh.subdomains[name]] = one
    if len(owner) < result.size:
        element = next(k for k in range(result.size) if k not in owner)
        holders = [name for name in known if element in mesh.subdomains[name]]
        cure = f"give a value for {holders[0]!r}" if holders else "no named subdomain of the mesh holds it"
        raise ArgumentError(f"{what} has no value for {mesh.describe_element(element)}: {cure}")
    return result


def basis_for(axis: Axis, *values: Any) -> Basis:
    """Return a scikit-fem basis on the axis whose quadrature suits coefficients like `values`."""
    from vofem.bodies.hermite import line_basis

    order = VARIABLE_ORDER if any(callable(value) for value in values) else _CONSTANT_ORDER
    return line_basis(axis.arc, axis.element_lengths, order)


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
