"""Kinds of parameters of effects: points, bodies, and fields along a beam."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from vofem._validate import nearest
from vofem.bodies.base import Body, Point, as_point
from vofem.bodies.beam import Beam
from vofem.bodies.path import Path, TravellingPoint
from vofem.errors import ArgumentError
from vofem.parameters import Choice, Kind, Label, Name, Real, declarations
from vofem.parameters.declared import declared, read, write_inside
from vofem.parameters.place import INVALID, Book, Invalid, Place

_NAME = Name()


def _body(name: str, place: Place, expected: str, only: tuple[str, ...] = ()) -> Any:
    """Return a body by name; one that could not be built has been reported already."""
    book = place.book
    if name in book.bodies:
        return book.bodies[name]
    if name in book.broken:
        return INVALID
    known = only or (*book.bodies, *sorted(book.broken))
    hint = nearest(name, known) or (f"; there are {', '.join(map(repr, known))}" if known else "")
    return place.expected(expected, name, hint)


def _has_axis(body: Any) -> bool:
    """Return whether a body has points along an axis; of what could not be read this is not known."""
    return isinstance(body, Invalid) or body.shape.kind == "line"


@dataclass(frozen=True)
class OnBody(Kind):
    """A body, or a beam; in scene files its name."""

    text: str = ""
    beam: bool = False
    schema: ClassVar = {"type": "string"}

    @property
    def shown(self) -> str:  # type: ignore[override]
        """The classes."""
        return "Beam" if self.beam else "Beam or Mass"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """What is wanted."""
        return "the name of a beam" if self.beam else "the name of a body"

    def check(self, what: str, value: Any) -> Any:
        """Return the body."""
        if not isinstance(value, Beam if self.beam else Body):
            raise ArgumentError(f"{what} is {value!r}, expected {'a Beam' if self.beam else 'a Beam or a Mass'}")
        return value

    def read(self, value: Any, place: Place) -> Any:
        """Return the body of a name."""
        if not isinstance(value, str):
            return place.expected(self.expected, value)
        beams = tuple(name for name, body in place.book.bodies.items() if isinstance(body, Beam))
        body = _body(value, place, self.expected, beams if self.beam else ())
        if self.beam and not _has_axis(body):
            return place.expected(self.expected, value, ", which is a mass")
        return body

    def write(self, value: Any, book: Book) -> str:
        """Return the name."""
        return _NAME.write(value.name, book)


@dataclass(frozen=True)
class AtPoint(Kind):
    """A point.

    In scene files: 'beam@1.0', 'beam@left', 'beam@name of the mesh', a mass by its name, { body = ..., at = ... }, or
    { body = ..., path = { speed = ... } } where points may travel.
    """

    text: str = "``beam.at(x)`` or a `Mass`."
    travels: bool = False

    shown = "point"
    expected = "a point, such as 'beam@1.0', or the name of a mass"

    def check(self, what: str, value: Any) -> Point:
        """Return the point."""
        point = as_point(what, value)
        if isinstance(point, TravellingPoint) and not self.travels:
            raise ArgumentError(
                f"{what} is a point of {point.describe()}, which travels; only point loads, contacts, springs, "
                f"dashpots and point masses take such a point. Give {point.body.name}.at(x)"
            )
        return point

    def read(self, value: Any, place: Place) -> Any:
        """Return the point of a text or a table."""
        if isinstance(value, dict):
            return self._read_table(value, place)
        if not isinstance(value, str) or not value:
            return place.expected(self.expected, value)
        book = place.book
        if value in book.bodies or value in book.broken or "@" not in value:
            body = _body(value, place, self.expected)
            if not isinstance(body, Invalid) and _has_axis(body):
                return place.report(f"expected a point of a beam, found {value!r}; did you mean '{value}@right'?")
            return body
        name, _, where = value.rpartition("@")
        body = _body(name, place, f"a point of a body, the name of a body before '@', in {value!r}")
        return self._of(body, where, place)

    def _read_table(self, value: dict[str, Any], place: Place) -> Any:
        place.unknown_keys(value, ("body", "at", "path") if self.travels else ("body", "at"))
        if "body" not in value:
            return place.key("body").report("missing, expected the name of a body")
        body = OnBody(beam="path" in value).read(value["body"], place.key("body"))
        if "path" in value and self.travels:
            if "at" in value:
                return place.key("at").report("a point that travels has a path and no place of its own; remove one")
            path = read(Path, value["path"], place.key("path"))
            bad = isinstance(path, Invalid) or isinstance(body, Invalid)
            return INVALID if bad else body.along(path)
        if not _has_axis(body) and "at" not in value:
            return body
        if "at" not in value:
            return place.key("at").report("missing, expected an x, 'left', 'right' or a name of the mesh")
        if isinstance(value["at"], str):
            return self._of(body, value["at"], place.key("at"), by_name=True)
        x = Real().read(value["at"], place.key("at"))
        return INVALID if isinstance(x, Invalid) else self._of(body, x, place.key("at"))

    @staticmethod
    def _of(body: Any, where: str | float, place: Place, by_name: bool = False) -> Any:
        if isinstance(body, Invalid):
            return body
        if not _has_axis(body):
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
        name = _NAME.write(value.body.name, book)
        if isinstance(value, TravellingPoint):
            return {"body": name, "path": write_inside(value.path, book)}
        if isinstance(value, Body):
            return name
        x = repr(float(value.x))
        mesh = getattr(value.body, "mesh", None)
        unclear = f"{name}@{x}" in book.bodies or (mesh is not None and x in mesh.points)
        return {"body": name, "at": float(value.x)} if unclear else f"{name}@{x}"

    def described(self) -> dict[str, Any]:
        """Return a text or a table."""
        return {"$ref": f"#/$defs/{'travelling_point' if self.travels else 'point'}", **super().described()}


#: A point that may travel.
TravellingEnd = Annotated[Point, AtPoint("``beam.at(x)``, a `Mass`, or ``beam.along(path)``.", travels=True)]

#: The ends of an effect on two points, or on a point and ground.
End = Annotated[Point, AtPoint()]
OtherEnd = Annotated[Point | None, AtPoint("``beam.at(x)`` or a `Mass`. Without it the effect acts on a and ground.")]

#: The coordinate on which an effect acts.
Of = Annotated[
    Literal["displacement", "rotation"],
    Choice(
        ("displacement", "rotation"), "Whether it acts on displacements (m, N) or on rotations of beams (rad, N m)."
    ),
]

#: The name of an effect.
Named = Annotated[str, Name()]

#: The name of an effect that needs none.
Called = Annotated[str | None, Label()]


@declared()
class Acting:
    """An effect whose parameters tell the points that it touches."""

    #: How pictures show it: a "force", "moment" or "weight", a "line" of forces, a "spring", "damper" or "mass".
    symbol: ClassVar[str] = ""

    name: Called = field(default=None, kw_only=True)

    def points(self) -> tuple[Point, ...]:
        """Return the points among its parameters, and one of each body; none where it acts on the whole system."""
        found: list[Any] = []
        for name, one in declarations(type(self)).items():
            if isinstance(one.kind, AtPoint):
                found.append(getattr(self, name))
            elif isinstance(one.kind, OnBody):
                body = getattr(self, name)
                found.append(body if isinstance(body, Point) else body.at("left"))
        return tuple(point for point in found if point is not None)
