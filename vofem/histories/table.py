"""A table: columns of equal length, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import unknown
from vofem.cards import Shown

#: Rows that are shown as text.
_SHOWN = 20


class Table(Shown, Mapping[str, NDArray]):
    """Columns of equal length by name: a mapping of names to arrays, each of shape (n_rows,).

    Parameters
    ----------
    columns : dict of str to (array, str)
        The values and their unit. The unit is "" for texts, truth values and numbers without unit.
    title : str
    notes : tuple of str
        Sentences that a reader of the numbers should know.

    Attributes
    ----------
    units : dict of str to str
        The unit of each column, by its name.
    title : str
    notes : tuple of str
    """

    def __init__(self, columns: dict[str, tuple[Any, str]], title: str, notes: tuple[str, ...] = ()) -> None:
        self._columns = {name: np.asarray(values) for name, (values, _) in columns.items()}
        self.units = {name: unit for name, (_, unit) in columns.items()}
        self.title, self.notes = title, notes

    def __getitem__(self, name: str) -> NDArray:
        if name not in self._columns:
            known = tuple(self._columns)
            raise unknown("column", name, known, what=self.title)
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(next(iter(self._columns.values())).size) if self._columns else 0

    def headings(self) -> list[str]:
        """Return the names of the columns with their units."""
        return [f"{name} [{unit}]" if unit else name for name, unit in self.units.items()]

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame`; units, title and notes are in its `attrs`."""
        import pandas

        frame = pandas.DataFrame(self._columns)
        frame.attrs.update(units=dict(self.units), title=self.title, notes=list(self.notes))
        return frame

    def text(self, most: int = _SHOWN) -> list[list[str]]:
        """Return headings and the first rows as text."""
        columns = [values[:most] for values in self._columns.values()]
        return [self.headings(), *([_spelled(value) for value in row] for row in zip(*columns, strict=True))]

    def __str__(self) -> str:
        lines = self.text()
        widths = [max(len(line[k]) for line in lines) for k in range(len(self))]
        shown = ["   ".join(part.rjust(width) for part, width in zip(line, widths, strict=True)) for line in lines]
        more = [f"... and {self.rows - _SHOWN} more"] if self.rows > _SHOWN else []
        return "\n".join([self.title, *shown, *more, *(f"note: {note}" for note in self.notes)])

    __repr__ = __str__


def _spelled(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return "-" if np.isnan(value) else f"{value:.6g}"
    return {True: "yes", False: "no"}[bool(value)] if isinstance(value, (bool, np.bool_)) else str(value)
