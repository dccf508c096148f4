"""The axis of a beam: nodes and elements, places on it, fields between nodes, and the supports that hold nodes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import MANY, array, choice, nearest, number, one_of, whole
from vofem.bodies.base import Array, Body, DegreesOfFreedom, IntArray, Point, Row, Shape
from vofem.bodies.cubics import hermite
from vofem.bodies.mesh import LineMesh
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class Axis(Body):
    """The nodes and two-node elements of a beam, in order from the left end.

    Every node has two degrees of freedom, interleaved along the axis: the displacement eta and the slope d(eta)/dx.
    """

    length: float  #: Length of the axis, m.
    origin: float  #: The x of the left end in m.
    #: Distance of the nodes from the left end in m. Kept apart from the origin: far from x = 0 the x of two near nodes
    #: lose digits. Shape (n_elements + 1,).
    arc: Array
    #: Lengths of the elements, m. They are more accurate than differences of `arc`. Shape (n_elements,).
    element_lengths: Array
    mesh: LineMesh | None  #: The named points and subdomains of a mesh file.

    def _divide(self, elements: Any) -> None:
        """Set nodes and elements, from the number of equal elements, the x of all nodes, or a mesh.

        Raises `ArgumentError` if the nodes do not increase, do not span the length, or are too many.
        """
        label, length = self.label, self.length
        self.mesh = elements if isinstance(elements, LineMesh) else None
        if self.mesh is not None:
            self.origin, self.arc, self.element_lengths = self.mesh.origin, self.mesh.arc, self.mesh.lengths
            return
        if isinstance(elements, (int, np.integer)) and not isinstance(elements, bool):
            count = whole(f"{label}: elements", elements, most=MANY)
            self.origin, self.arc = 0.0, np.arange(count + 1, dtype=float) * (length / count)
            self.arc[-1], self.element_lengths = length, np.full(count, length / count)
            return
        if isinstance(elements, (float, str, bool)):
            raise ArgumentError(f"{label}: elements is {elements!r}, expected a whole number or the x of all nodes")
        nodes = array(f"{label}: elements", elements)
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
        self.origin, self.arc, self.element_lengths = float(nodes[0]), nodes - nodes[0], lengths

    @property
    def nodes(self) -> Array:
        """The x of all nodes in m, shape (n_elements + 1,)."""
        return np.asarray(self.origin + self.arc)

    @property
    def size(self) -> int:
        """Number of degrees of freedom, two per node, supported ones included."""
        return 2 * self.arc.size

    @property
    def mesh_file(self) -> Path | None:
        """The mesh file, absolute, of a beam that was made from one."""
        return Path(self.mesh.file) if self.mesh is not None and self.mesh.file else None

    @property
    def degrees_of_freedom(self) -> DegreesOfFreedom:
        """Displacement and slope of every node."""
        return DegreesOfFreedom(np.repeat(self.nodes, 2), np.tile([False, True], self.nodes.size))

    @cached_property
    def shape(self) -> Shape:
        """The axis through its nodes, which moves upward."""
        return Shape("line", self.nodes, self.field_matrix(self.nodes))

    @property
    def scale(self) -> Array:
        """Length, shape (size,), that turns a degree of freedom into a displacement: 1, or of a slope the element's."""
        scale = np.ones(self.size)
        scale[1::2] = np.minimum(np.append(self.element_lengths, np.inf), np.insert(self.element_lengths, 0, np.inf))
        return scale

    def locate(self, x: ArrayLike, what: str = "") -> tuple[IntArray, Array]:
        """Return elements and places in them, from 0 to 1, of points x (m), both of the shape of x.

        At a node the element to its right is taken (the last node: to its left).

        `what`: what x is, for messages.
        """
        what = what or f"a point of {self.label}"
        arc = array(what, x) - self.origin
        slack = 1e-9 * self.length
        if np.any(arc < -slack) or np.any(arc > self.length + slack):
            bad = float(np.ravel(arc)[int(np.argmax(np.ravel((arc < -slack) | (arc > self.length + slack))))])
            raise ArgumentError(
                f"{what} is {self.origin + bad:g} m, expected a point on {self.label}, "
                f"from {self.origin:g} to {self.origin + self.length:g} m; lengths are in m"
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

    def at(self, where: float | str) -> Point:
        """Return the point at x (m, any place on the axis), at "left" or "right", or at a named point of a mesh.

        Raises `ArgumentError` if the point is not on the beam, or a name is unknown or names several nodes.
        """
        what = f"a point of {self.label}"
        if isinstance(where, str):
            return Point(self, float(self.nodes[self._named_node(what, where)]))
        x = number(what, where)
        self.locate(x, what)
        return Point(self, x)

    def node_at(self, where: Any) -> int:
        """Return the number of the node at "left", "right", a named point or x, counted from the left.

        Raises `ArgumentError` if there is no node at x, or a name is unknown or names several nodes.
        """
        what = f"a node of {self.label}"
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
        element, xi = self.locate(number(what, where), what)
        if xi not in (0.0, 1.0):
            left, right = self.nodes[int(element)], self.nodes[int(element) + 1]
            cure = "Put a node there in the mesh" if self.mesh else "Give elements= the x of all nodes with this one"
            raise ArgumentError(
                f"{what} is {where!r}, which is not a node; the nearest are {left:g} and {right:g} m. {cure}"
            )
        return int(element) + int(xi == 1.0)

    # -- fields -----------------------------------------------------------------------------------

    def _cubics(self, x: ArrayLike, derivative: int) -> tuple[IntArray, Array]:
        """Return degrees of freedom and weights of a derivative of eta at x, each of shape (len(x), 4)."""
        places = np.atleast_1d(array(f"a point of {self.label}", x))
        if places.ndim != 1:
            raise ArgumentError(f"points of {self.label} have shape {places.shape}, expected one dimension")
        element, xi = self.locate(places)
        h = self.element_lengths[element]
        weights = np.stack([hermite(i, xi, h, derivative) for i in range(4)], axis=1)
        return 2 * element[:, None] + np.arange(4), weights

    def field_matrix(self, x: ArrayLike, derivative: int = 0) -> csr_matrix:
        """Return the matrix that takes the degrees of freedom to a derivative of eta at x.

        At a node the value is that of the element to its right, and at the last node that of the element to its left.

        `x` (shape (k,)): place on the axis, m.
        `derivative`: 0 to 3.
        Returns an array of shape (k, size).
        """
        from scipy.sparse import csr_matrix

        columns, weights = self._cubics(x, derivative)
        count = weights.shape[0]
        ends = 4 * np.arange(count + 1)
        return csr_matrix((weights.ravel(), columns.ravel(), ends), shape=(count, self.size))

    def row_at(self, x: float, derivative: int = 0) -> Row:
        """Return the row of eta or of a derivative at x; one entry at a node, four between nodes."""
        columns, weights = self._cubics([x], derivative)
        keep: NDArray[np.bool_] = weights[0] != 0.0
        return Row(columns[0][keep], weights[0][keep])


#: Degrees of freedom (0: displacement, 1: slope) that a support holds at its node.
SUPPORTS: dict[str, tuple[int, ...]] = {"clamped": (0, 1), "pinned": (0,), "guided": (1,)}


class ByNode(dict[int, str]):
    """The kind of support of every supported node, counted from the left."""


def supported_nodes(axis: Axis, supports: Mapping[Any, str] | None) -> ByNode:
    """Return the kind of support of every supported node, from kinds by place.

    What is known by node already stays, because the x of a node may differ from the node in its last bit.

    Raises `ArgumentError` if a place or a kind is unknown, or one node is given two kinds.
    """
    label = axis.label
    if isinstance(supports, ByNode):
        return ByNode(supports)
    if supports is not None and not isinstance(supports, Mapping):
        raise ArgumentError(f"{label}: supports is {supports!r}, expected a dict such as {{'left': 'clamped'}}")
    held = ByNode()
    for where, given in (supports or {}).items():
        kind = choice(f"{label}: support at {where!r}", given, tuple(SUPPORTS))
        for node in axis.nodes_at(f"{label}: the place of a support", where).tolist():
            if held.setdefault(node, kind) != kind:
                raise ArgumentError(
                    f"{label}: the support at {where!r} is {kind!r}, but that node (x = {axis.nodes[node]:g} m) "
                    f"is {held[node]!r} under another name; keep one ('clamped' is pinned and guided)"
                )
    return held


def supported_dofs(supports: Mapping[int, str]) -> IntArray:
    """Return the degrees of freedom, in order, that are held at zero."""
    held = [2 * node + dof for node, kind in supports.items() for dof in SUPPORTS[kind]]
    return np.unique(np.array(held, dtype=np.int64))
