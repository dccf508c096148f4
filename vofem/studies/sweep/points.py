"""The points of a sweep: a grid, a table, or any series of mappings."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.errors import ArgumentError
from vofem.studies.sweep.content import NoContentError, digest, node_of


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
