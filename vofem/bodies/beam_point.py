"""Points on the axis of a beam."""

from __future__ import annotations

from vofem.bodies.base import BodyPoint, Row


class BeamPoint(BodyPoint):
    """A point on a beam's axis; made by `Beam.at`."""

    def row(self) -> Row:
        """Return the row of eta: one entry at a node, four between nodes."""
        row: Row = self.body.row_at(self.x)
        return row

    def slope_row(self) -> Row:
        """Return the row of the slope."""
        row: Row = self.body.row_at(self.x, 1)
        return row
