"""Linear attachments: springs, rotational springs, dashpots and point masses. Each adds a rank-one term to a matrix."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.bodies.path import TravellingPoint
from vofem.effects.kinds import Acting, AtPoint, Called, TravellingEnd
from vofem.effects.two_points import TwoPoints, refuse_equal
from vofem.errors import ArgumentError
from vofem.parameters import Real, declared, label_of, rule


@declared()
class Spring(TwoPoints):
    """A linear spring between two points, or from a point to ground. The first point may travel."""

    a: TravellingEnd
    _: KW_ONLY
    stiffness: Annotated[float, Real("N/m, or N m/rad where it acts on rotations", "Stiffness.", least=0)]
    name: Called = None

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``k b b'`` to K."""
        if isinstance(self.a, TravellingPoint):
            name = self.name or self.describe()
            builder.add_travelling_law(self._row(builder), self.a, "Spring", name, self.stiffness, 0.0)
        else:
            builder.add_stiffness(self._row(builder), self.stiffness)

    def describe(self) -> str:
        """Return points and stiffness."""
        return f"Spring from {self._where()}: {self.stiffness:g} {self.units.stiffness}"


@declared()
class Dashpot(TwoPoints):
    """A linear dashpot between two points, or from a point to ground. The first point may travel."""

    symbol = "damper"

    a: TravellingEnd
    _: KW_ONLY
    damping: Annotated[float, Real("N s/m, or N m s/rad where it acts on rotations", "Damping constant.", least=0)]
    name: Called = None

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``c b b'`` to C."""
        if isinstance(self.a, TravellingPoint):
            name = self.name or self.describe()
            builder.add_travelling_law(self._row(builder), self.a, "Dashpot", name, 0.0, self.damping)
        else:
            builder.add_damping(self._row(builder), self.damping)

    def describe(self) -> str:
        """Return points and damping."""
        return f"Dashpot from {self._where()}: {self.damping:g} {self.units.damping}"


@declared()
class RotationalSpring(Acting):
    """A linear spring on the slope of a beam, to ground or to the slope at another point.

    It is a `Spring` with ``of="rotation"``.
    """

    point: Annotated[Point, AtPoint("Point of a beam, ``beam.at(x)``.")]
    other: Annotated[
        Point | None,
        AtPoint("With it the spring acts on the difference of both slopes, otherwise on the slope at `point`."),
    ] = None
    _: KW_ONLY
    stiffness: Annotated[float, Real("N m/rad", "Stiffness.", least=0)]
    name: Called = None

    @rule("other", "point")
    def _points_differ(self) -> None:
        refuse_equal(self, self.point, self.other)

    @rule("point", "other")
    def _points_rotate(self) -> None:
        for end in self.points():
            end.slope_row()

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``k b b'`` to K, b being the row of the slope or of the difference of slopes."""
        builder.add_stiffness(builder.difference(self.point, self.other, slope=True), self.stiffness)

    def describe(self) -> str:
        """Return point and stiffness."""
        end = "" if self.other is None else f" to {self.other.describe()}"
        return f"RotationalSpring on {self.point.describe()}{end}: {self.stiffness:g} N m/rad"


@declared()
class PointMass(Acting):
    """A mass, with or without rotary inertia, fixed to a point.

    The point may travel: the mass is then tied to the beam below it, and rests at the level of the supports where it is
    not on the beam.
    """

    point: TravellingEnd
    _: KW_ONLY
    mass: Annotated[float, Real("kg", "Mass.", least=0)]
    inertia: Annotated[float, Real("kg m^2", "Rotary inertia. Only points of beams can have one.", least=0)] = 0.0
    name: Called = None

    @rule("inertia", "point")
    def _point_rotates(self) -> None:
        if self.inertia and isinstance(self.point, TravellingPoint):
            raise ArgumentError(f"{label_of(self)}: inertia is {self.inertia:g} kg m^2, but what travels has none")
        if self.inertia:
            self.point.slope_row()

    def compile(self, builder: SystemBuilder) -> None:
        """Add the mass, and the rotary inertia where there is one, to M."""
        if isinstance(self.point, TravellingPoint):
            builder.add_tied_mass(self.point, self.mass, "PointMass", self.name or self.describe())
            return
        builder.add_mass(builder.row(self.point), self.mass)
        if self.inertia:
            builder.add_mass(builder.row(self.point, slope=True), self.inertia)

    def describe(self) -> str:
        """Return point and mass."""
        inertia = f", {self.inertia:g} kg m^2" if self.inertia else ""
        return f"PointMass on {self.point.describe()}: {self.mass:g} kg{inertia}"
