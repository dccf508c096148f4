"""The outcome of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import nearest, number, one_of, unknown
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
        Its `missing` are the points that were not reached.
    """

    def __init__(self, sweep: Sweep, kept: Any = None) -> None:
        total = len(sweep.points.rows)
        done = total - len(sweep.missing)
        where = f"kept in {kept}; the same call computes the rest" if kept else "in the `sweep` of this error"
        super().__init__(f"sweep: stopped by Ctrl-C after {done} of {total} points, which are {where}")
        self.sweep = sweep


@dataclass(frozen=True, eq=False)
class Sweep(Mapping[str, NDArray]):
    """The outcome of many runs: one array for every quantity that the function returned.

    It is a mapping of names to arrays. The first dimensions of an array are those of the grid, or a single one if the
    points were a table. The dimensions of the quantity follow. Where a point failed, numbers are NaN and texts are
    empty; integers of such a quantity become floats.

    Attributes
    ----------
    points : Points
        The points in order: `names`, `rows`, and `axes` of a grid.
    failed : tuple of FailedPoint
        The points that failed, in the order of the points.
    seconds : array of float, shape (n_points,)
        Wall time of every point in s, 0 where it was not computed. For rows from the store it is the time of the
        earlier sweep.
    counters : dict
        ``computed``, ``stored`` (taken from the store), ``batches`` and ``restarts`` of workers.
    notes : tuple of str
        Sentences that a reader of the numbers should know.
    missing : tuple of int
        Positions of the points that were not computed, because the sweep was stopped before.
    """

    points: Points
    failed: tuple[FailedPoint, ...]
    seconds: NDArray[np.float64]
    counters: dict[str, int]
    notes: tuple[str, ...]
    _columns: dict[str, NDArray] = field(repr=False)
    missing: tuple[int, ...] = ()

    def __getitem__(self, name: str) -> NDArray:
        if not isinstance(name, str) or name not in self._columns:
            raise unknown("quantity", name, self._columns)
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
        parts += [f"{len(self.missing)} not computed"] if self.missing else []
        parts += [f"{len(self.notes)} notes"] if self.notes else []
        return f"<Sweep: {'; '.join(parts)}>"

    def parameter(self, name: str) -> NDArray:
        """Return the value of a parameter at every point, in the shape of the quantities.

        Raises
        ------
        ArgumentError
            If there is no such parameter.
        """
        if not isinstance(name, str) or name not in self.points.names:
            raise unknown("parameter", name, self.points.names)
        values = _array([row[name] for row in self.points.rows])
        return values.reshape(*self.points.shape, *values.shape[1:])

    def mean(self, name: str, over: str | None = None) -> NDArray:
        """Return the mean of a quantity over random records, points that failed left out.

        Parameters
        ----------
        name : str
            A quantity that is a number, or an array of numbers, at every point.
        over : str, optional
            The parameter that numbers the records, such as a seed, which is a dimension of the grid. By default the
            mean is taken over all points.

        Returns
        -------
        ndarray
            In the shape of the quantity without the dimension of `over`.

        Raises
        ------
        ArgumentError
            If there is no such quantity or dimension, or the quantity holds texts.
        """
        values, axis = self._records(name, over)
        count = np.sum(~np.isnan(values), axis=axis)
        return np.asarray(np.nansum(values, axis=axis) / np.where(count > 0, count, np.nan))

    def confidence(self, name: str, over: str | None = None, *, level: float = 0.95) -> NDArray:
        """Return half the width of the confidence interval of `mean`, by Student's distribution.

        The mean of ever more records lies within ``mean - confidence`` and ``mean + confidence`` with the probability
        `level`, if records are independent, and are normally distributed or many. It is NaN for fewer than two records.

        Parameters
        ----------
        name, over
            As for `mean`.
        level : float
            Probability, between 0 and 1.

        Returns
        -------
        ndarray
            In the shape of `mean`.
        """
        from scipy.stats import t as student

        level = number("sweep: level", level, positive=True)
        if level >= 1.0:
            raise ArgumentError(f"sweep: level is {level:g}, expected a probability between 0 and 1, such as 0.95")
        values, axis = self._records(name, over)
        off = values - np.expand_dims(self.mean(name, over), axis)
        count = np.sum(~np.isnan(values), axis=axis)
        enough = np.maximum(count, 2)
        spread = np.sqrt(np.nansum(off**2, axis=axis) / (enough - 1))
        width = student.ppf(0.5 * (1.0 + level), enough - 1) * spread / np.sqrt(enough)
        return np.asarray(np.where(count > 1, width, np.nan))

    def _records(self, name: str, over: str | None) -> tuple[NDArray, int | tuple[int, ...]]:
        """Return a quantity as floats, and the dimensions of its records."""
        column = self[name]
        if column.dtype.kind not in "biuf":
            raise ArgumentError(f"sweep: {name!r} holds no real numbers, so it has no mean")
        if over is None:
            return column.astype(float), tuple(range(len(self.points.shape)))
        if self.points.axes is None or over not in self.points.names:
            names = self.points.names
            raise ArgumentError(
                f"sweep: over is {over!r}, expected a parameter of a grid: {one_of(tuple(names))}{nearest(over, names)}"
            )
        return column.astype(float), self.points.names.index(over)

    def with_notes(self, notes: Sequence[str]) -> Sweep:
        """Return the same sweep with some notes in front of its own."""
        return replace(self, notes=(*notes, *self.notes))

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset`.

        Its dimensions are the parameters of a grid, or ``point`` with the parameters as coordinates beside it. Further
        dimensions of a quantity are named ``NAME_0``, ``NAME_1`` and so on.
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
        for index in self.missing:
            errors[index] = NOT_REACHED.error
        return errors


#: The row of a point that was not computed.
NOT_REACHED = Row(None, "not computed: the sweep was stopped before")


def sweep_of(points: Points, rows: Sequence[Row], counters: dict[str, int]) -> Sweep:
    """Return the outcome of a sweep from its rows, in the order of the points."""
    rows = agreeing(rows)
    failed = tuple(
        FailedPoint(k, points.rows[k], row.error, row.traceback)
        for k, row in enumerate(rows)
        if row.values is None and row is not NOT_REACHED
    )
    missing = tuple(k for k, row in enumerate(rows) if row is NOT_REACHED)
    seconds = np.array([row.seconds for row in rows])
    return Sweep(points, failed, seconds, dict(counters), (), columns_of(rows), missing)


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
                row = Row(None, message, seconds=row.seconds)
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
