"""What changes matrices: springs, dashpots and point masses, each a rank-one term; damping of all; and joints."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.bodies.path import TravellingPoint
from vofem.effects.kinds import Acting, AtPoint, Called, End, Named, TravellingEnd
from vofem.effects.two_points import TwoPoints, refuse_equal
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Choice, Real, RealOrArray, declared, label_of, rule


@declared()
class Spring(TwoPoints):
    """A linear spring between two points, or from a point to ground. The first point may travel."""

    a: TravellingEnd
    _: KW_ONLY
    stiffness: Annotated[float, Real("N/m, or N m/rad where it acts on rotations", "Stiffness.", least=0)]
    name: Called = None  # type: ignore[assignment]

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
    name: Called = None  # type: ignore[assignment]

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

    symbol = "spring"
    of: ClassVar = "rotation"

    point: Annotated[Point, AtPoint("Point of a beam, ``beam.at(x)``.")]
    other: Annotated[
        Point | None,
        AtPoint("With it the spring acts on the difference of both slopes, otherwise on the slope at `point`."),
    ] = None
    _: KW_ONLY
    stiffness: Annotated[float, Real("N m/rad", "Stiffness.", least=0)]

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
    not on the beam. It may therefore come onto the beam, and leave it, at supports only; runs refuse others.
    """

    symbol = "mass"

    point: TravellingEnd
    _: KW_ONLY
    mass: Annotated[float, Real("kg", "Mass.", least=0)]
    inertia: Annotated[float, Real("kg m^2", "Rotary inertia. Only points of beams can have one.", least=0)] = 0.0

    @rule("inertia", "point")
    def _point_is_taken(self) -> None:
        if self.inertia and isinstance(self.point, TravellingPoint):
            raise ArgumentError(f"{label_of(self)}: inertia is {self.inertia:g} kg m^2, but what travels has none")
        if isinstance(self.point, TravellingPoint) and self.point.path.profile is not None:
            raise ArgumentError(
                f"{label_of(self)}: the path of its point has a profile, expected none, because the mass is tied to "
                "the beam and not to a road on it; leave out the profile, or let a Mass roll on a Contact that travels"
            )
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


@declared()
class Joint(Acting):
    """Ties a point of one body to a point of another one.

    The tie is a condition on the degrees of freedom, not a stiff spring: one unknown is eliminated for each condition.
    The points may lie anywhere on the bodies, also between nodes. `Result.joint_force` returns the force that a joint
    transmits.

    Raises
    ------
    ArgumentError
        If the points lie on one body, or if one has no rotation and the joint is rigid. When the scene is compiled: if
        supports and other joints tie the points already.
    """

    a: End
    b: Annotated[Point, AtPoint("A point of another body. A mass can be hinged to a beam.")]
    _: KW_ONLY
    kind: Annotated[
        Literal["rigid", "hinge"],
        Choice(
            ("rigid", "hinge"),
            "A hinge makes displacements equal. A rigid joint makes displacements and rotations equal, so that two "
            "beams joined at their ends behave as one beam.",
        ),
    ]
    name: Named = CHOSEN

    @rule("b", "a")
    def _two_bodies(self) -> None:
        if self.a.body is self.b.body:
            raise ArgumentError(
                f"{label_of(self)}: b is {self.b.describe()}, expected a point of another body than "
                f"{self.a.body.label}; a point of one body is held by a support or a Spring"
            )

    @rule("kind", "a", "b")
    def _rotations(self) -> None:
        if self.kind == "rigid":
            self.a.slope_row()
            self.b.slope_row()

    def compile(self, builder: SystemBuilder) -> None:
        """Add the condition of equal displacements, and of equal rotations where the joint is rigid."""
        rows = [builder.difference(self.a, self.b)]
        if self.kind == "rigid":
            rows.append(builder.difference(self.a, self.b, slope=True))
        builder.add_joint(self.name, rows)

    def describe(self) -> str:
        """Return name, kind and points."""
        return f"Joint {self.name!r} of {self.a.describe()} and {self.b.describe()}: {self.kind}"


@declared()
class RayleighDamping(Acting):
    """Rayleigh damping ``C = alpha M + beta K``. M and K include linear attachments, and no contacts."""

    alpha: Annotated[float, Real("1/s", "Factor of the mass matrix.", least=0)]
    beta: Annotated[float, Real("s", "Factor of the stiffness matrix.", least=0)] = 0.0

    def compile(self, builder: SystemBuilder) -> None:
        """Add to C."""
        builder.add_rayleigh(self.alpha, self.beta)

    def describe(self) -> str:
        """Return alpha and beta."""
        return f"RayleighDamping: alpha = {self.alpha:g} 1/s, beta = {self.beta:g} s"


@declared()
class ModalDamping(Acting):
    """Ratios of critical damping in the vibration modes of the structure with all contacts open.

    Raises
    ------
    ArgumentError
        For a ratio that is negative or not finite, or an empty list.
    """

    ratio: Annotated[
        float | NDArray[np.float64],
        RealOrArray(
            Real(least=0),
            "Damping ratio, not negative; 1 is critical damping. A number holds for every vibration mode. A list gives "
            "one ratio for each mode in ascending order of frequency. Modes beyond the end of the list take its last "
            "ratio. Rigid motions are not counted and stay undamped. Modes of equal frequency should have equal "
            "ratios, because their order is arbitrary.",
        ),
    ]

    def compile(self, builder: SystemBuilder) -> None:
        """Declare the ratio."""
        builder.add_modal_damping(self.ratio)

    def describe(self) -> str:
        """Return the ratio or ratios."""
        if np.ndim(self.ratio) == 0:
            return f"ModalDamping: {self.ratio:g} of critical"
        ratios = np.atleast_1d(self.ratio)
        first = ", ".join(f"{ratio:g}" for ratio in ratios[:5])
        rest = f" and {ratios.size - 5} more" if ratios.size > 5 else ""
        return f"ModalDamping: {first}{rest} of critical in modes 1 to {ratios.size}, {ratios[-1]:g} above"
