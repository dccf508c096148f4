"""The tables of scene files: one for each class of bodies and effects, as the class declares its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vofem import effects
from vofem.bodies import Beam, Mass, Path
from vofem.io.scenes.beam import KEYS, MESH, read_beam, values_of_beam
from vofem.parameters.declared import (
    is_declared,
    keys_of,
    read,
    schema_of,
    table_name,
    values_of,
    writable,
    write_values,
)
from vofem.parameters.kinds import Unwritable
from vofem.parameters.place import Place
from vofem.time_functions.base import FUNCTIONS

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
    along = {"type": "object", "properties": {"body": {"type": "string"}, "path": schema_of(Path)},
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
