"""Other values for keys of a scene file, named by dotted paths such as ``contact.stop.gap``."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from vofem._validate import nearest
from vofem.errors import ArgumentError


def changed(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a scene file with other values.

    Parameters
    ----------
    content : dict
        As TOML reads it. It stays as it is.
    changes : dict
        New values by path. A path names a table, then in an array of tables
        the ``name`` of one of them or its position (counted from 0), then the
        keys: ``run.dt``, ``contact.stop.gap``, ``point_load.0.f.sine.omega``.

    Raises
    ------
    ArgumentError
        If a path leads nowhere; the message says where it ends and what there is.
    """
    result = copy.deepcopy(dict(content))
    for path, value in changes.items():
        *parents, last = _parts(path)
        table: Any = result
        for depth, part in enumerate(parents):
            table = _inside(table, part, path, ".".join(parents[:depth]))
        where = ".".join(parents)
        if isinstance(table, list):
            table[_position(table, last, path, where)] = value
        elif isinstance(table, dict):
            table[last] = value
        else:
            raise ArgumentError(f"{path!r}: {where} is {table!r}, expected a table")
    return result


def _parts(path: str) -> list[str]:
    parts = path.split(".")
    if len(parts) < 2 or not all(parts):
        raise ArgumentError(
            f"{path!r} is no path, expected table and key with a dot between, such as 'contact.stop.gap'"
        )
    return parts


def _inside(table: Any, part: str, path: str, where: str) -> Any:
    """Return what a part of a path stands for in a table or an array."""
    if isinstance(table, list):
        return table[_position(table, part, path, where)]
    if not isinstance(table, dict):
        raise ArgumentError(f"{path!r}: {where} is {table!r}, expected a table")
    if part not in table:
        there = f"in {where}" if where else "in the file"
        known = tuple(table)
        raise ArgumentError(f"{path!r}: there is no {part!r} {there}; there are {list(known)}{nearest(part, known)}")
    return table[part]


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
