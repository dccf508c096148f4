"""The axis of a beam: its nodes and elements, and how places on it are named and found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, nearest, number, one_of
from vofem.bodies.base import Array, IntArray
from vofem.bodies.cubics import hermite
from vofem.bodies.mesh import LineMesh
from vofem.errors import ArgumentError

_MOST_ELEMENTS = 10_000_000


@dataclass(frozen=True, eq=False)
class Axis:
    """Nodes and two-node elements in order from the left end.

    Every node has two degrees of freedom, interleaved along the axis: the
    displacement eta and the slope d(eta)/dx.

    Attributes
    ----------
    label : str
        The beam, for messages, such as ``Beam 'deck'``.
    length : float
        Length of the axis, m.
    origin : float
        The x of the left end in m.
    arc : ndarray, shape (n_elements + 1,)
        Distance of the nodes from the left end in m. Kept apart from the
        origin: far from x = 0 the x of two near nodes lose digits.
    element_lengths : ndarray, shape (n_elements,)
        Lengths of the elements, m. They are more accurate than differences of `arc`.
    mesh : LineMesh, optional
        What names nodes and elements.
    """

    label: str
    length: float
    origin: float
    arc: Array
    element_lengths: Array
    mesh: LineMesh | None = None

    @property
    def nodes(self) -> Array:
        """The x of all nodes in m, shape (n_elements + 1,)."""
        return np.asarray(self.origin + self.arc)

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return 2 * self.arc.size

    @property
    def scale(self) -> Array:
        """Length, shape (size,), that turns a degree of freedom into a displacement: 1, or of a slope the element's."""
        scale = np.ones(self.size)
        scale[1::2] = np.minimum(np.append(self.element_lengths, np.inf), np.insert(self.element_lengths, 0, np.inf))
        return scale

    def locate(self, what: str, x: ArrayLike) -> tuple[IntArray, Array]:
        """Return element indices and element coordinates of the points x, both of the shape of x.

        At a node the element to its right is taken (the last node: to its left).
        """
        arc = array(what, x) - self.origin
        slack = 1e-9 * self.length
        if np.any(arc < -slack) or np.any(arc > self.length + slack):
            bad = float(np.ravel(arc)[int(np.argmax(np.ravel((arc < -slack) | (arc > self.length + slack))))])
            raise ArgumentError(
                f"{what} is {self.origin + bad:g} m, expected a point on {self.label}, "
                f"from {self.origin:g} to {self.origin + self.length:g} m"
            )
        arc = np.clip(arc, 0.0, self.arc[-1])
        element = np.clip(np.searchsorted(self.arc, arc, side="right") - 1, 0, self.element_lengths.size - 1)
        xi = (arc - self.arc[element]) / self.element_lengths[element]
        # A point given in decimal and a node computed in binary are meant to be the same.
        snap = 1e-9
        at_end = (xi > 1.0 - snap) & (element < self.element_lengths.size - 1)
        element = np.where(at_end, element + 1, element)
        xi = np.where(at_end | (xi < snap), 0.0, np.where(xi > 1.0 - snap, 1.0, xi))
        return element, xi

    def cubics(self, x: ArrayLike, derivative: int) -> tuple[IntArray, Array]:
        """Return degrees of freedom and weights of a derivative of eta at x, each of shape (len(x), 4)."""
        element, xi = self.locate(f"a point of {self.label}", np.atleast_1d(array(f"a point of {self.label}", x)))
        h = self.element_lengths[element]
        weights = np.stack([hermite(i, xi, h, derivative) for i in range(4)], axis=1)
        return 2 * element[:, None] + np.arange(4), weights

    def position(self, what: str, where: Any) -> float:
        """Return the x in m of a point given by its x, as "left" or "right", or by the name of one node."""
        if isinstance(where, str):
            return float(self.nodes[self._named_node(what, where)])
        x = number(what, where)
        self.locate(what, x)
        return x

    def node(self, what: str, where: Any) -> int:
        """Return the one node at an x or of a name."""
        return self._named_node(what, where) if isinstance(where, str) else self._node_by_x(what, where)

    def nodes_at(self, what: str, where: Any) -> IntArray:
        """Return the nodes, shape (k,), at an x (one) or of a name (one or more)."""
        return self._named_nodes(what, where) if isinstance(where, str) else np.array([self._node_by_x(what, where)])

    def _named_nodes(self, what: str, where: str) -> IntArray:
        ends = {"left": 0, "right": self.arc.size - 1}
        if where in ends:
            return np.array([ends[where]])
        if self.mesh is not None and where in self.mesh.points:
            return self.mesh.nodes_named(what, where)
        names = (*ends, *(self.mesh.points if self.mesh is not None else ()))
        raise ArgumentError(f"{what} is {where!r}, expected an x or {one_of(names)}{nearest(where, names)}")

    def _named_node(self, what: str, where: str) -> int:
        nodes = self._named_nodes(what, where)
        if nodes.size > 1:
            places = ", ".join(f"{x:g}" for x in self.nodes[nodes[:5]]) + (", ..." if nodes.size > 5 else "")
            raise ArgumentError(f"{what} is {where!r}, which names {nodes.size} nodes (x = {places} m); give one x")
        return int(nodes[0])

    def _node_by_x(self, what: str, where: Any) -> int:
        element, xi = self.locate(what, number(what, where))
        if xi not in (0.0, 1.0):
            left, right = self.nodes[int(element)], self.nodes[int(element) + 1]
            cure = "Put a node there in the mesh" if self.mesh else "Give elements= the x of all nodes with this one"
            raise ArgumentError(
                f"{what} is {where!r}, which is not a node; the nearest are {left:g} and {right:g} m. {cure}"
            )
        return int(element) + int(xi == 1.0)


