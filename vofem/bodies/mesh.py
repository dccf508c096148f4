"""The mesh of a beam: a chain of two-node lines put in order, with its named points and subdomains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vofem._validate import HUGE
from vofem.bodies.base import Array, IntArray
from vofem.errors import ArgumentError, MeshError

#: Largest distance of a node from the straight line between the ends, over the length. Single precision suffices.
STRAIGHT = 1e-6

#: Largest deviation of an axis from the direction of x, over the length, at which x is used as its coordinate.
_ALONG_X = 1e-9


@dataclass(frozen=True, eq=False)
class LineMesh:
    """The nodes of a straight beam in order from its left end."""

    source: str  #: Where it came from, for messages.
    origin: float  #: The x of the left end in m; 0 where the axis is not along x.
    arc: Array  #: Arc length of the nodes from the left end in m, shape (n_elements + 1,).
    lengths: Array  #: Element lengths in m, from differences of the coordinates, shape (n_elements,).
    #: Nodes of every named point set, counted from the left; empty where a set lies off the beam.
    points: dict[str, IntArray]
    subdomains: dict[str, IntArray]  #: Elements of every named subdomain, counted from the left.
    file: str = ""  #: Absolute path of the file; empty where it came from none.

    @property
    def length(self) -> float:
        """Distance of the ends in m."""
        return float(self.arc[-1])

    def nodes_named(self, what: str, name: str) -> IntArray:
        """Return the nodes, one or more, of a named point set of the mesh."""
        nodes = self.points[name]
        if not nodes.size:
            raise ArgumentError(f"{what} is {name!r}, which in {self.source} names no node of the beam")
        return nodes

    def describe_element(self, k: int) -> str:
        """Return number and place of an element, for messages."""
        start = self.origin + self.arc[k]
        return f"element {k}, from {start:g} to {start + self.lengths[k]:g} m"


def chain(
    source: str,
    coordinates: Array,
    lines: IntArray,
    points: Mapping[str, IntArray],
    subdomains: Mapping[str, IntArray],
) -> LineMesh:
    """Put lines in order and measure them.

    The left end is the end with the smaller x; where these agree the smaller
    y, then z. For an axis along +x the x of the mesh is the x of the beam;
    for any other, x is the arc length from the left end. Nodes that no line
    uses do not matter, and lines that are given twice count once.

    `source`: the file, for messages.
    `coordinates` (shape (n_nodes, 3)): coordinates of the nodes, m.
    `lines` (shape (n_lines, 2)): the two nodes of each line, in any order and direction.
    `points`, `subdomains`: nodes of named point sets; lines of named subdomains.
    Raises `MeshError` if the lines are not one straight, open, unbranched chain.
    """
    if lines.min() < 0 or lines.max() >= len(coordinates):
        raise MeshError(
            f"{source}: a line names node {lines.max() if lines.min() >= 0 else lines.min()} (counted from 0), which "
            f"is not among the {len(coordinates)} nodes; the file is damaged, write it again"
        )
    used = np.unique(lines)
    bad = ~np.all(np.abs(coordinates[used]) <= HUGE, axis=1)
    if np.any(bad):
        node = int(used[np.argmax(bad)])
        raise MeshError(f"{source}: node {_place(coordinates, node)} has a coordinate that is not a finite number")
    same = lines[:, 0] == lines[:, 1]
    if np.any(same):
        node = int(lines[np.argmax(same), 0])
        raise MeshError(f"{source}: a line joins the node at {_place(coordinates, node)} with itself; remove it")
    unique, which = np.unique(np.sort(lines, axis=1), axis=0, return_inverse=True)
    order, edges = _follow(source, coordinates, unique)
    if _first_is_right(coordinates[order[0]], coordinates[order[-1]]):
        order, edges = order[::-1], edges[::-1]
    origin, arc, lengths = _measure(source, coordinates, order)

    node_number = np.full(len(coordinates), -1)
    node_number[order] = np.arange(order.size)
    element_number = np.empty(len(unique), dtype=np.int64)
    element_number[edges] = np.arange(edges.size)
    numbered = {name: np.unique(node_number[members]) for name, members in points.items()}
    mesh = LineMesh(
        source=source,
        origin=origin,
        arc=arc,
        lengths=lengths,
        points={name: members[members >= 0] for name, members in numbered.items()},
        subdomains={name: np.unique(element_number[which.ravel()[k]]) for name, k in subdomains.items()},
    )
    for name, node in (("left", 0), ("right", arc.size - 1)):
        if name in mesh.points and mesh.points[name].tolist() != [node]:
            raise MeshError(
                f"{source}: the point set {name!r} is not the {name} end of the beam, which is the end at "
                f"{_place(coordinates, int(order[node]))}; give it another name"
            )
    return mesh


def _place(coordinates: Array, node: int) -> str:
    return "(" + ", ".join(f"{value:g}" for value in coordinates[node]) + ")"


def _follow(source: str, coordinates: Array, lines: IntArray) -> tuple[IntArray, IntArray]:
    """Return nodes and lines in the order in which they are met from one end to the other."""
    degree = np.bincount(lines.ravel(), minlength=len(coordinates))
    if degree.max() > 2:
        raise MeshError(
            f"{source}: the line branches at {_place(coordinates, int(degree.argmax()))}, where {degree.max()} "
            "elements meet; expected one chain of elements. Make one Beam for each branch"
        )
    ends = np.flatnonzero(degree == 1)
    if ends.size == 0:
        raise MeshError(f"{source}: the lines form a closed loop; expected a chain with two ends")
    # The (at most two) lines at every node: slots of one flat array.
    at = np.argsort(lines.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(degree)]).tolist()
    line_at = (at // 2).tolist()
    other = lines.ravel()[at ^ 1].tolist()
    node, line = int(ends[0]), -1
    nodes, passed = [node], []
    while True:
        onward = [k for k in range(first[node], first[node + 1]) if line_at[k] != line]
        if not onward:
            break
        line, node = line_at[onward[0]], other[onward[0]]
        nodes.append(node)
        passed.append(line)
    if len(passed) < len(lines):
        ends = ends[:1000]  # all pairs are compared
        gap = np.linalg.norm(coordinates[ends[:, None]] - coordinates[ends[None, :]], axis=-1)
        closest = np.min(gap[np.triu_indices(ends.size, 1)])
        cure = (
            "two of their ends lie in the same place: merge duplicate nodes (Coherence in Gmsh)"
            if ends.size > 2 and closest <= 1e-9 * np.max(gap)
            else "write each line into a file of its own"
        )
        raise MeshError(
            f"{source}: the lines are not connected: only {len(passed)} of {len(lines)} elements can be reached from "
            f"the end at {_place(coordinates, nodes[0])}; {cure}"
        )
    return np.array(nodes), np.array(passed)


def _first_is_right(first: Array, last: Array) -> bool:
    step = last - first
    clear = np.abs(step) > _ALONG_X * np.linalg.norm(step)
    return bool(np.any(clear) and step[np.argmax(clear)] < 0)


def _measure(source: str, coordinates: Array, order: IntArray) -> tuple[float, Array, Array]:
    """Return the x of the left end, the arc length of the nodes and the element lengths."""
    nodes = coordinates[order]
    # Differences first: far from the origin nothing more is lost than the file has lost already.
    steps = np.diff(nodes, axis=0)
    offsets = nodes - nodes[0]
    short = np.linalg.norm(steps, axis=1) <= 1e-14 * np.max(np.abs(offsets))
    if np.any(short):
        k = int(np.argmax(short))
        raise MeshError(
            f"{source}: an element at {_place(nodes, k)} has no length; merge duplicate nodes and remove the element"
        )
    chord = float(np.linalg.norm(offsets[-1]))
    straight = chord > 0.0
    deviation, worst = np.inf, 0
    if straight:
        if np.max(np.abs(offsets[:, 1:])) <= _ALONG_X * chord:
            return float(nodes[0, 0]), *_increasing(source, nodes, offsets[:, 0], steps[:, 0])
        axis = offsets[-1] / chord
        arc = offsets @ axis
        off = np.linalg.norm(offsets - arc[:, None] * axis, axis=1)
        worst = int(np.argmax(off))
        deviation = float(off[worst])
        straight = deviation <= STRAIGHT * chord
    if not straight:
        what = f"lies {deviation:g} m off the line between its ends" if np.isfinite(deviation) else "is both its ends"
        raise MeshError(
            f"{source}: the line is not straight: the node at {_place(nodes, worst)} {what}; a Beam is straight "
            f"(to {STRAIGHT:g} of its length). Make one Beam for each straight part"
        )
    return 0.0, *_increasing(source, nodes, arc, steps @ axis)


def _increasing(source: str, nodes: Array, arc: Array, lengths: Array) -> tuple[Array, Array]:
    if np.any(lengths <= 0):
        k = int(np.argmax(lengths <= 0))
        raise MeshError(f"{source}: the line is not straight: it folds back on itself at {_place(nodes, k)}")
    return arc, lengths
