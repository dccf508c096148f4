"""Where in a scene file a value stands, and the list of what is wrong there."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vofem._validate import nearest
from vofem.files import toml_text


class Invalid:
    """What reading returns for a value whose problem has been reported."""


INVALID = Invalid()


@dataclass
class Book:
    """What is known while a file is read, or a scene written."""

    folder: Path  #: Where relative paths start.
    bodies: dict[str, Any] = field(default_factory=dict)  #: The bodies that could be built.
    #: Names of those that could not: what refers to them is not reported again.
    broken: set[str] = field(default_factory=set)
    problems: list[tuple[str, str]] = field(default_factory=list)  #: Key path and message.
    whole: bool = False  #: Whether a scene is written with the nodes of meshes, not with the paths of their files.


@dataclass(frozen=True)
class Place:
    """A key of the file."""

    book: Book
    path: str = ""  #: Its path, such as ``contact[2].stiffness``.
    last: str = ""  #: The end of the path, ``stiffness``.

    def key(self, name: str) -> Place:
        """Return the place of a key of this table."""
        return Place(self.book, f"{self.path}.{toml_text.key(name)}" if self.path else toml_text.key(name), name)

    def index(self, k: int) -> Place:
        """Return the place of an entry of this array, counted from 0."""
        return Place(self.book, f"{self.path}[{k}]", f"entry {k}")

    def report(self, message: str) -> Invalid:
        """Note a problem here."""
        self.book.problems.append((self.path, message))
        return INVALID

    def expected(self, what: str, value: Any, hint: str = "") -> Invalid:
        """Note that a value is not what was expected."""
        return self.report(f"expected {what}, found {found(value)}{hint}")

    def unknown_keys(self, given: dict[str, Any], allowed: tuple[str, ...]) -> None:
        """Note every key that is none of `allowed`."""
        for name in given:
            if name not in allowed:
                hint = nearest(name, allowed) or f"; expected one of {', '.join(allowed)}"
                self.key(name).report(f"unknown key{hint}")


def found(value: Any) -> str:
    """Return a value as a message shows it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return repr(value) if len(value) <= 60 else f"{value[:57]!r}..."
    if isinstance(value, dict):
        return f"a table with {', '.join(list(value)[:4])}" if value else "an empty table"
    if isinstance(value, list):
        return f"an array of {len(value)}" if value else "an empty array"
    if isinstance(value, (datetime.date, datetime.time)):
        return f"a date or time, {value}"
    if isinstance(value, int) and abs(value) > 10**30:
        return f"a whole number of {int(math.log10(abs(value))) + 1} digits"
    return repr(value)
