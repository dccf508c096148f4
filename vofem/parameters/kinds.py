"""Kinds of parameters: what is checked of a value, what documents say, and how scene files hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem._validate import HUGE, MANY, array, choice, flag, number, one_of, whole, wrong
from vofem.errors import ArgumentError
from vofem.parameters.place import INVALID, Book, Invalid, Place


class Unwritable(Exception):  # noqa: N818 - never leaves this package
    """A value cannot be written to a scene file; the message says why."""


class Kind:
    """The kind of a parameter: base class of all.

    Subclasses are dataclasses; `text` says in a sentence what the parameter means.
    """

    text: str = ""
    #: The type, as docstrings say it.
    shown = "object"
    #: What a scene file must hold; completes "expected ...".
    expected = "a value"
    #: Whether it must be given in a scene file although it has a default in Python.
    needed = False
    #: The values to choose from, for the message where a needed one is missing.
    choices = ""
    #: Whether scene files can hold it.
    writable = True
    #: The JSON schema of its TOML values, where it is the same for all of a kind.
    schema: ClassVar[Mapping[str, Any]] = {}

    @property
    def meaning(self) -> str:
        """What it means, with unit and limits."""
        return self.text

    def check(self, what: str, value: Any) -> Any:
        """Return the value as the object keeps it, or raise `ArgumentError` naming `what`."""
        return value

    def read(self, value: Any, place: Place) -> Any:
        """Return what a TOML value means, or report what is wrong and return `INVALID`."""
        what = place.last
        try:
            return self.check(what, value)
        except ArgumentError as error:
            if error.parts:
                return place.expected(error.parts[1], value, error.parts[2])
            return place.report(str(error).removeprefix(f"{what}: "))

    def write(self, value: Any, book: Book) -> Any:
        """Return the TOML value of an attribute, or raise `Unwritable`."""
        return value

    def described(self) -> dict[str, Any]:
        """Return the JSON schema of its TOML values, with its meaning."""
        return {**self.schema, "description": self.meaning} if self.meaning else dict(self.schema)


@dataclass(frozen=True)
class Real(Kind):
    """A finite number with a unit: any, a positive one, or one between limits, of which `below` is no value itself."""

    unit: str = ""
    text: str = ""
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None

    shown = "float"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """Its limits."""
        if self.below is not None or self.most is not None:
            end = f"{self.most:g}" if self.below is None else f"below {self.below:g}"
            return f"a number from {self.least:g} to {end}"
        if self.least is not None:
            return "a number that is not negative" if self.least == 0 else f"a number not below {self.least:g}"
        return "a number" if self.above is None else "a positive number"

    @property
    def meaning(self) -> str:
        """What it means, its unit and its limits."""
        limits = {"a positive number": ", positive", "a number that is not negative": ", not negative"}
        unit = f" In {self.unit}" if self.unit else ""
        limit = limits.get(self.expected, "")
        end = f"{unit}{limit}." if unit else f" {limit[2:].capitalize()}." if limit else ""
        return f"{self.text}{end}"

    def check(self, what: str, value: Any) -> float:
        """Return a float within the limits."""
        if self.below is None and self.most is None:
            return number(what, value, minimum=self.least, positive=self.above is not None)
        result = number(what, value)
        low, high = self.ends
        if not low <= result <= high or result == self.below:
            raise wrong(what, f"{result:g}", self.expected)
        return result

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its range; infinite where there is no limit."""
        low, high = (self.least, self.above), (self.most, self.below)
        return next((x for x in low if x is not None), -np.inf), next((x for x in high if x is not None), np.inf)

    def read(self, value: Any, place: Place) -> float | Invalid:
        """Return a float; in a file NaN was not computed anywhere."""
        if isinstance(value, float) and not abs(value) <= HUGE:
            return place.expected(f"a finite number (magnitude at most {HUGE:g})", value)
        found: float | Invalid = super().read(value, place)
        return found

    def write(self, value: Any, book: Book) -> float:
        """Return a plain float."""
        return float(value)

    def described(self) -> dict[str, Any]:
        """Return a number with its limits."""
        limits = {"exclusiveMinimum": self.above, "minimum": self.least, "exclusiveMaximum": self.below,
                  "maximum": self.most}  # fmt: skip
        return {"type": "number", **{k: v for k, v in limits.items() if v is not None}, **super().described()}


#: Without unit and limits.
ANY_NUMBER = Real()


@dataclass(frozen=True)
class Count(Kind):
    """How many there are of something: a whole number, 1 or more."""

    text: str = ""

    shown = "int"
    expected = f"a whole number from 1 to {MANY}"
    schema: ClassVar = {"type": "integer", "minimum": 1, "maximum": MANY}

    def check(self, what: str, value: Any) -> int:
        """Return an int."""
        return whole(what, value, most=MANY)

    def write(self, value: Any, book: Book) -> int:
        """Return a plain int."""
        return int(value)


@dataclass(frozen=True)
class Flag(Kind):
    """True or False."""

    text: str = ""

    shown = "bool"
    expected = "true or false"
    schema: ClassVar = {"type": "boolean"}

    def check(self, what: str, value: Any) -> bool:
        """Return a bool."""
        return flag(what, value)

    def read(self, value: Any, place: Place) -> bool | Invalid:
        """Return a bool; its names in TOML are small."""
        return value if isinstance(value, bool) else place.expected(self.expected, value)


