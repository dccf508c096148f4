"""Checks of the arguments of contacts: the side of a stop that is fixed in space, and two points that differ."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np

from vofem._validate import missing, one_of
from vofem.bodies.base import Point
from vofem.errors import ArgumentError
from vofem.parameters import Choice

_SIDES = ("below", "above")

#: The side on which a stop stands.
Side = Annotated[
    Literal["below", "above"] | None,
    Choice(
        _SIDES,
        "The side on which a fixed stop stands. A stop below closes when ``eta < -gap``, and a stop above closes when "
        "``eta > gap``.",
    ),
]


def side_of(label: str, between: str, b: Any, side: Any) -> None:
    """Raise `ArgumentError` if a stop fixed in space has no side, or a contact between two points has one."""
    if b is not None:
        if side is not None:
            raise ArgumentError(f"{label}: side is {side!r}, but {between} between two points has none; remove it")
    elif side is None:
        raise missing(f"{label}: side", f"{one_of(_SIDES)} for a stop")


def distinct(label: str, a: Point, b: Point | None) -> None:
    """Raise `ArgumentError` if both points of a contact are the same point."""
    if b is not None and a.body is b.body and np.isclose(a.x, b.x, rtol=1e-12, atol=0.0):
        raise ArgumentError(f"{label}: a and b are the same point, {a.describe()}; a stop has no b")
