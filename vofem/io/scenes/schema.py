"""The tables of scene files: one for each class of bodies and effects, as the class declares its parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from vofem import effects
from vofem.bodies import Beam, Mass
from vofem.bodies.mesh import LineMesh
from vofem.bodies.path import Path as Travel
from vofem.errors import MeshError
from vofem.parameters.declared import (
    is_declared,
    keys_of,
    made_of,
    read,
    read_values,
    schema_of,
    table_name,
    values_of,
    writable,
    write_values,
)
from vofem.parameters.kinds import Kind, Name, Unwritable
from vofem.parameters.place import INVALID, Book, Invalid, Place
from vofem.time_functions.base import FUNCTIONS


@dataclass(frozen=True)
class MeshPath(Kind):
    """The path of a mesh file, relative to the scene file."""

    text: str = "A mesh file, in place of `length` and `elements`."

    expected = "the path of a mesh file, relative to the scene file"
    schema: ClassVar = {"type": "string"}

    def read(self, value: Any, place: Place) -> Path | Invalid:
        """Return the path."""
        if not isinstance(value, str) or not value or "\0" in value:
            return place.expected(self.expected, value)
        return place.book.folder / value

    def write(self, value: Any, book: Book) -> str:
        """Return the path relative to the file that is written, with forward slashes."""
        goal = os.path.abspath(value)
        try:
            relative = os.path.relpath(goal, os.path.abspath(book.folder))
        except ValueError:  # another drive of Windows
            relative = goal
        return Name().write(Path(relative).as_posix(), book)


MESH = MeshPath()

#: Keys that a mesh file stands for.
_LAID_OUT = ("length", "elements")

KEYS = tuple(key for name in keys_of(Beam) for key in ((name, "mesh") if name == "elements" else (name,)))


def read_beam(table: Any, place: Place) -> Any:
    """Return the beam of a table; or report all of its faults and return `INVALID`."""
    if not isinstance(table, dict):
        return place.expected(f"a table with {', '.join(KEYS)}", table)
    mesh: Any = None
    if "mesh" in table:
        mesh = _mesh(table["mesh"], place.key("mesh"))
        for key in set(_LAID_OUT) & set(table):
            place.key(key).report(f"{key} is given by the mesh file; remove it, or remove mesh")
            mesh = INVALID
        if isinstance(mesh, Invalid):
            return INVALID
        table = {key: value for key, value in table.items() if key != "mesh"}
    elif "length" not in table:
        place.key("length").report("missing, expected a positive number (or mesh, the path of a mesh file)")
    given = {} if mesh is None else {"length": mesh.length, "elements": mesh}
    # Of a length that is missing this was told already.
    values, bad = read_values(Beam, {"length": 1.0, **table} if mesh is None else table, place, KEYS, given)
    if values is None:
        return INVALID
    if mesh is None and "length" not in table:
        bad.add("length")
    points = {} if mesh is None else mesh.points
    supports: Mapping[str, str] = values.get("supports") or {}
    values["supports"] = {
        float(where) if _is_number(where) and where not in points else where: kind for where, kind in supports.items()
    }
    return made_of(Beam, values, bad, place)


def _mesh(value: Any, place: Place) -> Any:
    """Return the mesh of a path."""
    from vofem.bodies.mesh import read_mesh

    path = MESH.read(value, place)
    if isinstance(path, Invalid):
        return path
    try:
        return replace(read_mesh(path), file=os.path.abspath(path))
    except MeshError as error:
        return place.report(str(error))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def values_of_beam(beam: Beam, place: Place) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the values of a beam as scene files hold them, and the key of its mesh where it has one."""
    values = values_of(beam)
    points = {} if beam.mesh is None or place.book.whole else beam.mesh.points
    values["supports"] = {_place(beam, node, points): kind for node, kind in beam.supports.items()} or None
    if beam.mesh is None:
        return values, {}
    if place.book.whole:
        return values | {"elements": beam.nodes}, {}
    if beam.mesh_file is None:
        raise Unwritable(f"{beam!r} is on a mesh that came from no file; use Beam.from_mesh")
    values |= {name: _by_subdomain(values[name], beam.mesh) for name in ("EI", "rhoA")}
    values |= dict.fromkeys(_LAID_OUT)
    return values, {"mesh": MESH.write(beam.mesh_file, place.book)}


