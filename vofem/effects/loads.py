"""Loads: at points, along beams, gravity, and the motion of the base that a body stands on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import Base, SystemBuilder
from vofem.bodies.base import Body, Point
from vofem.bodies.beam import Beam
from vofem.bodies.coefficient import evaluate_along
from vofem.bodies.kinds import Along
from vofem.bodies.path import TravellingPoint
from vofem.effects.kinds import Acting, AtPoint, OnBody, TravellingEnd
from vofem.errors import ArgumentError
from vofem.parameters import Real, declared, rule
from vofem.time_functions import Constant, Load, OfTime, TimeFunction, as_time_function


@declared()
class PointLoad(Acting):
    """A force at a point, positive upward. The point may travel (``beam.along(path)``); a train is a list of loads."""

    symbol = "force"

    point: TravellingEnd
    f: Annotated[Load, OfTime("N", "The force.")]

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        if isinstance(self.point, TravellingPoint):
            builder.add_travelling_load(self.point, as_time_function(self.f), self.describe())
        else:
            builder.add_point_load(builder.row(self.point), as_time_function(self.f), self.describe())

    def describe(self) -> str:
        """Return point and function."""
        return f"PointLoad on {self.point.describe()}: {self.f!r} N"


@declared()
class PointMoment(Acting):
    """A moment at a point of a beam. A positive moment does positive work when the slope grows."""

    symbol = "moment"

    point: Annotated[Point, AtPoint("Point of a beam, ``beam.at(x)``.")]
    f: Annotated[Load, OfTime("N m", "The moment.")]

    @rule("point")
    def _point_rotates(self) -> None:
        self.point.slope_row()

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_point_load(builder.row(self.point, slope=True), as_time_function(self.f), self.describe())

    def describe(self) -> str:
        """Return point and function."""
        return f"PointMoment on {self.point.describe()}: {self.f!r} N m"


@dataclass(frozen=True)
class LoadAlong(Along):
    """A load along a beam, which is no function of time."""

    def check(self, what: str, value: Any) -> Any:
        """Return the number or the callable."""
        if isinstance(value, TimeFunction):
            raise ArgumentError(
                f"{what} is {value!r}, a function of time; give it as f=, and p as a number or a function of x"
            )
        return super().check(what, value)


@declared()
class DistributedLoad(Acting):
    """A force per length on a beam, ``p(x) f(t)``, positive upward."""

    symbol = "line"

    beam: Annotated[Beam, OnBody("The beam on which the load acts.", beam=True)]
    p: Annotated[float | Callable[[Any], Any], LoadAlong("N/m", "The load along the beam.")]
    f: Annotated[Load, OfTime("", "A factor over time, without unit.")] = 1.0

    def compile(self, builder: SystemBuilder) -> None:
        """Add the consistent load vector."""
        builder.add_body_load(self.beam, self.beam.load_vector(self.p), as_time_function(self.f), self.describe())

    def along(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return p in N/m at points x, shape (k,)."""
        return evaluate_along(f"a distributed load on {self.beam.label}", self.p, x)

    def describe(self) -> str:
        """Return beam and functions."""
        p = "p(x)" if callable(self.p) else f"{self.p:g} N/m"
        return f"DistributedLoad on Beam {self.beam.name!r}: {p} times {self.f!r}"


@declared()
class Gravity(Acting):
    """The weight of everything that has mass, point masses included, acting downward from t = 0 on.

    A scene that starts undeformed is dropped into its own weight: it swings to twice the deflection of the equilibrium.
    ``initial=vofem.equilibrium(scene)`` starts it in equilibrium.
    """

    symbol = "weight"

    g: Annotated[float, Real("m/s^2", "Acceleration, positive downward.")] = 9.81

    def compile(self, builder: SystemBuilder) -> None:
        """Add a constant load in proportion to mass."""
        builder.add_acceleration(-self.g, Constant(1.0), self.describe())

    def describe(self) -> str:
        """Return g and its direction."""
        return f"Gravity: {abs(self.g):g} m/s^2 {'upward' if self.g < 0.0 else 'downward'}"


@declared()
class BaseMotion(Acting):
    """A body whose base accelerates: its supports, its springs to ground and the stops beside it.

    Displacements of the body are then counted from the base. The motion acts as a load ``-M r a(t)``, where r is the
    unit translation. A body has one base, so a second motion of it is refused; add the functions instead. A spring or a
    joint between two bodies is refused unless both stand on bases with the same acceleration. A contact between them
    needs the displacements of both bases, and so does a stop that stays in space (``Contact(..., frame="space")``).
    In a run with ``t_start``, t = 0 is that of `acceleration`, and not the begin of the run.
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

    @property
    def base(self) -> Base:
        """The motion as contacts see it."""
        function = as_time_function(self.acceleration)
        return Base(self.body, function, self.displacement, self.velocity, self.describe())

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_acceleration(-1.0, as_time_function(self.acceleration), self.describe(), self.body)

    def describe(self) -> str:
        """Return body and acceleration."""
        return f"BaseMotion of {self.body.label}: {self.acceleration!r} m/s^2"
