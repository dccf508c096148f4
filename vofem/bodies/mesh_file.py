"""Mesh files, read through meshio.

meshio prints, and ends the process, where a file is damaged; neither gets out
of here. What a file says is collected as nodes, lines and named sets, and
`vofem.bodies.mesh.chain` makes a beam's mesh of it.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from vofem.bodies.base import Array, IntArray
from vofem.bodies.mesh import LineMesh, chain
from vofem.errors import ArgumentError, MeshError
from vofem.locks import Lock

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
    if not isinstance(path, (str, os.PathLike)):
        raise ArgumentError(f"the path of a mesh is {path!r}, expected a string or a path")
    file = Path(path)
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
    except (OSError, ValueError) as error:
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
    with (
        _OUTPUT,
        warnings.catch_warnings(),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
    ):
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
