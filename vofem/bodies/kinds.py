"""Kinds of parameters that are quantities along a beam."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vofem._validate import one_of
from vofem.parameters import Choice, Count, Kind, Name, Numbers, OneOf, Real, Unwritable
from vofem.parameters.kinds import ANY_NUMBER, Either
from vofem.parameters.place import INVALID, Book, Invalid, Place
from vofem.polynomial import Polynomial

POLYNOMIAL = OneOf(classes={"polynomial": Polynomial}, expected="{ polynomial = [a0, a1, ...] }")


@dataclass(frozen=True)
class Along(Either):
    """A quantity along a beam: a number, or a callable of x. Scene files hold numbers and polynomials."""

    unit: str = ""
    text: str = ""
    limits: Real = ANY_NUMBER

    shown = "float or callable of an array x"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """A number or a polynomial."""
        return f"{self.limits.expected} or {POLYNOMIAL.expected}"

    @property
    def meaning(self) -> str:
        """What it means, its unit and its limits."""
        return Real(self.unit, self.text, self.limits.above, self.limits.least).meaning

    def check(self, what: str, value: Any) -> Any:
        """Return the callable or the number."""
        return value if callable(value) else self.limits.check(what, value)

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return both."""
        return self.limits, None, POLYNOMIAL


@dataclass(frozen=True)
class Section(Either):
    """EI or rhoA: a number, one per element, a callable of x, or numbers by subdomain of a mesh; positive.

    The beam checks it, because its elements must be known.
    """

    unit: str = ""
    text: str = ""

    shown = "float, callable of x, array_like of shape (n_elements,) or dict"
    expected = "a positive number, an array of one per element, { polynomial = [...] } or a table by subdomain"

    @property
    def meaning(self) -> str:
        """What it means, and its unit."""
        return Real(self.unit, self.text, above=0.0).meaning

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return what is no table by subdomain."""
        return Real(above=0.0), Numbers(each=Real(above=0.0)), POLYNOMIAL

    def read(self, value: Any, place: Place) -> Any:
        """Return what `Beam` takes."""
        table = isinstance(value, dict) and value and not any(isinstance(one, (list, dict)) for one in value.values())
        if not table:
            return super().read(value, place)
        parts = {name: Real(above=0.0).read(part, place.key(name)) for name, part in value.items()}
        return INVALID if any(isinstance(part, Invalid) for part in parts.values()) else parts

    def write(self, value: Any, book: Book) -> Any:
        """Return a number, an array, or a table."""
        if isinstance(value, Mapping):
            return {Name().write(name, book): float(part) for name, part in value.items()}
        if callable(value) and not isinstance(value, Polynomial):
            raise Unwritable(f"{value!r} is a callable, which a scene file cannot hold; use vofem.Polynomial")
        return super().write(value, book)

    def described(self) -> dict[str, Any]:
        """Return all forms."""
        known = super().described()
        by_subdomain = {"type": "object", "additionalProperties": Real(above=0.0).described()}
        return {**known, "anyOf": [*known["anyOf"], by_subdomain]}


@dataclass(frozen=True)
class Elements(Either):
    """The number of equal elements, the x of all nodes, or a mesh."""

    text: str = ""

    shown = "int or array_like"
    expected = "a whole number or an array of the x of all nodes"

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return both."""
        return Count(), Numbers(), None

    def read(self, value: Any, place: Place) -> Any:
        """Return an int or an array."""
        return place.expected(self.expected, value) if isinstance(value, float) else super().read(value, place)


@dataclass(frozen=True)
class Supports(Kind):
    """Kinds of supports by place; in scene files the places are names, or x in quotes."""

    kinds: tuple[str, ...] = ()
    text: str = ""

    shown = "dict"
    expected = "a table such as { left = 'clamped', '0.5' = 'pinned' }"

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
        return INVALID if bad else result

    def write(self, value: Mapping[str, str], book: Book) -> dict[str, str]:
        """Return the table."""
        return {Name().write(where, book): kind for where, kind in value.items()}

    def described(self) -> dict[str, Any]:
        """Return a table."""
        return {"type": "object", "additionalProperties": {"enum": list(self.kinds)}, **super().described()}
