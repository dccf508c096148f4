"""Beams in scene files: on equal elements, on given nodes, or on a mesh file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem.bodies import Beam
from vofem.bodies.mesh import LineMesh
from vofem.errors import ArgumentError
from vofem.io.scenes.kinds import Count, Numbers, Unwritable
from vofem.io.scenes.place import Book, Place


class Elements:
    """The number of equal elements, or the x of all nodes."""

    expected = "a whole number or an array of the x of all nodes"
    stand_ins = ()

    def read(self, value: Any, place: Place) -> Any:
        """Return an int or a list of floats."""
        if isinstance(value, list):
            return Numbers().read(value, place)
        return Count(self.expected).read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return an int or a list of floats."""
        return int(value) if np.ndim(value) == 0 else Numbers().write(value, book)


def build_beam(
    name: str,
    EI: Any,
    rhoA: Any,
    length: float | None = None,
    elements: Any = None,
    mesh: str | os.PathLike[str] | None = None,
    supports: Mapping[str, str] | None = None,
    tension: float = 0.0,
) -> Beam:
    """Return a beam. The places of supports are names, or x as strings."""
    label = f"Beam {name!r}: "
    if mesh is not None:
        for key, value in (("length", length), ("elements", elements)):
            if value is not None:
                raise ArgumentError(f"{label}{key} is given by the mesh file; remove it, or remove mesh")
        return _with_places(lambda places: Beam.from_mesh(mesh, EI, rhoA, places, tension, name), supports)
    if length is None:
        raise ArgumentError(f"{label}length is missing, expected a positive number (or mesh, the path of a mesh file)")
    if elements is None:
        raise ArgumentError(f"{label}elements is missing, expected {Elements.expected}")
    return _with_places(lambda places: Beam(length, EI, rhoA, elements, places, tension, name), supports)


def _with_places(build: Any, supports: Mapping[str, str] | None) -> Beam:
    """Turn strings that are numbers into x, where the mesh has no point of that name."""
    if not any(_is_number(where) for where in supports or {}):
        return build(supports)
    points = getattr(build({}).mesh, "points", {})
    return build({float(w) if _is_number(w) and w not in points else w: kind for w, kind in (supports or {}).items()})


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def values_of_beam(beam: Beam) -> dict[str, Any]:
    """Return the keys of a beam."""
    values: dict[str, Any] = {"name": beam.name}
    if beam.mesh is None:
        values |= {"length": beam.length, "elements": beam.elements}
    else:
        if beam.mesh_file is None:
            raise Unwritable(f"{beam!r} is on a mesh that came from no file; use Beam.from_mesh")
        values["mesh"] = beam.mesh_file
    values["EI"] = _by_subdomain(beam.EI, beam.mesh)
    values["rhoA"] = _by_subdomain(beam.rhoA, beam.mesh)
    values["supports"] = {_place(beam, node): kind for node, kind in beam.supports.items()}
    values["tension"] = beam.tension
    return values


def _place(beam: Beam, node: int) -> str:
    """Return the name of a node, or its x as a string."""
    if node in (0, len(beam.nodes) - 1):
        return "right" if node else "left"
    points = beam.mesh.points if beam.mesh is not None else {}
    for name, nodes in points.items():
        if nodes.tolist() == [node] and name not in ("left", "right"):
            return name
    # The given x of nodes, not those computed from the left end: these may differ in the last bit.
    x = repr(float((beam.elements if np.ndim(beam.elements) else beam.nodes)[node]))
    if x in points:
        raise Unwritable(f"the support at x = {x} m has no name, and {x!r} names another point of the mesh")
    return x


def _by_subdomain(value: Any, mesh: LineMesh | None) -> Any:
    """Return numbers by subdomain for one number per element, where subdomains that do not overlap tell them all."""
    if mesh is None or np.ndim(value) != 1:
        return value
    table: dict[str, float] = {}
    left = set(range(len(value)))
    for name, elements in mesh.subdomains.items():
        mine = set(elements.tolist())
        if mine and mine <= left and len(set(value[elements].tolist())) == 1:
            table[name] = float(value[elements[0]])
            left -= mine
    return value if left else table
