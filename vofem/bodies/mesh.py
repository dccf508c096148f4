"""The mesh of a beam: a chain of two-node lines put in order, and what meshio reads from mesh files.

meshio prints, and ends the process, where a file is damaged; neither gets out of here.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vofem._validate import HUGE
from vofem.bodies.base import Array, IntArray
from vofem.errors import ArgumentError, MeshError
from vofem.files.whole import path_of
from vofem.locks import Lock

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
    source: str, coordinates: Array, lines: IntArray, points: Mapping[str, IntArray], subdomains: Mapping[str, IntArray]
) -> LineMesh:
    """Put lines in order and measure them.

    The left end is the end with the smaller x; where these agree the smaller y, then z. For an axis along +x the x of
    the mesh is the x of the beam; for any other, x is the arc length from the left end. Nodes that no line uses do not
    matter, and lines that are given twice count once.

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


#: Extension to meshio's name of the format. Others are refused: nothing tests them.
FORMATS = {".msh": "gmsh", ".vtu": "vtu", ".med": "med"}

#: Largest file in bytes.
_MOST = 2**29

# Standard output is one for all threads; two readers must not redirect it at a time.
_OUTPUT = Lock()

Sets = dict[str, list[IntArray]]


def read_mesh(path: str | os.PathLike[str]) -> LineMesh:
    """Read a beam's mesh from a Gmsh (.msh), VTU or MED file.

    `path`: see `vofem.Beam.from_mesh` for what the file may hold.
    Raises `MeshError` if the file is missing, damaged, or no straight chain of two-node lines.
    """
    file = path_of(path, "a mesh file")
    source = f"mesh file '{file}'"
    mesh = _read(source, file)
    coordinates = _coordinates(source, mesh)
    _check_cells(source, mesh)
    offset = 0
    lines, starts = [], []
    for block in mesh.cells:
        starts.append(offset)
        if block.type == "line":
            lines.append(np.asarray(block.data, dtype=np.int64))
            offset += len(block.data)
    points: dict[str, IntArray] = {}
    subdomains: dict[str, IntArray] = {}
    for name, blocks in _cell_sets(mesh).items():
        for block, start, members in zip(mesh.cells, starts, blocks, strict=True):
            if members.size and block.type == "line":
                _add(subdomains, name, members + start)
            elif members.size:
                _add(points, name, np.ravel(block.data)[members])
    for name, members in _point_sets(mesh).items():
        _add(points, name, members)
    for name, members in points.items():
        if members.min() < 0 or members.max() >= len(coordinates):
            raise MeshError(f"{source}: the point set {name!r} names a node that is not in the file; write it again")
    return chain(source, coordinates, np.concatenate(lines), points, subdomains)


def _add(sets: dict[str, IntArray], name: str, members: IntArray) -> None:
    sets[name] = np.concatenate([sets.get(name, np.empty(0, dtype=np.int64)), members.astype(np.int64)])


# -- the file ---------------------------------------------------------------------------------------


def _read(source: str, file: Path) -> Any:
    try:
        exists, regular = file.exists(), file.is_file()
        size = file.stat().st_size if regular else 0
    except OSError as error:
        raise MeshError(f"{source} cannot be read: {error}") from error
    if not exists:
        raise MeshError(f"{source} does not exist; relative paths start at '{Path.cwd()}'")
    if not regular:
        raise MeshError(f"{source} is {'a directory' if file.is_dir() else 'not a file'}, expected a mesh file")
    kind = FORMATS.get(file.suffix.lower())
    if kind is None:
        raise MeshError(
            f"{source} has the extension {file.suffix!r}, expected {', '.join(FORMATS)}; "
            "`meshio convert` turns other formats into these"
        )
    if size == 0:
        raise MeshError(f"{source} is empty; the program that wrote it may have failed or not ended")
    if size > _MOST:
        raise MeshError(
            f"{source} has {size / 1e6:.0f} MB, expected at most {_MOST / 1e6:.0f} MB, which hold a beam of several "
            "million nodes; it is damaged, or more than the axis of a beam is in it. Export the axis alone"
        )
    if kind == "gmsh":
        _check_gmsh(source, file)
    printed = io.StringIO()
    with _OUTPUT, warnings.catch_warnings(), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message=".*unmatched data.*")  # numpy met text instead of a number
        try:
            import meshio

            return meshio.read(file, file_format=kind)
        except MemoryError as error:
            raise MeshError(
                f"{source} does not fit into memory ({error}); it is damaged, its tags have gaps, or more than the "
                "axis of a beam is in it. Renumber the mesh (Gmsh: Renumber), or export the axis alone"
            ) from error
        except (Exception, SystemExit) as error:
            reason = " ".join(f"{printed.getvalue()} {'' if isinstance(error, SystemExit) else error!r}".split())
            hint = ""
            if "ncompatible cell data" in reason:
                hint = "; give a physical group or family to all cells or to none (Mesh.SaveAll = 0 in Gmsh)"
            raise MeshError(
                f"{source} could not be read as {kind}: {reason[:300]}; it may be truncated, damaged or of another "
                f"kind than its extension says{hint}. Write it again (Gmsh: format 4.1)"
            ) from error


