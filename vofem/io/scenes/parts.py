"""Kinds of values in scene files that name or contain other things: points, bodies, functions of t and of x."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vofem._validate import nearest
from vofem.bodies import Beam, BeamPoint, Body
from vofem.errors import ArgumentError
from vofem.io.scenes.entry import Entry
from vofem.io.scenes.kinds import NAME, NUMBER, Number, Numbers, Unwritable
from vofem.io.scenes.place import INVALID, Book, Invalid, Place
from vofem.time_functions import Arbitrary, TimeFunction, as_time_function
from vofem.time_functions.approximated import Approximated


def _body(name: str, place: Place, expected: str, only: tuple[str, ...] = ()) -> Body | Invalid:
    """Return a body by name; one that could not be built has been reported already."""
    book = place.book
    if name in book.bodies:
        return book.bodies[name]
    if name in book.broken:
        return INVALID
    known = only or (*book.bodies, *sorted(book.broken))
    hint = nearest(name, known) or (f"; there are {', '.join(map(repr, known))}" if known else "")
    return place.expected(expected, name, hint)


#: Takes the place of a beam that is not there, so that the rest of a table can be checked.
_ANY_BEAM = Beam(1.0, 1.0, 1.0, 1, name="stand-in")


@dataclass(frozen=True)
class BodyByName:
    """A body, or a beam, by its name."""

    beam: bool = False
    stand_ins: ClassVar[tuple[Any, ...]] = (_ANY_BEAM,)

    @property
    def expected(self) -> str:
        """What is wanted."""
        return "the name of a beam" if self.beam else "the name of a body"

    def read(self, value: Any, place: Place) -> Body | Invalid:
        """Return the body."""
        if not isinstance(value, str):
            return place.expected(self.expected, value)
        beams = tuple(name for name, body in place.book.bodies.items() if isinstance(body, Beam))
        body = _body(value, place, self.expected, beams if self.beam else ())
        if self.beam and not _has_axis(body):
            return place.expected(self.expected, value, ", which is a mass")
        return body

    def write(self, value: Any, book: Book) -> str:
        """Return the name."""
        return NAME.write(value.name, book)


def _has_axis(body: Body | Invalid) -> bool:
    """Return whether a body has points along an axis; of what could not be read this is not known."""
    return isinstance(body, Invalid) or hasattr(body, "at")


@dataclass(frozen=True)
class PointByName:
    """A point: 'beam@1.0', 'beam@left', 'beam@name of the mesh', a mass by its name, or { body = ..., at = ... }."""

    expected: str = "a point, such as 'beam@1.0', or the name of a mass"
    stand_ins: ClassVar[tuple[Any, ...]] = (_ANY_BEAM.at(0.0),)

    def read(self, value: Any, place: Place) -> Any:
        """Return the point."""
        if isinstance(value, dict):
            return self._read_table(value, place)
        if not isinstance(value, str) or not value:
            return place.expected(self.expected, value)
        book = place.book
        if value in book.bodies or value in book.broken or "@" not in value:
            body = _body(value, place, self.expected)
            if hasattr(body, "at"):
                return place.report(f"expected a point of a beam, found {value!r}; did you mean '{value}@right'?")
            return body
        name, _, where = value.rpartition("@")
        body = _body(name, place, f"a point of a body, the name of a body before '@', in {value!r}")
        return self._of(body, where, place)

    def _read_table(self, value: dict[str, Any], place: Place) -> Any:
        place.unknown_keys(value, ("body", "at"))
        if "body" not in value:
            return place.key("body").report("missing, expected the name of a body")
        body = BodyByName().read(value["body"], place.key("body"))
        if not _has_axis(body) and "at" not in value:
            return body
        if "at" not in value:
            return place.key("at").report("missing, expected an x, 'left', 'right' or a name of the mesh")
        if isinstance(value["at"], str):
            return self._of(body, value["at"], place.key("at"), by_name=True)
        x = NUMBER.read(value["at"], place.key("at"))
        return INVALID if isinstance(x, Invalid) else self._of(body, x, place.key("at"))

    @staticmethod
    def _of(body: Any, where: str | float, place: Place, by_name: bool = False) -> Any:
        if isinstance(body, Invalid):
            return body
        if not hasattr(body, "at"):
            return place.report(f"Mass {body.name!r} has no axis; write {body.name!r} alone")
        if isinstance(where, str) and not by_name and not (body.mesh is not None and where in body.mesh.points):
            with contextlib.suppress(ValueError):
                where = float(where)
        try:
            return body.at(where)
        except ArgumentError as error:
            return place.report(str(error))

    def write(self, value: Any, book: Book) -> Any:
        """Return the short form, or a table where that would mean another point."""
        name = NAME.write(value.body.name, book)
        if not isinstance(value, BeamPoint):
            return name
        x = repr(float(value.x))
        mesh = value.body.mesh
        unclear = f"{name}@{x}" in book.bodies or (mesh is not None and x in mesh.points)
        return {"body": name, "at": float(value.x)} if unclear else f"{name}@{x}"


@dataclass(frozen=True)
class OneOf:
    """An object of some class, as a table with one key that names the class, such as { sine = { ... } }."""

    expected: str
    entries: Mapping[str, Entry]
    stand_ins: tuple[Any, ...] = ()

    def names(self) -> str:
        """Return the names, for messages."""
        return ", ".join(self.entries)

    def read(self, value: Any, place: Place) -> Any:
        """Return the object."""
        if not isinstance(value, dict) or len(value) != 1:
            return place.expected(self.expected, value)
        ((name, content),) = value.items()
        if name not in self.entries:
            hint = nearest(name, tuple(self.entries)) or f"; expected one of {self.names()}"
            return place.key(name).report(f"unknown key{hint}")
        return self.entries[name].read(content, place.key(name))

    def write(self, value: Any, book: Book) -> Any:
        """Return the table."""
        for entry in self.entries.values():
            if type(value) is entry.made:
                return {entry.name: entry.write_inside(value, book)}
        raise Unwritable(f"{value!r} cannot be written to a scene file; expected {self.expected}")


@dataclass(frozen=True)
class OrNumber:
    """A number, or what another kind takes."""

    other: OneOf
    number: Number = NUMBER
    stand_ins: ClassVar[tuple[Any, ...]] = (1.0,)

    @property
    def expected(self) -> str:
        """Both."""
        return f"{self.number.expected} or {self.other.expected}"

    def read(self, value: Any, place: Place) -> Any:
        """Return a float or the object."""
        if isinstance(value, dict):
            return self.other.read(value, place)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return place.expected(self.expected, value)
        return self.number.read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return a number or the table."""
        if isinstance(value, (int, float, np.number)):
            return self.number.write(value, book)
        return self.other.write(value, book)


