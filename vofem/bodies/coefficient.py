"""Quantities along a beam, such as EI, rhoA or a load: a number, one per element or subdomain, or a callable of x."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import TINY, array, nearest, number, one_of, wrong
from vofem.bodies.axis import Axis
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
    """Return what a callable of x gives at points x, in the shape of x, checked.

    `what`: what messages call the coefficient.
    `x`: places on the axis, m.
    `positive`, `negative`: whether values must be positive, and whether they may be negative.
    Raises `ArgumentError` if it is a function of time, fails, or returns what is not allowed.
    """
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

    A callable is tried in the middle of every element; elsewhere it is
    checked where it is used.

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
    if np.ndim(value) == 0:
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
