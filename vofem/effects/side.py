"""Checks of the arguments of contacts: the side of a stop that is fixed in space, and two points that differ."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem._validate import choice, one_of
from vofem.bodies.base import Point, place_of
from vofem.errors import ArgumentError

_SIDES = ("below", "above")


def side_of(label: str, between: str, b: Any, side: Any) -> str | None:
    """Return the side of a stop fixed in space, or None where there is a second point b.

    Raises
    ------
    ArgumentError
        If the side is missing, is wrong, or is given for a contact between two points. `between` names the kind of
        contact in the message.
    """
    if b is not None:
        if side is not None:
            raise ArgumentError(f"{label}: side is {side!r}, but {between} between two points has none; remove it")
        return None
    if side is None:
        raise ArgumentError(f"{label}: side is missing, expected {one_of(_SIDES)} for a stop")
    return choice(f"{label}: side", side, _SIDES)


def distinct(label: str, a: Point, b: Point | None) -> None:
    """Raise `ArgumentError` if both points of a contact are the same point."""
    if b is not None and a.body is b.body and np.isclose(place_of(a), place_of(b), rtol=1e-12, atol=0.0):
        raise ArgumentError(f"{label}: a and b are the same point, {a.describe()}; a stop has no b")
