"""Joints: constraints that make points of two bodies move together."""

from __future__ import annotations

from vofem._validate import choice
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, as_point, automatic_name
from vofem.errors import ArgumentError


class Joint:
    """Ties a point of one body to a point of another one.

    The tie is a condition on the degrees of freedom, not a stiff spring: one
    unknown is eliminated for each condition. The points may lie anywhere on
    the bodies, also between nodes. `Result.joint_force` returns the force that a
    joint transmits.

    Parameters
    ----------
    a, b : points
        Points of two different bodies. A mass can be hinged to a beam.
    kind : "rigid" or "hinge"
        A hinge makes displacements equal. A rigid joint makes displacements and
        rotations equal, so that two beams joined at their ends behave as one beam.
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        If the points lie on one body, or if one has no rotation and the joint
        is rigid. When the scene is compiled: if supports and other joints tie
        the points already.
    """

    def __init__(self, a: Point, b: Point, *, kind: str, name: str | None = None) -> None:
        self.name = automatic_name(name, "Joint")
        label = f"Joint {self.name!r}"
        self.a: Point = as_point(f"{label}: a", a)
        self.b: Point = as_point(f"{label}: b", b)
        self.kind = choice(f"{label}: kind", kind, ("rigid", "hinge"))
        if self.a.body is self.b.body:
            raise ArgumentError(
                f"{label}: b is {self.b.describe()}, expected a point of another body than {self.a.body.label}; a "
                "point of one body is held by a support or a Spring"
            )
        if self.kind == "rigid":
            self.a.slope_row()
            self.b.slope_row()

    def points(self) -> tuple[Point, ...]:
        """Return a and b."""
        return self.a, self.b

    def compile(self, builder: SystemBuilder) -> None:
        """Add the condition of equal displacements, and of equal rotations where the joint is rigid."""
        rows = [builder.difference(self.a, self.b)]
        if self.kind == "rigid":
            rows.append(builder.difference(self.a, self.b, slope=True))
        builder.add_joint(self.name, rows)

    def describe(self) -> str:
        """Return name, kind and points."""
        return f"Joint {self.name!r} of {self.a.describe()} and {self.b.describe()}: {self.kind}"
