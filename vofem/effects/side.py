"""The side on which a stop fixed in space stands, and the two points of one that is not."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem._validate import choice, one_of
from vofem.bodies.base import Point
from vofem.errors import ArgumentError

_SIDES = ("below", "above")


def side_of(label: str, between: str, b: Any, side: Any) -> str | None:
    """Return the side of a stop fixed in space, or None where there is a second point b.

    Raises
    ------
    ArgumentError
        For a side that is missing, wrong, or has no meaning between two points; `between` names what stands there.
    """
    if b is not None:
        if side is not None:
            raise ArgumentError(f"{label}: side is {side!r}, but {between} between two points has none; remove it")
        return None
    if side is None:
        raise ArgumentError(f"{label}: side is missing, expected {one_of(_SIDES)} for a stop")
    return choice(f"{label}: side", side, _SIDES)


def distinct(label: str, a: Point, b: Point | None) -> None:
    """Raise `ArgumentError` where the points of a contact are one point."""
    if (
        b is not None
        and a.body is b.body
        and np.isclose(getattr(a, "x", 0.0), getattr(b, "x", 0.0), rtol=1e-12, atol=0.0)
    ):
        raise ArgumentError(f"{label}: a and b are the same point, {a.describe()}; a stop has no b")
