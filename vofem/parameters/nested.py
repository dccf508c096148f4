"""Parameters whose values are objects with parameters of their own, such as functions of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vofem._validate import nearest
from vofem.parameters.declared import read, schema_of, write_inside
from vofem.parameters.kinds import Kind, Real, Unwritable
from vofem.parameters.place import Book, Place


@dataclass(frozen=True)
class OneOf(Kind):
    """An object of some class, in scene files a table with one key that names the class."""

    text: str = ""
    classes: Mapping[str, type] = field(default_factory=dict)  #: Declared classes by their names in scene files.
    expected: str = "a table with one key"  #: An example, for messages.

    def names(self) -> str:
        """Return the names, for messages."""
        return ", ".join(self.classes)

    def read(self, value: Any, place: Place) -> Any:
        """Return the object."""
        if not isinstance(value, dict) or len(value) != 1:
            return place.expected(self.expected, value)
        ((name, content),) = value.items()
        if name not in self.classes:
            hint = nearest(name, tuple(self.classes)) or f"; expected one of {self.names()}"
            return place.key(name).report(f"unknown key{hint}")
        return read(self.classes[name], content, place.key(name))

    def write(self, value: Any, book: Book) -> Any:
        """Return the table."""
        for name, cls in self.classes.items():
            if type(value) is cls:
                return {name: write_inside(value, book)}
        raise Unwritable(f"{value!r} cannot be written to a scene file; expected {self.expected}")

    def described(self) -> dict[str, Any]:
        """Return a table with one of the keys."""
        tables = {name: schema_of(cls) for name, cls in self.classes.items()}
        return {"type": "object", "properties": tables, "minProperties": 1, "maxProperties": 1,
                "additionalProperties": False, **super().described()}  # fmt: skip


def read_number_or(number: Real, other: Kind, expected: str, value: Any, place: Place) -> Any:
    """Return a number, or what another kind takes: a table."""
    if isinstance(value, dict):
        return other.read(value, place)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return place.expected(expected, value)
    return number.read(value, place)


def write_number_or(number: Real, other: Kind, value: Any, book: Book) -> Any:
    """Return a number, or the table of another kind."""
    return number.write(value, book) if isinstance(value, (int, float, np.number)) else other.write(value, book)
