"""The outcome of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import nearest
from vofem.errors import ArgumentError
from vofem.studies.sweep.points import Points
from vofem.studies.sweep.worker import RESERVED, Row


@dataclass(frozen=True)
class FailedPoint:
    """A point of a sweep whose function raised an error, or did not end.

    Attributes
    ----------
    index : int
        Position among the points.
    point : dict
        The arguments.
    error : str
        Type and message.
    traceback : str
        Where the error was raised.
    """

    index: int
    point: dict[str, Any]
    error: str
    traceback: str

    def __str__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.point.items())
        return f"point {self.index} ({arguments}): {self.error}"


class SweepInterrupted(KeyboardInterrupt):
    """A sweep was stopped by Ctrl-C. The computed rows are in `sweep`, and in the store if there is one.

    Attributes
    ----------
    sweep : Sweep
        Points that were not reached are among its failed ones.
    """

    def __init__(self, sweep: Sweep) -> None:
        super().__init__(f"{sweep!r}")
        self.sweep = sweep


@dataclass(frozen=True, eq=False)
class Sweep(Mapping[str, NDArray]):
    """The outcome of many runs: one array for every quantity that the function returned.

    It is a mapping of names to arrays. The first dimensions of an array are those
    of the grid, or a single one if the points were a table. The dimensions of the
    quantity follow. Where a point failed, numbers are NaN and texts are empty;
    integers of such a quantity become floats.

    Attributes
    ----------
    points : Points
        The points in order: `names`, `rows`, and `axes` of a grid.
    failed : tuple of FailedPoint
        The points that failed, in the order of the points.
    seconds : array of float, shape (n_points,)
        Wall time of every point in s. For rows from the store it is the time of the earlier sweep.
    counters : dict
        ``computed``, ``stored`` (taken from the store), ``batches`` and ``restarts`` of workers.
    notes : tuple of str
        Sentences that a reader of the numbers should know.
    """

    points: Points
    failed: tuple[FailedPoint, ...]
    seconds: NDArray[np.float64]
    counters: dict[str, int]
    notes: tuple[str, ...]
    _columns: dict[str, NDArray] = field(repr=False)

    def __getitem__(self, name: str) -> NDArray:
        if name not in self._columns:
            known = tuple(self._columns)
            raise ArgumentError(f"sweep: no quantity is named {name!r}; there are {list(known)}{nearest(name, known)}")
        column = self._columns[name]
        return column.reshape(*self.points.shape, *column.shape[1:])

    def __iter__(self) -> Any:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        shape = " x ".join(str(n) for n in self.points.shape)
        parts = [f"{shape} points over {', '.join(self.points.names)}", f"quantities {', '.join(self) or 'none'}"]
        parts += [f"{len(self.failed)} failed"] if self.failed else []
        parts += [f"{len(self.notes)} notes"] if self.notes else []
        return f"<Sweep: {'; '.join(parts)}>"

    def parameter(self, name: str) -> NDArray:
        """Return the value of a parameter at every point, in the shape of the quantities.

        Raises
        ------
        ArgumentError
            If there is no such parameter.
        """
        if name not in self.points.names:
            names = self.points.names
            raise ArgumentError(f"sweep: no parameter is named {name!r}; there are {list(names)}{nearest(name, names)}")
        values = _array([row[name] for row in self.points.rows])
        return values.reshape(*self.points.shape, *values.shape[1:])

    def with_notes(self, notes: Sequence[str]) -> Sweep:
        """Return the same sweep with some notes in front of its own."""
        return replace(self, notes=(*notes, *self.notes))

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset`.

        Its dimensions are the parameters of a grid, or ``point`` with the
        parameters as coordinates beside it. Further dimensions of a quantity
        are named ``NAME_0``, ``NAME_1`` and so on.
        """
        import xarray

        grid = self.points.axes is not None
        dims = self.points.names if grid else ("point",)
        if grid:
            coordinates = {name: (name, _array(values)) for name, values in (self.points.axes or {}).items()}
        else:
            coordinates = {name: ("point", self.parameter(name)) for name in self.points.names}
        variables = {}
        for name in self:
            column = self[name]
            variables[name] = ((*dims, *(f"{name}_{k}" for k in range(column.ndim - len(dims)))), column)
        return xarray.Dataset(variables, coords=coordinates, attrs={"notes": "\n".join(self.notes)})

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with one row a point; the last column holds the errors.

        Quantities that are arrays are kept as arrays, one in each cell.
        """
        import pandas

        columns: dict[str, Any] = {
            name: list(_array([row[name] for row in self.points.rows])) for name in self.points.names
        }
        for name, column in self._columns.items():
            columns[name] = column if column.ndim == 1 else list(column)
        return pandas.DataFrame(columns | {self.error_column: self.errors()})

    @property
    def error_column(self) -> str:
        """Name of the column of errors in tables: "error", or "sweep_error" where the function returns that name."""
        return f"{RESERVED}error" if "error" in (*self.points.names, *self) else "error"

    def errors(self) -> list[str]:
        """Return the error of every point, empty where there was none."""
        errors = [""] * len(self.points.rows)
        for one in self.failed:
            errors[one.index] = one.error
        return errors


def sweep_of(points: Points, rows: Sequence[Row], counters: dict[str, int]) -> Sweep:
    """Return the outcome of a sweep from its rows, in the order of the points."""
    rows = agreeing(rows)
    failed = tuple(
        FailedPoint(k, points.rows[k], row.error, row.traceback) for k, row in enumerate(rows) if row.values is None
    )
    seconds = np.array([row.seconds for row in rows])
    return Sweep(points, failed, seconds, dict(counters), (), columns_of(rows))


def agreeing(rows: Sequence[Row]) -> list[Row]:
    """Return the rows; those whose names, shapes or kinds differ from the first row are marked as failed."""
    pattern: dict[str, str] | None = None
    result = []
    for row in rows:
        if row.values is not None:
            found = {name: f"{_kind(value)} of shape {value.shape}" for name, value in row.values.items()}
            if pattern is None:
                pattern = found
            elif found != pattern:
                message = f"TypeError: the function returned {_shapes(found)}, expected {_shapes(pattern)} as at first"
                row = Row(None, message, "", row.seconds)
        result.append(row)
    return result


def columns_of(rows: Sequence[Row]) -> dict[str, NDArray]:
    """Return the values of rows that agree as arrays of shape (n_rows, ...), by name."""
    first = next((row.values for row in rows if row.values is not None), {})
    return {name: _column(name, first[name], rows) for name in first}


def _column(name: str, like: NDArray, rows: Sequence[Row]) -> NDArray:
    values = [None if row.values is None else row.values[name] for row in rows]
    present = [value for value in values if value is not None]
    kind = np.result_type(*{value.dtype for value in present})
    if len(present) < len(values) and kind.kind in "biu":
        kind = np.dtype(np.float64)
    empty = np.full(like.shape, np.nan if kind.kind in "fc" else 0, dtype=kind)
    if kind.kind == "U":
        empty = np.full(like.shape, "", dtype=kind)
    return np.stack([empty if value is None else value.astype(kind, copy=False) for value in values])


def _array(values: Sequence[Any]) -> NDArray:
    """Return parameter values as an array; as objects where they are neither all numbers nor all texts."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.empty(0, dtype=object)
    same_kind = len({isinstance(value, str) for value in values}) == 1
    if array.dtype.kind in "biufc" or (array.dtype.kind == "U" and same_kind):
        return array
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects


def _kind(value: NDArray) -> str:
    """Return what an array holds; of one kind are numbers that numpy can hold in one array without a change."""
    return {"U": "text", "c": "complex number"}.get(value.dtype.kind, "number")


def _shapes(pattern: dict[str, str]) -> str:
    return ", ".join(f"{name!r}: {found}" for name, found in pattern.items()) or "nothing"
