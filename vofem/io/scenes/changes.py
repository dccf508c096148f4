"""Keys of a scene file by their paths, which are parameters of studies: reading and replacing their values.

A path consists of the name of a table and of keys, such as ``run.dt``. In an
array of tables one of them is named after the table, by its ``name`` or by its
position counted from 0: ``contact.stop.gap``, ``point_load[0].f.sine.omega``.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from typing import Any

from vofem._validate import nearest
from vofem.errors import ArgumentError

_BRACKETS = re.compile(r"\[(\d+)\]")


def changed(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a scene file with other values.

    `content`: the parsed file; it is not changed.
    `changes`: new values by path.
    Raises `ArgumentError` if there is no such key. The message says where the path ends, and which names there are.
    """
    result = copy.deepcopy(dict(content))
    for path, value in changes.items():
        *parents, last = _parts(path)
        table, where = _at(result, parents, path)
        if isinstance(table, list):
            table[_position(table, last, path, where)] = value
        elif isinstance(table, dict):
            table[last] = value
        else:
            raise ArgumentError(f"{path!r}: {where} is {table!r}, expected a table")
    return result


def number_at(content: Mapping[str, Any], path: str) -> float:
    """Return the number at a path.

    Raises `ArgumentError` if there is no such key, or its value is not a number.
    """
    value, _ = _at(content, _parts(path), path)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ArgumentError(f"{path!r} is {value!r}, expected a number in the file there")
    return float(value)


def _parts(path: str) -> list[str]:
    parts = _BRACKETS.sub(r".\1", path).split(".")
    if len(parts) < 2 or not all(parts) or any(set(part) & set("[]") for part in parts):
        raise ArgumentError(
            f"{path!r} is no path of a key, expected table and key with a dot between, such as 'contact.stop.gap' or "
            "'point_load[0].f.sine.omega'"
        )
    return parts


def _at(content: Mapping[str, Any], parts: list[str], path: str) -> tuple[Any, str]:
    """Return what stands where the parts of a path lead, and that place as text."""
    here: Any = content
    for depth, part in enumerate(parts):
        where = ".".join(parts[:depth])
        if isinstance(here, list):
            here = here[_position(here, part, path, where)]
            continue
        if not isinstance(here, dict):
            raise ArgumentError(f"{path!r}: {where} is {here!r}, expected a table")
        if part not in here:
            there = f"in {where}" if where else "in the file"
            known = tuple(here)
            raise ArgumentError(
                f"{path!r}: there is no {part!r} {there}; there are {list(known)}{nearest(part, known)}"
            )
        here = here[part]
    return here, ".".join(parts)


def _position(array: list[Any], part: str, path: str, where: str) -> int:
    """Return the position of an entry of an array, given by its number or by its name."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in array]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(array):
        return int(part)
    known = tuple(name for name in names if isinstance(name, str))
    raise ArgumentError(
        f"{path!r}: {where} has no entry {part!r}; give a number from 0 to {len(array) - 1}"
        + (f", or one of the names {list(known)}{nearest(part, known)}" if known else "")
    )
