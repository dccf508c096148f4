"""Motion of the base that a body stands on."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

from vofem.assembly import Base, SystemBuilder
from vofem.bodies.base import Body
from vofem.effects.kinds import Acting, Called, OnBody
from vofem.parameters import Real, declared
from vofem.time_functions import Load, OfTime, as_time_function


@declared()
class BaseMotion(Acting):
    """A body whose base accelerates: its supports, its springs to ground and the stops beside it.

    Displacements of the body are then counted from the base. The motion acts
    as a load ``-M r a(t)``, where r is the unit translation. A spring or a joint
    between two bodies is refused unless both stand on bases with the same
    acceleration. A contact between them needs the displacements of both bases,
    and so does a stop that stays in space (``Contact(..., frame="space")``).
    """

    body: Annotated[Body, OnBody("The body that stands on the base.")]
    acceleration: Annotated[Load, OfTime("m/s^2", "Acceleration of the base, positive upward.")]
    _: KW_ONLY
    displacement: Annotated[
        float | None,
        Real("m", "Displacement of the base at t = 0, positive upward. What sees the base's place needs it."),
    ] = None
    velocity: Annotated[
        float | None,
        Real("m/s", "Velocity of the base at t = 0, positive upward. What sees the base's place needs it."),
    ] = None
    name: Called = None

    @property
    def base(self) -> Base:
        """The motion as contacts see it."""
        function = as_time_function(self.acceleration)
        return Base(self.body, function, self.displacement, self.velocity, self.describe())

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_acceleration(-1.0, as_time_function(self.acceleration), self.describe(), self.body)
        builder.add_base(self.base)

    def describe(self) -> str:
        """Return body and acceleration."""
        return f"BaseMotion of {self.body.label}: {self.acceleration!r} m/s^2"
