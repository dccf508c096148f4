"""Kinds of simple values in scene files: each reads a TOML value, and writes one."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from vofem._validate import HUGE, nearest, one_of
from vofem.io.scenes.place import INVALID, Book, Invalid, Place


class Unwritable(Exception):  # noqa: N818 - never leaves this package
    """A value cannot be written to a scene file; the message says why."""


class Kind(Protocol):
    """How one kind of value is read and written."""

    @property
    def expected(self) -> str:
        """Completes "expected ..." in messages."""

    @property
    def stand_ins(self) -> tuple[Any, ...]:
        """Valid values that take the place of an invalid one, so that the rest of a table can be checked."""

    def read(self, value: Any, place: Place) -> Any:
        """Return what a TOML value means, or report what is wrong and return `INVALID`."""

    def write(self, value: Any, book: Book) -> Any:
        """Return the TOML value of an attribute, or raise `Unwritable`."""


@dataclass(frozen=True)
class Number:
    """A finite number: any, a positive one, or one that is not negative."""

    expected: str = "a number"
    positive: bool = False
    minimum: float = -math.inf
    stand_ins: tuple[Any, ...] = (1.0,)

    def read(self, value: Any, place: Place) -> float | Invalid:
        """Return a float; booleans are no numbers."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return place.expected(self.expected, value)
        if not abs(value) <= HUGE:
            return place.expected(f"a finite number (magnitude at most {HUGE:g})", value)
        if (self.positive and value <= 0) or value < self.minimum:
            return place.expected(self.expected, value)
        return float(value)

    def write(self, value: Any, book: Book) -> float:
        """Return a plain float."""
        return float(value)


NUMBER = Number()
POSITIVE = Number("a positive number", positive=True)
NOT_NEGATIVE = Number("a number that is not negative", minimum=0.0)
#: A positive number on which the meaning of other keys depends.
POSITIVE_BASIS = Number("a positive number", positive=True, stand_ins=())


@dataclass(frozen=True)
class Count:
    """A whole number, 1 or more."""

    expected: str = "a whole number, 1 or more"
    stand_ins: ClassVar[tuple[Any, ...]] = (2,)

    def read(self, value: Any, place: Place) -> int | Invalid:
        """Return an int."""
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= HUGE:
            return place.expected(self.expected, value)
        return value

    def write(self, value: Any, book: Book) -> int:
        """Return a plain int."""
        return int(value)


@dataclass(frozen=True)
class YesOrNo:
    """A boolean."""

    expected: str = "true or false"
    stand_ins: ClassVar[tuple[Any, ...]] = (True, False)

    def read(self, value: Any, place: Place) -> bool | Invalid:
        """Return a bool."""
        return value if isinstance(value, bool) else place.expected(self.expected, value)

    def write(self, value: Any, book: Book) -> bool:
        """Return a plain bool."""
        return bool(value)


@dataclass(frozen=True)
class Numbers:
    """An array of finite numbers, not empty."""

    expected: str = "an array of numbers"
    each: Number = NUMBER
    stand_ins: ClassVar[tuple[Any, ...]] = ()

    def read(self, value: Any, place: Place) -> list[float] | Invalid:
        """Return a list of floats."""
        if not isinstance(value, list) or not value:
            return place.expected(self.expected, value)
        parts = [self.each.read(part, place.index(k)) for k, part in enumerate(value)]
        return INVALID if any(isinstance(part, Invalid) for part in parts) else parts  # type: ignore[return-value]

    def write(self, value: Any, book: Book) -> list[float]:
        """Return plain floats."""
        return [float(part) for part in np.asarray(value).tolist()]


@dataclass(frozen=True)
class NumberOrNumbers:
    """One number, or an array of them."""

    each: Number = NUMBER

    @property
    def expected(self) -> str:
        """What one is."""
        return f"{self.each.expected}, or an array of these"

    @property
    def stand_ins(self) -> tuple[Any, ...]:
        """Those of one number."""
        return self.each.stand_ins

    def read(self, value: Any, place: Place) -> Any:
        """Return a float or a list of floats."""
        kind: Kind = Numbers(self.expected, self.each) if isinstance(value, list) else self.each
        return kind.read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return a plain float or plain floats."""
        return Numbers().write(value, book) if np.ndim(value) else self.each.write(value, book)


@dataclass(frozen=True)
class Choice:
    """One of some names."""

    allowed: tuple[str, ...]

    @property
    def expected(self) -> str:
        """The names."""
        return one_of(self.allowed)

    @property
    def stand_ins(self) -> tuple[Any, ...]:
        """All, the last first."""
        return self.allowed[::-1]

    def read(self, value: Any, place: Place) -> str | Invalid:
        """Return the name."""
        if not isinstance(value, str) or value not in self.allowed:
            return place.expected(self.expected, value, nearest(value, self.allowed) if isinstance(value, str) else "")
        return value

    def write(self, value: Any, book: Book) -> str:
        """Return the name."""
        return str(value)


@dataclass(frozen=True)
class Name:
    """A string that is not empty."""

    expected: str = "a name, a string that is not empty"
    stand_ins: ClassVar[tuple[Any, ...]] = ("stand-in",)

    def read(self, value: Any, place: Place) -> str | Invalid:
        """Return the string."""
        return value if isinstance(value, str) and value else place.expected(self.expected, value)

    def write(self, value: Any, book: Book) -> str:
        """Return the string, if it is Unicode text."""
        try:
            value.encode()
        except UnicodeEncodeError:
            raise Unwritable(f"{value!r} has characters that are not valid Unicode; rename it") from None
        return str(value)


@dataclass(frozen=True)
class MeshPath:
    """The path of a mesh file, relative to the scene file."""

    expected: str = "the path of a mesh file, relative to the scene file"
    stand_ins: ClassVar[tuple[Any, ...]] = ()

    def read(self, value: Any, place: Place) -> Path | Invalid:
        """Return the path."""
        if not isinstance(value, str) or not value or "\0" in value:
            return place.expected(self.expected, value)
        return place.book.folder / value

    def write(self, value: Any, book: Book) -> str:
        """Return the path relative to the file that is written, with forward slashes."""
        goal = os.path.abspath(value)
        try:
            relative = os.path.relpath(goal, os.path.abspath(book.folder))
        except ValueError:  # another drive of Windows
            relative = goal
        return NAME.write(Path(relative).as_posix(), book)


NAME = Name()


@dataclass(frozen=True)
class Supports:
    """A table of places and kinds; the places are names, or x in quotes."""

    kinds: tuple[str, ...]
    expected: str = "a table such as { left = 'clamped', '0.5' = 'pinned' }"
    stand_ins: ClassVar[tuple[Any, ...]] = ({},)

    def read(self, value: Any, place: Place) -> dict[str, str] | Invalid:
        """Return kinds by place as written; what the places mean depends on the mesh."""
        if not isinstance(value, dict):
            return place.expected(self.expected, value)
        result = {}
        for where, kind in value.items():
            here = place.key(where)
            if isinstance(kind, dict):
                here.expected(one_of(self.kinds), kind, f"; an x needs quotes, such as '{where}.5' = 'pinned'")
                continue
            result[where] = Choice(self.kinds).read(kind, here)
        bad = len(result) < len(value) or any(isinstance(kind, Invalid) for kind in result.values())
        return INVALID if bad else result  # type: ignore[return-value]

    def write(self, value: Mapping[str, str], book: Book) -> dict[str, str]:
        """Return the table."""
        return {NAME.write(where, book): kind for where, kind in value.items()}
