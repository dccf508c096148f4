"""A lumped mass: one degree of freedom, tied to ground by a spring and a dashpot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from vofem._validate import TINY, number, wrong
from vofem.bodies.base import Array, Body, BodyMatrices, DegreesOfFreedom, IntArray, Point, Row, Shape
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Name, Real, declared
from vofem.parameters.place import Invalid, Place

#: All masses have these, and there may be very many of them.
_FREEDOM = DegreesOfFreedom(np.full(1, np.nan), np.zeros(1, dtype=bool))
_BLOCK = Shape("block", np.zeros(1), np.ones((1, 1)))


@dataclass(frozen=True)
class MassOf(Real):
    """A positive mass; the message on a massless body says what to do in its place."""

    def check(self, what: str, value: Any) -> float:
        """Return a float."""
        mass = number(what, value, minimum=0)
        if mass < TINY:
            raise wrong(
                what, repr(mass), f"a positive number of at least {TINY:g}", ". What is massless has no motion of its "
                "own: join what it connects by one Spring (two in series have the stiffness k1 k2/(k1 + k2)), or give "
                "it a small mass; a ratio of 1e-12 does no harm except to explicit methods, whose critical step it "
                "shortens",
            )  # fmt: skip
        return mass

    def read(self, value: Any, place: Place) -> float | Invalid:
        """Return a float; in a file the number alone is at fault."""
        return Real(above=0.0).read(value, place)


@declared()
class Mass(Body, Point):
    """A mass on a spring and a dashpot to ground: ``m u'' + c u' + k u = f``.

    It is a body with one degree of freedom. Where a point is asked for, the mass itself is given.

    Raises
    ------
    ArgumentError
        For a value that is not finite, or a negative one.
    """

    mass: Annotated[float, MassOf("kg", "Mass.", above=0.0)]
    stiffness: Annotated[
        float, Real("N/m", "Stiffness of the spring to ground. With 0 there is no spring.", least=0)
    ] = 0.0
    damping: Annotated[
        float, Real("N s/m", "Damping of the dashpot to ground. With 0 there is no dashpot.", least=0)
    ] = 0.0
    name: Annotated[str, Name("Unique in a scene. In Python, a name is chosen if none is given.", needed=True)] = CHOSEN

    def __repr__(self) -> str:
        return f"Mass(mass={self.mass:g}, stiffness={self.stiffness:g}, damping={self.damping:g}, name={self.name!r})"

    #: As a point, a mass lies at x = 0 of itself.
    x = 0.0

    #: One displacement, which has no place along an axis, of a block that moves upward.
    size, degrees_of_freedom, shape = 1, _FREEDOM, _BLOCK

    @property
    def body(self) -> Mass:
        """The mass itself: it is its own point."""
        return self

    def supported_at(self, where: Any) -> IntArray:
        """Raise an error, because a mass has no supports."""
        raise ArgumentError(f"{self.label} has no supports; it rests on its spring and on effects")

    def matrices(self) -> BodyMatrices:
        """Return the 1 x 1 matrices."""
        return BodyMatrices(
            mass=np.array([[self.mass]]),
            stiffness=np.array([[self.stiffness]]),
            damping=np.array([[self.damping]]) if self.damping else None,
            supported=np.empty(0, dtype=np.int64),
            scale=np.ones(1),
        )

    def row_at(self, x: float, derivative: int = 0) -> Row:
        """Return the row of its displacement."""
        if derivative:
            raise ArgumentError(f"{self.label} has no slope; moments and rotational springs need a beam")
        return Row(np.zeros(1, dtype=np.int64), np.ones(1))

    def strain_rows(self) -> Array:
        """Return the root of the stiffness."""
        return np.array([[np.sqrt(self.stiffness)]])

    def rigid_motions(self) -> Array:
        """Return the translation, or nothing where a spring ties the mass to ground."""
        return np.ones((1, 0 if self.stiffness else 1))

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the number given, as an array of one."""
        if callable(field):
            raise ArgumentError(f"{what} of Mass {self.name!r} is a callable, expected a number")
        return np.array([number(f"{what} of Mass {self.name!r}", field)])

    def describe(self) -> str:
        """Return its name, as a point."""
        return self.label

    def summary(self) -> str:
        """Return its name, mass, spring and dashpot."""
        ground = [f"{value:g} {unit}" for value, unit in ((self.stiffness, "N/m"), (self.damping, "N s/m")) if value]
        return f"{self.label}: {self.mass:g} kg, {' and '.join(ground) + ' to ground' if ground else 'free'}"
