"""Motion of the base that a body stands on."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Body, Point
from vofem.effects.kinds import Called, OnBody
from vofem.parameters import declared
from vofem.time_functions import Load, OfTime, as_time_function


@declared()
class BaseMotion:
    """A body whose base accelerates: its supports, its springs to ground and the stops beside it.

    Displacements of the body are then counted from the base. The motion acts
    as a load ``-M r a(t)``, where r is the unit translation. A contact or a
    spring between two bodies is refused unless both stand on bases with the
    same acceleration.
    """

    body: Annotated[Body, OnBody("The body that stands on the base.")]
    acceleration: Annotated[Load, OfTime("m/s^2", "Acceleration of the base, positive upward.")]
    _: KW_ONLY
    name: Called = None

    def points(self) -> tuple[Point, ...]:
        """Return a point of the body, so that the scene can check it."""
        return (self.body.at("left") if hasattr(self.body, "at") else self.body,)  # type: ignore[return-value]

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_acceleration(-1.0, as_time_function(self.acceleration), self.describe(), self.body)

    def describe(self) -> str:
        """Return body and acceleration."""
        return f"BaseMotion of {self.body.label}: {self.acceleration!r} m/s^2"
