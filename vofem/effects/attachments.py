"""Linear attachments: springs, rotational springs, dashpots and point masses. Each adds a rank-one term to a matrix."""

from __future__ import annotations

from vofem._validate import number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, as_point
from vofem.effects.two_points import TwoPoints


class Spring(TwoPoints):
    """A linear spring between two points, or from a point to ground.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    stiffness : float
        Stiffness, N/m, not negative; N m/rad where the spring acts on rotations.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    """

    def __init__(self, a: Point, b: Point | None = None, *, stiffness: float, of: str = "displacement") -> None:
        self._attach("Spring", a, b, of)
        self.stiffness = number("Spring: stiffness", stiffness, minimum=0)

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``k b b'`` to K."""
        builder.add_stiffness(self._row(builder), self.stiffness)

    def describe(self) -> str:
        """Return points and stiffness."""
        return f"Spring from {self._where()}: {self.stiffness:g} {self.units.stiffness}"


class Dashpot(TwoPoints):
    """A linear dashpot between two points, or from a point to ground.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    damping : float
        Damping constant in N s/m, or in N m s/rad if the dashpot acts on rotations; not negative.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    """

    def __init__(self, a: Point, b: Point | None = None, *, damping: float, of: str = "displacement") -> None:
        self._attach("Dashpot", a, b, of)
        self.damping = number("Dashpot: damping", damping, minimum=0)

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``c b b'`` to C."""
        builder.add_damping(self._row(builder), self.damping)

    def describe(self) -> str:
        """Return points and damping."""
        return f"Dashpot from {self._where()}: {self.damping:g} {self.units.damping}"


class RotationalSpring:
    """A linear spring on the slope of a beam, to ground or to the slope at another point.

    It is a `Spring` with ``of="rotation"``.

    Parameters
    ----------
    point : point of a beam
        ``beam.at(x)``.
    other : point of a beam, optional
        With it the spring acts on the difference of both slopes, otherwise on the slope at `point`.
    stiffness : float
        Stiffness, N m/rad, not negative.
    """

    def __init__(self, point: Point, other: Point | None = None, *, stiffness: float) -> None:
        self.point = as_point("RotationalSpring: point", point)
        self.other: Point | None = None if other is None else as_point("RotationalSpring: other", other)
        self.stiffness = number("RotationalSpring: stiffness", stiffness, minimum=0)
        for end in self.points():
            end.slope_row()

    def points(self) -> tuple[Point, ...]:
        """Return the point, and the other where there is one."""
        return (self.point,) if self.other is None else (self.point, self.other)

    def compile(self, builder: SystemBuilder) -> None:
        """Add ``k b b'`` to K, b being the row of the slope or of the difference of slopes."""
        builder.add_stiffness(builder.difference(self.point, self.other, slope=True), self.stiffness)

    def describe(self) -> str:
        """Return point and stiffness."""
        end = "" if self.other is None else f" to {self.other.describe()}"
        return f"RotationalSpring on {self.point.describe()}{end}: {self.stiffness:g} N m/rad"


class PointMass:
    """A mass, with or without rotary inertia, fixed to a point.

    Parameters
    ----------
    point : point
        ``beam.at(x)`` or a `Mass`.
    mass : float
        Mass, kg, not negative.
    inertia : float
        Rotary inertia in kg m^2, not negative. Only points of beams can have one.
    """

    def __init__(self, point: Point, *, mass: float, inertia: float = 0.0) -> None:
        self.point = as_point("PointMass: point", point)
        self.mass = number("PointMass: mass", mass, minimum=0)
        self.inertia = number("PointMass: inertia", inertia, minimum=0)
        if self.inertia:
            self.point.slope_row()

    def points(self) -> tuple[Point, ...]:
        """Return the point."""
        return (self.point,)

    def compile(self, builder: SystemBuilder) -> None:
        """Add the mass, and the rotary inertia where there is one, to M."""
        builder.add_mass(builder.row(self.point), self.mass)
        if self.inertia:
            builder.add_mass(builder.row(self.point, slope=True), self.inertia)

    def describe(self) -> str:
        """Return point and mass."""
        inertia = f", {self.inertia:g} kg m^2" if self.inertia else ""
        return f"PointMass on {self.point.describe()}: {self.mass:g} kg{inertia}"
