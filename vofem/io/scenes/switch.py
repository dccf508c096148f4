"""The switch of a contact in a scene file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from vofem.io.scenes.entry import Entry
from vofem.io.scenes.place import Book, Place


@dataclass(frozen=True)
class Switch:
    """The string 'ideal', or { resolved = { s0 = ... } }."""

    resolved: Entry
    expected: str = "'ideal' or { resolved = { s0 = 1000.0 } }"
    stand_ins: ClassVar[tuple[Any, ...]] = ("ideal",)

    def read(self, value: Any, place: Place) -> Any:
        """Return what `Contact` takes."""
        if value == "ideal":
            return value
        if not isinstance(value, dict) or set(value) != {self.resolved.name}:
            return place.expected(self.expected, value)
        return self.resolved.read(value[self.resolved.name], place.key(self.resolved.name))

    def write(self, value: Any, book: Book) -> Any:
        """Return the string or the table."""
        if value == "ideal":
            return value
        return {self.resolved.name: self.resolved.write_inside(value, book)}
