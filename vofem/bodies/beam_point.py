"""Points on the axis of a beam."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vofem.bodies.base import Row

if TYPE_CHECKING:
    from vofem.bodies.beam import Beam


class BeamPoint:
    """A point on a beam's axis; made by `Beam.at`.

    Attributes
    ----------
    body : Beam
    x : float
        In m.
    """

    def __init__(self, body: Beam, x: float) -> None:
        self.body = body
        self.x = x

    @property
    def name(self) -> str:
        """Beam and place as scene files name them, such as ``beam@1.0``."""
        return f"{self.body.name}@{float(self.x)!r}"

    def row(self) -> Row:
        """Return the row of eta: one entry at a node, four between nodes."""
        return self.body.row_at(self.x)

    def slope_row(self) -> Row:
        """Return the row of the slope."""
        return self.body.row_at(self.x, 1)

    def __repr__(self) -> str:
        return f"{self.body!r}.at({self.x:g})"

    def describe(self) -> str:
        """Return beam and place."""
        return f"{self.body.label} at x = {self.x:g} m"