@dataclass(frozen=True)
class FunctionOfTime:
    """A number, or a table with one named function of time."""

    functions: OneOf
    constant: type
    stand_ins: ClassVar[tuple[Any, ...]] = (1.0,)

    @property
    def expected(self) -> str:
        """Both."""
        return f"a number or {self.functions.expected}"

    def read(self, value: Any, place: Place) -> TimeFunction | Invalid:
        """Return the function."""
        read = OrNumber(self.functions).read(value, place)
        return read if isinstance(read, Invalid) else as_time_function(read)

    def write(self, value: Any, book: Book) -> Any:
        """Return a number for a constant, else the table."""
        function = as_time_function(value)
        if type(function) is self.constant:
            return float(function.value)  # type: ignore[attr-defined]
        if isinstance(function, (Approximated, Arbitrary)):
            raise Unwritable(
                f"{function!r} is a callable, which a scene file cannot hold; use one of {self.functions.names()}"
            )
        return self.functions.write(function, book)


@dataclass(frozen=True)
class TimeFunctions:
    """An array of functions of time."""

    each: FunctionOfTime
    expected: str = "an array of functions of time"
    stand_ins: ClassVar[tuple[Any, ...]] = ()

    def read(self, value: Any, place: Place) -> tuple[Any, ...] | Invalid:
        """Return a tuple of them."""
        if not isinstance(value, list) or not value:
            return place.expected(self.expected, value)
        parts = tuple(self.each.read(part, place.index(k)) for k, part in enumerate(value))
        return INVALID if any(isinstance(part, Invalid) for part in parts) else parts

    def write(self, value: Any, book: Book) -> list[Any]:
        """Return an array."""
        return [self.each.write(part, book) for part in value]


@dataclass(frozen=True)
class Coefficient:
    """EI or rhoA: a number, one per element, a polynomial in x, or a table of numbers by subdomain of a mesh."""

    simple: OrNumber
    expected: str = "a positive number, an array of one per element, { polynomial = [...] } or a table by subdomain"
    stand_ins: ClassVar[tuple[Any, ...]] = (1.0,)

    def read(self, value: Any, place: Place) -> Any:
        """Return what `Beam` takes."""
        if isinstance(value, list):
            return Numbers(each=self.simple.number).read(value, place)
        if not isinstance(value, dict):
            read = self.simple.read(value, place) if not isinstance(value, (str, bool)) else None
            return place.expected(self.expected, value) if read is None else read
        if any(isinstance(part, (list, dict)) for part in value.values()) or not value:
            return self.simple.read(value, place)
        parts = {name: self.simple.number.read(part, place.key(name)) for name, part in value.items()}
        return INVALID if any(isinstance(part, Invalid) for part in parts.values()) else parts

    def write(self, value: Any, book: Book) -> Any:
        """Return a number, an array, or a table."""
        if isinstance(value, Mapping):
            return {NAME.write(name, book): float(part) for name, part in value.items()}
        if isinstance(value, (list, np.ndarray)) and np.ndim(value) == 1:
            return [float(part) for part in np.asarray(value).tolist()]
        if callable(value) and type(value) not in (entry.made for entry in self.simple.other.entries.values()):
            raise Unwritable(f"{value!r} is a callable, which a scene file cannot hold; use vofem.Polynomial")
        return self.simple.write(value, book)
