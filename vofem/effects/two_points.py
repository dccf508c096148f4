"""Effects on the relative displacement or the relative rotation of two points, or of a point and ground."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from vofem._validate import missing, one_of
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, Row
from vofem.bodies.path import TravellingPoint
from vofem.effects.kinds import AtPoint, End, Named, Of, OtherEnd
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Choice, declarations, declared, label_of, rule


@dataclass(frozen=True)
class Units:
    """Units of the coordinate u of an effect, and of its force, stiffness, damping and impulse."""

    #: `coordinate`, `force`, `stiffness`, `damping`: units of u, of the force that does work on it, of ``force/u`` and
    #: of ``force/u'``.
    coordinate: str
    force: str
    stiffness: str
    damping: str
    impulse: str  #: Unit of the integral of the force over time.


#: The units by the coordinate on which an effect acts.
UNITS = {
    "displacement": Units("m", "N", "N/m", "N s/m", "N s"),
    "rotation": Units("rad", "N m", "N m/rad", "N m s/rad", "N m s"),
}


@declared()
class TwoPoints:
    """An effect on ``u_a - u_b``, or on ``u_a`` if b is None, where u is a displacement or a rotation."""

    #: How pictures show it: as a "spring", a "damper", or a "stop".
    symbol: ClassVar[str] = "spring"

    a: End
    b: OtherEnd = None
    of: Of = field(default="displacement", kw_only=True)
    name: Named = field(default=CHOSEN, kw_only=True)

    @rule("b", "a")
    def _ends_differ(self) -> None:
        refuse_equal(self, self.a, self.b)

    @rule("a", "b", "of")
    def _ends_rotate(self) -> None:
        if self.of == "rotation":
            for point in self.points():
                point.slope_row()

    @property
    def units(self) -> Units:
        """The units of the coordinate on which the effect acts."""
        return UNITS[self.of]

    def points(self) -> tuple[Point, ...]:
        """Return a, and b where there is one."""
        return (self.a,) if self.b is None else (self.a, self.b)

    def _row(self, builder: SystemBuilder, sign: float = 1.0) -> Row:
        """Return the row of the coordinate, or of its negative where `sign` is -1; without a point that travels."""
        if isinstance(self.a, TravellingPoint):
            rest = Row(np.zeros(0, dtype=np.int64), np.zeros(0)) if self.b is None else builder.row(self.b)
            return Row(rest.indices, -rest.weights)
        row = builder.difference(self.a, self.b, slope=self.of == "rotation")
        return row if sign > 0.0 else Row(row.indices, -row.weights)

    def _where(self) -> str:
        """Return both ends for `describe`."""
        rotation = " in rotation" if self.of == "rotation" else ""
        return f"{self.a.describe()} to {'ground' if self.b is None else self.b.describe()}{rotation}"


def refuse_equal(effect: Any, a: Point, b: Point | None) -> None:
    """Raise `ArgumentError` if both ends of an effect are the same point, which nothing moves apart."""
    if b is None or a.body is not b.body or isinstance(a, TravellingPoint):
        return
    if np.isclose(a.x, b.x, rtol=1e-12, atol=0.0):
        names = " and ".join(name for name, one in declarations(type(effect)).items() if isinstance(one.kind, AtPoint))
        raise ArgumentError(
            f"{label_of(effect)}: {names} are the same point, {a.describe()}; give another point, or one alone for an "
            "effect between it and ground"
        )


def units_of(effects: Iterable[Any], label: str) -> Units:
    """Return the units of the effect with a label such as ``Contact 'stop'``; those of displacements if none has it."""
    for effect in effects:
        labels = (f"{cls.__name__} {getattr(effect, 'name', None)!r}" for cls in type(effect).__mro__)
        if hasattr(effect, "of") and label in labels:
            return UNITS[effect.of]
    return UNITS["displacement"]


_SIDES = ("below", "above")

#: The side on which a stop stands.
Side = Annotated[
    Literal["below", "above"] | None,
    Choice(
        _SIDES,
        "The side on which a fixed stop stands. A stop below closes when ``eta < -gap``, and a stop above closes when "
        "``eta > gap``.",
    ),
]


class Stop(TwoPoints):
    """A stop behind a gap; each class of stops declares gap and side among its own parameters."""

    symbol = "stop"

    gap: float
    side: Side

    @rule("side", "b")
    def _side_of_a_stop(self) -> None:
        if self.b is None and self.side is None:
            raise missing(f"{label_of(self)}: side", f"{one_of(_SIDES)} for a stop")
        if self.b is not None and self.side is not None:
            raise ArgumentError(
                f"{label_of(self)}: side is {self.side!r}, but a contact between two points has none; remove it"
            )

    def _place(self) -> str:
        """Return place and gap for `describe`."""
        where = f"{self.side} {self.a.describe()}"
        if self.b is not None:
            where = f"of {self.a.describe()} below {self.b.describe()}"
        rotation = " in rotation" if self.of == "rotation" else ""
        return f"{where}{rotation}: gap {self.gap:g} {self.units.coordinate}"
