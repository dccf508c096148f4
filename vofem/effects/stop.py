"""What all stops share: the side on which one stands that is fixed in space."""

from __future__ import annotations

from typing import Annotated, Literal

from vofem._validate import missing, one_of
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.parameters import Choice, label_of, rule

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