def axis_of(label: str, length: float, elements: Any) -> Axis:
    """Return the axis of a beam.

    Parameters
    ----------
    label : str
        The beam, for messages.
    length : float
        Length of the axis, m, positive.
    elements : int, array_like or LineMesh
        The number of equal elements, the x of all nodes, or a mesh.

    Raises
    ------
    ArgumentError
        If the nodes do not increase, do not span the length, or are too many.
    """
    if isinstance(elements, LineMesh):
        return Axis(label, length, elements.origin, elements.arc, elements.lengths, elements)
    if isinstance(elements, (int, np.integer)) and not isinstance(elements, bool):
        return _equal_elements(label, length, int(elements))
    if isinstance(elements, (float, str, bool)):
        raise ArgumentError(f"{label}: elements is {elements!r}, expected a whole number or the x of all nodes")
    return _between_nodes(label, length, array(f"{label}: elements", elements))


def _equal_elements(label: str, length: float, count: int) -> Axis:
    if not 1 <= count <= _MOST_ELEMENTS:
        raise ArgumentError(f"{label}: elements is {count}, expected 1 to {_MOST_ELEMENTS}")
    arc = np.arange(count + 1, dtype=float) * (length / count)
    arc[-1] = length
    return Axis(label, length, 0.0, arc, np.full(count, length / count))


def _between_nodes(label: str, length: float, nodes: Array) -> Axis:
    if nodes.ndim != 1 or nodes.size < 2:
        raise ArgumentError(f"{label}: elements has shape {nodes.shape}, expected the x of two or more nodes")
    lengths = np.diff(nodes)
    if np.any(lengths <= 0):
        k = int(np.argmax(lengths <= 0))
        raise ArgumentError(
            f"{label}: node x must increase, found x[{k}] = {nodes[k]:g} followed by x[{k + 1}] = {nodes[k + 1]:g}"
        )
    if not np.isclose(nodes[-1] - nodes[0], length, rtol=1e-9, atol=0.0):
        raise ArgumentError(f"{label}: the nodes span {nodes[-1] - nodes[0]:g} m, expected the length {length:g} m")
    return Axis(label, length, float(nodes[0]), nodes - nodes[0], lengths)
