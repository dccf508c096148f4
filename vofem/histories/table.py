"""A table: columns of equal length, with units; and how a class declares what its columns are."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar, dataclass_transform, get_type_hints

import numpy as np
from numpy.typing import NDArray

from vofem._validate import unknown
from vofem.arrays import Array
from vofem.cards import Shown
from vofem.effects.two_points import UNITS, Units
from vofem.errors import ArgumentError

#: Rows that are shown as text.
_SHOWN = 20

C = TypeVar("C", bound=type)
V = TypeVar("V")


def column(unit: str | None, text: str, **options: Any) -> Any:
    """Return a field of a `tabled` class.

    `unit`: None where it is no column of tables. Names of `Units` in braces stand for units of the contact, as in
    ``"{force}"``.
    `text`: what it is, in a sentence or two.
    `options`: of `dataclasses.field`.
    """
    return field(metadata={"unit": unit, "text": text}, **options)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field, column))
def tabled(shape: str) -> Callable[[C], C]:
    """Make a frozen dataclass of a `Tabled` class: its fields, each a `column`, give tables and docstring.

    `shape`: what the docstring says of the shape of arrays.
    """

    def make(cls: C) -> C:
        made: Any = dataclass(frozen=True, eq=False, repr=False)(cls)
        hints = get_type_hints(cls)
        lines = [inspect.cleandoc(cls.__doc__ or ""), "", "Attributes", "----------"]
        for one in fields(made):
            kind = hints[one.name]
            plain = kind in (float, int, str, Units)
            shown = kind.__name__ if plain else "ndarray" + " of bool" * (kind != Array) + shape
            unit = (one.metadata["unit"] or "").format(**vars(UNITS["displacement"]))
            text = one.metadata["text"] + f" In {unit}." * bool(unit)
            lines += [f"{one.name} : {shown}"]
            lines += textwrap.wrap(text, 110, initial_indent="    ", subsequent_indent="    ")
        made.__doc__ = "\n".join(lines) + "\n"
        return made

    return make


class Tabled:
    """Numbers of a contact, in its units."""

    if TYPE_CHECKING:  # fields of all
        name: str
        units: Units
        why: str

    def quantities(self) -> dict[str, tuple[Any, str]]:
        """Return all columns with their units, by name."""
        units, every = vars(self.units), fields(self)  # type: ignore[arg-type]
        known = {one.name: one.metadata["unit"] for one in every if one.metadata["unit"] is not None}
        return {name: (getattr(self, name), str(unit).format(**units)) for name, unit in known.items()}


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

    def chosen(self, rows: NDArray) -> Table:
        """Return the rows of some numbers, as a table of the same columns."""
        columns = {name: (values[rows], self.units[name]) for name, values in self._columns.items()}
        return Table(columns, self.title, self.notes)

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


def joined(parts: Iterable[Tabled], title: str) -> Table:
    """Return the columns of several contacts one below the other, with their names; their reasons are notes."""
    parts = list(parts)
    found = [part.quantities() for part in parts]
    counts = [np.size(next(iter(one.values()))[0]) for one in found]
    columns: dict[str, tuple[Any, str]] = {
        "contact": (np.repeat(np.array([part.name for part in parts], dtype=np.str_), counts), "")
    }
    for name in found[0] if found else ():
        # Both units where some contacts act on rotations.
        unit = " or ".join(dict.fromkeys(one[name][1] for one in found))
        columns[name] = np.concatenate([np.atleast_1d(one[name][0]) for one in found]), unit
    return Table(columns, title, tuple(dict.fromkeys(part.why for part in parts if part.why)))


def by_name(what: str, columns: Iterable[tuple[str, V]]) -> dict[str, V]:
    """Return columns by name; raise `ArgumentError` where two have one name, of which a table would keep one alone."""
    found: dict[str, V] = {}
    for name, column in columns:
        if name in found:
            raise ArgumentError(f"{what}: two columns are named {name!r}; give one of them another name")
        found[name] = column
    return found


def _spelled(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return "-" if np.isnan(value) else f"{value:.6g}"
    return {True: "yes", False: "no"}[bool(value)] if isinstance(value, (bool, np.bool_)) else str(value)