def _place(beam: Beam, node: int, points: Mapping[str, Any]) -> str:
    """Return the name of a node among the points of a mesh, or its x as a string."""
    if node in (0, len(beam.nodes) - 1):
        return "right" if node else "left"
    for name, nodes in points.items():
        if nodes.tolist() == [node] and name not in ("left", "right"):
            return name
    # The given x of nodes, not those computed from the left end: these may differ in the last bit.
    x = repr(float((beam.elements if np.ndim(beam.elements) else beam.nodes)[node]))
    if x in points:
        raise Unwritable(f"the support at x = {x} m has no name, and {x!r} names another point of the mesh")
    return x


def _by_subdomain(value: Any, mesh: LineMesh) -> Any:
    """Return numbers by subdomain for one number per element, where subdomains that do not overlap tell them all."""
    if np.ndim(value) != 1:
        return value
    table: dict[str, float] = {}
    left = set(range(len(value)))
    for name, elements in mesh.subdomains.items():
        mine = set(elements.tolist())
        if mine and mine <= left and len(set(value[elements].tolist())) == 1:
            table[name] = float(value[elements[0]])
            left -= mine
    return value if left else table


#: Classes of bodies by the names of their tables.
BODIES: dict[str, type] = {table_name(cls): cls for cls in (Beam, Mass)}

#: Classes of effects by the names of their tables: those of the package, without those that hold Python functions.
EFFECTS: dict[str, type] = {
    table_name(cls): cls
    for cls in (getattr(effects, name) for name in effects.__all__)
    if hasattr(cls, "compile") and is_declared(cls) and writable(cls)
}


def keys(cls: type) -> tuple[str, ...]:
    """Return the keys of the table of a class."""
    return KEYS if cls is Beam else keys_of(cls)


def read_table(cls: type, table: Any, place: Place, **given: Any) -> Any:
    """Return the body or effect of a table; or report all of its faults and return `INVALID`."""
    return read_beam(table, place) if cls is Beam else read(cls, table, place, **given)


def write_table(thing: Any, place: Place) -> dict[str, Any]:
    """Return the table of a body or an effect without default values; report what a scene file cannot hold."""
    cls = type(thing)
    if cls is not Beam:
        return write_values(cls, values_of(thing), place)
    try:
        values, mesh = values_of_beam(thing, place)
    except Unwritable as error:
        place.report(str(error))
        return {}
    return {**write_values(cls, values, place), **mesh}


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of the tables of bodies and effects in scene files."""
    beam = schema_of(Beam)
    beam["properties"]["mesh"] = MESH.described()
    beam["required"] = [name for name in beam["required"] if name not in ("length", "elements")]
    tables: Mapping[str, Any] = {name: schema_of(cls) for name, cls in (BODIES | EFFECTS).items()} | {"beam": beam}
    functions = {name: schema_of(cls) for name, cls in FUNCTIONS.items()}
    named = {"type": "object", "properties": functions, "minProperties": 1, "maxProperties": 1,
             "additionalProperties": False}  # fmt: skip
    at = {"type": "object", "properties": {"body": {"type": "string"}, "at": {"type": ["number", "string"]}},
          "required": ["body"], "additionalProperties": False}  # fmt: skip
    along = {"type": "object", "properties": {"body": {"type": "string"}, "path": schema_of(Travel)},
             "required": ["body", "path"], "additionalProperties": False}  # fmt: skip
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene file of vofem",
        "type": "object",
        "properties": {name: {"anyOf": [{"type": "array", "items": table}, table]} for name, table in tables.items()},
        "$defs": {
            "function_of_time": {"anyOf": [{"type": "number"}, named]},
            "point": {"anyOf": [{"type": "string"}, at]},
            "travelling_point": {"anyOf": [{"$ref": "#/$defs/point"}, along]},
        },
    }
