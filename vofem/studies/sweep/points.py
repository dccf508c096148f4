"""The points of a sweep: a grid, a table, or any series of mappings; and plain data as JSON, for keys and texts."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.errors import ArgumentError

#: Kinds of arrays that are plain data.
_KINDS = "biufcUS"

#: What subclasses of plain types are written as, where nothing else knows them.
_BASES: tuple[tuple[Any, Callable[[Any], Any]], ...] = (
    *((kind, kind) for kind in (int, float, complex, str, bytes, list, tuple)),
    ((set, frozenset), set),
    (Mapping, dict),
)


class NoContentError(TypeError):
    """The object is not plain data, so two of its kind cannot be compared by content."""


def _as_base(value: Any) -> Any:
    """Return the node of an object of a class that derives from a plain one."""
    for known, base in _BASES:
        if isinstance(value, known):
            return node_of(base(value))
    raise NoContentError(type(value).__name__)


def node_of(value: Any, other: Callable[[Any], Any] = _as_base) -> Any:
    """Return plain data as what JSON can hold; `value_of` returns the data, types and bits included.

    Plain data are None, booleans, numbers, texts, bytes, arrays of these, and lists, tuples, sets and mappings of
    plain data.

    `other`: returns the node of an object of any other class.
    Raises `NoContentError` for anything else, unless `other` is given.
    """
    kind = type(value)
    if isinstance(value, np.generic) and type(value.item()) is not kind:
        return node_of(value.item(), other)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is complex:
        return {"$complex": [value.real, value.imag]}
    if kind is bytes:
        return {"$bytes": _text(value)}
    if kind is np.ndarray and value.dtype.kind in _KINDS:
        return {"$array": [value.dtype.str, list(value.shape), _text(np.ascontiguousarray(value).tobytes())]}
    if kind is list:
        return [node_of(item, other) for item in value]
    if kind is tuple:
        return {"$tuple": [node_of(item, other) for item in value]}
    if kind in (set, frozenset):
        return {"$set": sorted((node_of(item, other) for item in value), key=_sorted_text)}
    if kind is dict:
        pairs = [[node_of(key, other), node_of(item, other)] for key, item in value.items()]
        if all(type(key) is str and not key.startswith("$") for key in value):
            return dict(pairs)
        return {"$dict": sorted(pairs, key=_sorted_text)}
    return other(value)


def value_of(node: Any) -> Any:
    """Return the plain data that `node_of` has written. Sets come back as sets, mappings as dicts."""
    if isinstance(node, list):
        return [value_of(item) for item in node]
    if not isinstance(node, dict):
        return node
    kind: str
    content: Any
    kind, content = next(iter(node.items()), ("", None))
    if kind == "$complex":
        return complex(*content)
    if kind == "$bytes":
        return base64.b64decode(content)
    if kind == "$array":
        dtype, shape, data = content
        return np.frombuffer(base64.b64decode(data), np.dtype(dtype)).reshape(shape).copy()
    if kind in ("$tuple", "$set"):
        return (tuple if kind == "$tuple" else set)(value_of(item) for item in content)
    if kind == "$dict":
        return {value_of(key): value_of(item) for key, item in content}
    return {key: value_of(item) for key, item in node.items()}


def digest(node: Any) -> str:
    """Return the SHA-256 digest of a node, 64 hexadecimal digits: the same for equal data on every machine."""
    return hashlib.sha256(_sorted_text(node).encode()).hexdigest()


def _sorted_text(node: Any) -> str:
    return json.dumps(node, sort_keys=True)


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


@dataclass(frozen=True)
class Points:
    """The points of a sweep in order."""

    names: tuple[str, ...]  #: Names of the parameters.
    rows: tuple[dict[str, Any], ...]  #: A dict for each point, with a value for every name.
    keys: tuple[str, ...]  #: A text for each point that identifies its values; equal points have equal keys.
    #: The values along each dimension of a grid, whose last name changes fastest. None for a table.
    axes: dict[str, list[Any]] | None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid, or (n,) for a table."""
        return (len(self.rows),) if self.axes is None else tuple(len(values) for values in self.axes.values())


def as_points(points: Any) -> Points:
    """Return the points of a sweep.

    `points`: a mapping of names to lists: the grid of all combinations. A pandas DataFrame, a structured array, or an
    iterable of mappings: one point a row.
    Raises `ArgumentError` if there are no points, their names differ, or a value is no plain data.
    """
    if isinstance(points, Mapping):
        axes = {_name(name): _values(name, values) for name, values in points.items()}
        rows = tuple(dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values()))
        return _points(tuple(axes), rows if axes else (), axes)
    rows = tuple(_rows(points))
    return _points(tuple(_name(name) for name in rows[0]) if rows else (), rows, None)


def points_of(rows: list[dict[str, Any]]) -> Points:
    """Return points that were stored: a grid if they are all combinations of their values in order, else a table.

    Points with other names than the first one are left out.
    """
    names = tuple(rows[0])
    rows = [row for row in rows if set(row) == set(names)]
    table = _points(names, tuple(rows), None)
    values = {name: {digest(node_of(row[name])): row[name] for row in rows} for name in names}
    grid = as_points({name: list(found.values()) for name, found in values.items()})
    return grid if grid.keys == table.keys else table


def _points(names: tuple[str, ...], rows: tuple[dict[str, Any], ...], axes: dict[str, list[Any]] | None) -> Points:
    if not rows:
        raise ArgumentError("sweep: points are empty, expected at least one point")
    return Points(names, rows, tuple(_key(row) for row in rows), axes)


def _name(name: Any) -> str:
    if not isinstance(name, str) or not name or "/" in name or name.startswith("sweep_"):
        raise ArgumentError(f"sweep: points has the name {name!r}, expected names of arguments of the function")
    return name


def _values(name: str, values: Any) -> list[Any]:
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise ArgumentError(f"sweep: points[{name!r}] is {values!r}, expected a list of values, also for a single one")
    return [_plain(value) for value in values]


def _rows(points: Any) -> Iterable[dict[str, Any]]:
    """Yield the points of a table or a series of mappings."""
    if hasattr(points, "to_dict") and hasattr(points, "columns"):
        points = points.to_dict("records")
    elif isinstance(points, np.ndarray) and points.dtype.names:
        names = points.dtype.names
        points = [dict(zip(names, row, strict=True)) for row in points.reshape(-1)]
    if isinstance(points, (str, bytes)) or not isinstance(points, Iterable):
        raise ArgumentError(
            f"sweep: points is {points!r}, expected a mapping of names to lists (a grid), a table, "
            "or an iterable of mappings"
        )
    names = None
    for k, row in enumerate(points):
        if not isinstance(row, Mapping):
            raise ArgumentError(f"sweep: point {k} is {row!r}, expected a mapping of names to values")
        if names is not None and set(row) != set(names):
            raise ArgumentError(
                f"sweep: point {k} has the names {list(row)}, expected {list(names)} as the first point"
            )
        names = tuple(row) if names is None else names
        yield {name: _plain(row[name]) for name in names}


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _key(row: dict[str, Any]) -> str:
    nodes = {}
    for name, value in row.items():
        try:
            nodes[name] = node_of(value)
        except NoContentError as error:
            raise ArgumentError(
                f"sweep: {name!r} is an object of type {error}, expected numbers, texts, arrays, or lists of these; "
                "make other objects inside the function, from such values"
            ) from None
    return digest(nodes)
