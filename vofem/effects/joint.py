"""Joints: constraints that make points of two bodies move together."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated, Literal

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.effects.kinds import AtPoint, End, Named
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Choice, declared, label_of, rule


@declared()
class Joint:
    """Ties a point of one body to a point of another one.

    The tie is a condition on the degrees of freedom, not a stiff spring: one
    unknown is eliminated for each condition. The points may lie anywhere on
    the bodies, also between nodes. `Result.joint_force` returns the force that a
    joint transmits.

    Raises
    ------
    ArgumentError
        If the points lie on one body, or if one has no rotation and the joint
        is rigid. When the scene is compiled: if supports and other joints tie
        the points already.
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