def _check_gmsh(source: str, file: Path) -> None:
    """Find what meshio does not report: truncation between numbers, and a name used twice."""
    try:
        data = file.read_bytes()
    except OSError as error:
        raise MeshError(f"{source} cannot be read: {error}") from error
    if not data.lstrip().startswith((b"$MeshFormat", b"$Comments")):
        raise MeshError(f"{source} does not begin with $MeshFormat: it is not a Gmsh mesh, expected format 4.1")
    tail = re.search(rb"\$End(\w+)\s*\Z", data[-200:])
    if tail is None or re.search(rb"^\$" + tail[1] + rb"\s*$", data, re.MULTILINE) is None:
        raise MeshError(f"{source} does not end with the end of a section ($End...): it is truncated, write it again")
    # The second of four numbers in format 4.1, a number alone in format 2.2.
    nodes = re.search(rb"^\$Nodes\s+(?:\d+ (?=\d+ \d+ \d+\s*$))?(\d+)(?: \d+ \d+)?\s*$", data, re.MULTILINE)
    if nodes is not None and int(nodes[1]) > len(data):
        raise MeshError(f"{source} announces {int(nodes[1])} nodes, more than its {len(data)} bytes can hold")
    names = re.search(rb"^\$PhysicalNames(.*?)^\$EndPhysicalNames", data, re.MULTILINE | re.DOTALL)
    if names is not None:
        counts = Counter(re.findall(rb'^\s*\d+\s+\d+\s+"(.*)"\s*$', names[1], re.MULTILINE))
        for name, count in counts.items():
            if count > 1:
                raise MeshError(
                    f"{source} gives the physical name {name.decode(errors='replace')!r} to {count} groups; "
                    "meshio keeps one of them. Give every group a name of its own"
                )


# -- what it holds ----------------------------------------------------------------------------------


def _coordinates(source: str, mesh: Any) -> Array:
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or not 1 <= points.shape[1] <= 3:
        raise MeshError(f"{source} holds no nodes with one to three coordinates (shape {points.shape})")
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def _check_cells(source: str, mesh: Any) -> None:
    counts: Counter[str] = Counter()
    for block in mesh.cells:
        counts[block.type] += len(block.data)
    found = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "no cells"
    wrong = [kind for kind in counts if kind not in ("line", "vertex")]
    if any(kind.startswith("line") for kind in wrong):
        raise MeshError(
            f"{source} holds {found}: lines of higher order; a Beam takes two-node lines, its elements are cubic "
            "anyway. Mesh at order 1 (Mesh.ElementOrder = 1 in Gmsh)"
        )
    if wrong:
        raise MeshError(
            f"{source} holds {found}; a Beam takes two-node lines, and vertices for named points. Export the axis "
            "alone: in Gmsh mesh with `gmsh -1`, or put only the curve and its points into physical groups"
        )
    if not counts["line"]:
        raise MeshError(
            f"{source} holds {found}, expected two-node lines; in Gmsh give the curve a physical group, "
            "as elements without one are not saved"
        )


def _cell_sets(mesh: Any) -> Sets:
    """Return for every name the members, per block, of a set of cells."""
    empty = [np.empty(0, dtype=np.int64)] * len(mesh.cells)
    sets: Sets = {}
    physical = mesh.cell_data.get("gmsh:physical")
    for name, entry in mesh.field_data.items():  # Gmsh
        if name in mesh.cell_sets:
            sets[name] = [np.asarray(k, dtype=np.int64) for k in mesh.cell_sets[name]]
        elif physical is not None and np.size(entry) == 2:
            tag, dimension = (int(value) for value in entry)
            kind = {0: "vertex", 1: "line"}.get(dimension)
            blocks = zip(mesh.cells, physical, strict=True)
            sets[name] = [np.flatnonzero((np.asarray(t) == tag) & (block.type == kind)) for block, t in blocks]
    for family, groups in getattr(mesh, "cell_tags", {}).items():  # MED: a family is in several groups
        blocks_of = [np.flatnonzero(np.asarray(tags) == family) for tags in mesh.cell_data.get("cell_tags", [])]
        for name in _clean(groups):
            sets[name] = [np.union1d(*pair) for pair in zip(sets.get(name, empty), blocks_of or empty, strict=True)]
    for name, data in mesh.cell_data.items():  # VTU: masks
        if not name.startswith("gmsh:") and name not in sets and name != "cell_tags":
            masks = [_mask(values) for values in data]
            if all(mask is not None for mask in masks) and any(np.any(mask) for mask in masks if mask is not None):
                sets[name] = [np.flatnonzero(mask) for mask in masks if mask is not None]
    return sets


def _point_sets(mesh: Any) -> dict[str, IntArray]:
    """Return for every name the nodes of a set of points."""
    sets: dict[str, IntArray] = {}
    for family, groups in getattr(mesh, "point_tags", {}).items():  # MED
        members = np.flatnonzero(np.asarray(mesh.point_data.get("point_tags", [])) == family)
        for name in _clean(groups):
            if members.size:
                _add(sets, name, members)
    for name, values in mesh.point_data.items():  # VTU: masks
        mask = _mask(values)
        if not name.startswith("gmsh:") and name != "point_tags" and mask is not None and np.any(mask):
            _add(sets, name, np.flatnonzero(mask))
    return sets


def _mask(values: Any) -> Any:
    """Return an array of whole numbers 0 and 1 as booleans, or None where it is anything else."""
    values = np.asarray(values)
    if values.ndim != 1 or values.dtype.kind not in "iub" or not np.all((values == 0) | (values == 1)):
        return None
    return values.astype(bool)


def _clean(names: Any) -> list[str]:
    return [name.strip().strip("\x00").strip() for name in names]