@dataclass(frozen=True)
class Choice(Kind):
    """One of some names."""

    allowed: tuple[str, ...] = ()
    text: str = ""
    #: Given where the parameter is needed and has no default: what the message for a missing one recommends.
    choices: str = ""

    @property
    def needed(self) -> bool:  # type: ignore[override]
        """Whether there is no default."""
        return bool(self.choices)

    @property
    def shown(self) -> str:  # type: ignore[override]
        """The names."""
        return "{" + ", ".join(f'"{name}"' for name in self.allowed) + "}"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """The names."""
        return one_of(self.allowed)

    def check(self, what: str, value: Any) -> str:
        """Return the name."""
        return choice(what, value, self.allowed)

    def described(self) -> dict[str, Any]:
        """Return the names."""
        return {"enum": list(self.allowed), **super().described()}


@dataclass(frozen=True)
class Name(Kind):
    """A string that is not empty; the constructor chooses one where none is given."""

    text: str = "Unique in a scene."
    needed: bool = False  #: Whether scene files must give it. Names of effects are numbered there.

    shown = "str"
    expected = "a name, a string that is not empty"
    schema: ClassVar = {"type": "string", "minLength": 1}

    def read(self, value: Any, place: Place) -> str | Invalid:
        """Return the string."""
        return value if isinstance(value, str) and value else place.expected(self.expected, value)

    def write(self, value: Any, book: Book) -> str:
        """Return the string, if it is Unicode text."""
        try:
            return checked_name("a name", value)
        except ArgumentError as error:
            raise Unwritable(str(error)) from None


def checked_name(what: str, value: Any) -> str:
    """Return a name as a plain string, which every file can hold, or raise `ArgumentError` naming `what`."""
    if not isinstance(value, str) or not value:
        raise wrong(what, repr(value), "a non-empty string")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise wrong(what, repr(value), "text", "; it has characters that are not valid Unicode; rename it") from None
    # Texts of numpy, such as an entry of an array, are strings too.
    return str(value)


@dataclass(frozen=True)
class Label(Name):
    """A name that may be left out: a string that is not empty, or None."""

    text: str = "Name by which `vofem.Parameter` finds it."

    def check(self, what: str, value: Any) -> str | None:
        """Return the string, or None where there is none."""
        return None if value is None else checked_name(what, value)


@dataclass(frozen=True)
class Numbers(Kind):
    """An array of finite numbers, not empty."""

    unit: str = ""
    text: str = ""
    each: Real = ANY_NUMBER  #: Limits of its entries in scene files.

    shown = "array_like, shape (n,)"
    expected = "an array of numbers"

    @property
    def meaning(self) -> str:
        """What it means, and its unit."""
        return f"{self.text} In {self.unit}." if self.unit else self.text

    def check(self, what: str, value: Any) -> NDArray[np.float64]:
        """Return an array of floats."""
        values = array(what, value)
        if not values.size:
            raise wrong(what, "empty", self.expected)
        return values

    def read(self, value: Any, place: Place) -> Any:
        """Return an array of floats; each entry is looked at."""
        if not isinstance(value, list) or not value:
            return place.expected(self.expected, value)
        parts = [self.each.read(part, place.index(k)) for k, part in enumerate(value)]
        return INVALID if any(isinstance(part, Invalid) for part in parts) else super().read(parts, place)

    def write(self, value: Any, book: Book) -> list[float]:
        """Return plain floats."""
        return [float(part) for part in np.asarray(value).tolist()]

    def described(self) -> dict[str, Any]:
        """Return an array of numbers."""
        return {"type": "array", "items": self.each.described(), "minItems": 1, **super().described()}


class Either(Kind):
    """A value of one of several kinds, which scene files tell apart: a number, an array, or a table."""

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return the kinds of a number, of an array and of a table, None where there is no such form."""
        raise NotImplementedError

    def read(self, value: Any, place: Place) -> Any:
        """Return what the kind of this form reads."""
        number, array, table = self.forms()
        form = table if isinstance(value, dict) else array if isinstance(value, list) else number
        if form is None or isinstance(value, bool) or not isinstance(value, (int, float, list, dict)):
            return place.expected(self.expected, value)
        return form.read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return what the kind of this form writes."""
        number, array, table = self.forms()
        form = array if np.ndim(value) else number if isinstance(value, (int, float, np.number)) else table
        if form is None:
            raise Unwritable(f"{value!r} cannot be written to a scene file; expected {self.expected}")
        return form.write(value, book)

    def described(self) -> dict[str, Any]:
        """Return all forms."""
        return {"anyOf": [form.described() for form in self.forms() if form is not None], **super().described()}


@dataclass(frozen=True)
class RealOrArray(Either):
    """One number, or an array of them."""

    each: Real = ANY_NUMBER
    text: str = ""

    shown = "float or array_like, shape (k,)"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """What one is."""
        return f"{self.each.expected}, or an array of these"

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return both."""
        return self.each, Numbers(each=self.each), None

    def check(self, what: str, value: Any) -> float | NDArray[np.float64]:
        """Return a float or an array of one dimension, whose entries are within the limits."""
        if np.ndim(value) == 0:
            return self.each.check(what, value)
        values = array(what, value)
        if values.ndim != 1 or not values.size:
            raise ArgumentError(f"{what} has shape {values.shape}, expected a number or a list of numbers")
        for k, one in enumerate(values.tolist()):
            self.each.check(f"{what}[{k}]", one)
        return values


@dataclass(frozen=True)
class Function(Kind):
    """A Python function, which scene files cannot hold."""

    of: str = ""  #: What it is a function of, for messages.
    text: str = ""

    shown = "callable"
    writable = False

    @property
    def expected(self) -> str:  # type: ignore[override]
        """A function."""
        return f"a callable of {self.of}"

    def check(self, what: str, value: Any) -> Any:
        """Return the function."""
        if not callable(value):
            raise wrong(what, repr(value), self.expected)
        return value
