"""Values by their paths: ``"f.amplitude"`` in an object, ``"point_load[0].f.sine.omega"`` in tables of a scene file.

A path has the names of parameters or keys with dots between. An entry of an array is named by its number from 0, as in
``layers[0]``, or by its ``name``, as in ``contact.stop.gap``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from vofem._validate import nearest
from vofem.errors import ArgumentError
from vofem.parameters.declared import alone, is_declared, values_of

#: A path as text, or its parts.
Path = str | Sequence[Any]

_BRACKETS = re.compile(r"\[(\d+)\]")

#: What has no parameters.
_PLAIN = (type(None), bool, int, float, str)


def value_at(thing: Any, path: Path) -> Any:
    """Return the value at a path in an object, a dict or a list.

    Raises `ArgumentError` if there is none. The message says where the path ends, and gives the nearest name.
    """
    parts = _parts(thing, path)
    for depth in range(len(parts)):
        key = _key(thing, parts, depth, path)
        thing = thing[key] if isinstance(thing, (dict, list)) else getattr(thing, key)
    return thing


def number_at(thing: Any, path: Path) -> float:
    """Return the number at a path; raise `ArgumentError` if there is none."""
    value = value_at(thing, path)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ArgumentError(f"{path!r} is {value!r}, expected a number in the file there")
    return float(value)


def changed(thing: Any, changes: Mapping[Any, Any] | None = None, /, **named: Any) -> Any:
    """Return an object that is made anew, or a copy of tables, with the values at some paths changed.

    Raises `ArgumentError` if a path leads nowhere, or a value is out of range; or if the class of an object is not
    declared, and its objects do not have their arguments as attributes.
    """
    given = {**(changes or {}), **named}
    return _changed(thing, [(_parts(thing, path), value, path) for path, value in given.items()], 0)


def _changed(thing: Any, changes: list[tuple[tuple[Any, ...], Any, Path]], depth: int) -> Any:
    own: dict[Any, Any] = {}
    inner: dict[Any, list[tuple[tuple[Any, ...], Any, Path]]] = {}
    for parts, value, path in changes:
        last = depth + 1 == len(parts)
        # A new key of a table is no fault here, and a constructor knows its arguments best.
        new = last and not isinstance(thing, list) and (isinstance(thing, dict) or not isinstance(thing, _PLAIN))
        key = parts[depth] if new else _key(thing, parts, depth, path)
        if last:
            own[key] = value
        else:
            inner.setdefault(key, []).append((parts, value, path))
    for key, some in inner.items():
        old = own[key] if key in own else thing[key] if isinstance(thing, (dict, list)) else getattr(thing, key)
        own[key] = _changed(old, some, depth + 1)
    if isinstance(thing, dict):
        return thing | own
    if isinstance(thing, list):
        return [own.get(k, entry) for k, entry in enumerate(thing)]
    values = values_of(thing, own)
    if is_declared(type(thing)):
        values |= alone(thing, next((name for name in thing._either if name in own), None))
    return type(thing)(**values | own)


def _parts(thing: Any, path: Path) -> tuple[Any, ...]:
    """Return the parts of a path; one in tables has two at least."""
    if not isinstance(path, str):
        return tuple(path)
    parts = tuple(_BRACKETS.sub(r".\1", path).split("."))
    if len(parts) < 1 + isinstance(thing, dict) or not all(parts) or any(set(part) & set("[]") for part in parts):
        raise ArgumentError(
            f"{path!r} is no path of a key, expected table and key with a dot between, such as 'contact.stop.gap' or "
            "'point_load[0].f.sine.omega'"
        )
    return parts


def _key(thing: Any, parts: tuple[Any, ...], depth: int, path: Path) -> Any:
    """Return the key, the number or the name of the parameter that a part of a path means."""
    part, where = parts[depth], ".".join(map(str, parts[:depth]))
    if isinstance(thing, list):
        return _number(thing, part, path, where)
    if isinstance(thing, dict):
        if part not in thing:
            there, known = f"in {where}" if where else "in the file", tuple(thing)
            raise ArgumentError(
                f"{path!r}: there is no {part!r} {there}; there are {list(known)}{nearest(part, known)}"
            )
        return part
    names = tuple(values_of(thing)) if hasattr(type(thing), "_declarations") else ()
    if part not in names:
        shown = thing.describe() if hasattr(thing, "describe") else repr(thing)
        raise ArgumentError(
            f"{shown} has no parameter {part!r}, in {path!r}; it has {', '.join(names) or 'none'}{nearest(part, names)}"
        )
    return part


def _number(array: list[Any], part: Any, path: Path, where: str) -> int:
    """Return the number of an entry of an array, given by its number or by its name."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in array]
    if part in names and isinstance(part, str):
        return names.index(part)
    if str(part).isdecimal() and int(part) < len(array):
        return int(part)
    known = tuple(name for name in names if isinstance(name, str))
    raise ArgumentError(
        f"{path!r}: {where} has no entry {part!r}; give a number from 0 to {len(array) - 1}"
        + (f", or one of the names {list(known)}{nearest(part, known)}" if known else "")
    )
