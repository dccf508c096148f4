"""Contact: a stiffness K_eq that switches with the sign of a gap function, and stops that are rigid."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, Literal

import numpy as np

from vofem._validate import wrong
from vofem.assembly import ContactEntry, SystemBuilder
from vofem.bodies.base import Body, Point
from vofem.bodies.path import TravellingPoint
from vofem.effects.kinds import AtPoint, End, TravellingEnd
from vofem.effects.two_points import Side, Stop
from vofem.errors import ArgumentError
from vofem.parameters import Choice, Kind, OneOf, Real, declared, label_of, rule
from vofem.parameters.place import Book, Place


@declared()
class Resolved:
    """The variable-order switch at a finite scaling factor s0 (Eq. 5), with the time in Eq. 4 set to 1 s.

    The contact stiffness grows over a finite penetration instead of jumping. For ``s > 0`` it is
    ``K0 / Gamma(1 - beta)`` with ``beta = exp(-s0 s)``; for ``s <= 0`` it is exactly 0.
    """

    s0: Annotated[float, Real("1/m", "Scaling factor; `vofem.fractional.scaling_factor` computes one.", above=0.0)]

    def __repr__(self) -> str:
        return f"Resolved(s0={self.s0:g})"


@dataclass(frozen=True)
class Switch(Kind):
    """The switch of a contact: 'ideal', or { resolved = { s0 = ... } }."""

    text: str = (
        '"ideal" switches the stiffness at once (Eq. 8). `Resolved` is the operator at a finite scaling factor s0.'
    )

    shown = '"ideal" or Resolved'
    expected = "'ideal' or { resolved = { s0 = 1000.0 } }"

    def check(self, what: str, value: Any) -> Any:
        """Return the switch."""
        if not (isinstance(value, Resolved) or (isinstance(value, str) and value == "ideal")):
            raise ArgumentError(f"{what} is {value!r}, expected 'ideal' or vofem.Resolved(s0)")
        return value

    def read(self, value: Any, place: Place) -> Any:
        """Return the text or the object."""
        if value == "ideal":
            return value
        if not isinstance(value, dict) or set(value) != {"resolved"}:
            return place.expected(self.expected, value)
        return _RESOLVED.read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return the text or the table."""
        return value if value == "ideal" else _RESOLVED.write(value, book)

    def described(self) -> dict[str, Any]:
        """Return both."""
        return {"anyOf": [{"const": "ideal"}, _RESOLVED.described()], **super().described()}


_RESOLVED = OneOf(classes={"resolved": Resolved})


@declared()
class Contact(Stop):
    """A contact between two points, or between a point and a stop that is fixed in space.

    Let eta be the displacement of point a, positive upward. The gap function is ``s = u_a - u_b - gap`` between two
    points, ``s = -eta - gap`` for a stop below, and ``s = eta - gap`` for a stop above. Where the base of a body moves,
    eta is counted from the base, or from space for a stop with ``frame="space"``. The contact is closed while
    ``s > 0``, and s is then the penetration. A closed contact pushes the bodies apart (Eqs. 8-13 and 15-18 of the
    paper). A contact with a damper opens at zero penetration and not at zero force; its force can therefore be negative
    shortly before it opens.

    Raises
    ------
    ArgumentError
        If `side` is missing, or is given for a contact between two points; if `acts_on` is missing; or if a value is
        out of range.
    """

    a: TravellingEnd
    b: Annotated[
        Point | None,
        AtPoint(
            "``beam.at(x)`` or a `Mass`. With b, a is the lower point: the contact closes when a has risen relative to "
            "b by more than the gap. Without b the contact is a stop that is fixed in space."
        ),
    ] = None
    _: KW_ONLY
    gap: Annotated[float, Real("m", 'The gap. A negative gap is a preload; it needs ``acts_on="penetration"``.')]
    stiffness: Annotated[float, Real("N/m", "Contact stiffness K0.", above=0.0)]
    damping: Annotated[
        float, Real("N s/m", "Damping constant C0. The damper acts only while the contact is closed.", least=0)
    ] = 0.0
    side: Side = None
    acts_on: Annotated[
        Literal["displacement", "penetration"] | None,
        Choice(
            ("displacement", "penetration"),
            '"penetration" is an elastic stop behind a gap: the force is K0 times ``s``. "displacement" is the '
            "paper's law: the force is K0 times the whole displacement and jumps by ``K0 gap`` when the contact "
            "closes. There is no default.",
            "'displacement' (the paper's law: the force jumps by K0*gap at closing) or 'penetration' (an elastic stop "
            "behind a gap)",
        ),
    ] = None
    switch: Annotated[Literal["ideal"] | Resolved, Switch()] = "ideal"
    frame: Annotated[
        Literal["base", "space"],
        Choice(
            ("base", "space"),
            'Where a fixed stop stands if the base of the body moves: "base" on the base, "space" in space, so that it '
            "sees the displacement of the body and that of the base together. It needs the displacement and the "
            "velocity of the base at t = 0, see `BaseMotion`.",
        ),
    ] = "base"

    @rule("frame", "b")
    def _frame_of_a_stop(self) -> None:
        if self.b is not None and self.frame != "base":
            raise ArgumentError(
                f"{label_of(self)}: frame is {self.frame!r}, but a contact between two points stands on neither base "
                "nor space; remove it. Where the bases of both bodies move differently, it sees both displacements"
            )

    @property
    def least_gap(self) -> float:
        """The least gap that the force law takes, m or rad."""
        return 0.0 if self.acts_on == "displacement" else -np.inf

    @rule("gap", "acts_on")
    def _preload(self) -> None:
        if self.gap < self.least_gap:
            raise wrong(
                f"{label_of(self)}: gap", f"{self.gap:g} {self.units.coordinate}", "a number that is not negative "
                "with acts_on='displacement'", "; a preloaded contact needs acts_on='penetration'",
            )  # fmt: skip

    @property
    def bases(self) -> tuple[tuple[Body, float], ...]:
        """The bodies whose bases' displacements the contact may see, with the signs with which these enter."""
        if self.of == "rotation":
            return ()
        if self.b is not None:
            return (self.a.body, 1.0), (self.b.body, -1.0)
        return ((self.a.body, -1.0 if self.side == "below" else 1.0),) if self.frame == "space" else ()

    def compile(self, builder: SystemBuilder) -> None:
        """Add the contact's row and law."""
        sign = -1.0 if self.side == "below" else 1.0
        builder.add_contact(
            ContactEntry(
                name=self.name,
                row=self._row(builder, sign),
                bases=self.bases,
                track=(self.a, sign) if isinstance(self.a, TravellingPoint) else None,
                gap=self.gap,
                stiffness=self.stiffness,
                damping=self.damping,
                jump=self.acts_on == "displacement",
                resolution=self.switch.s0 if isinstance(self.switch, Resolved) else np.inf,
            )
        )

    def describe(self) -> str:
        """Return points, gap, stiffness and law."""
        units = self.units
        damper = f", C0 = {self.damping:g} {units.damping}" if self.damping else ""
        switch = "" if self.switch == "ideal" else f", {self.switch!r}"
        frame = ", in space" if self.frame == "space" else ""
        return (
            f"Contact {self.name!r} {self._place()}{frame}, K0 = {self.stiffness:g} {units.stiffness}"
            f"{damper}, acts on {self.acts_on}{switch}"
        )


@declared()
class RigidStop(Stop):
    """A rigid stop with a coefficient of restitution, for ``method="event_driven"`` and orbits by shooting.

    Let b be the row of the gap function ``s = b.q - gap``, whose sign conventions are those of `Contact`. The stop
    keeps ``s <= 0``. Where s reaches zero with the speed ``b.v > 0``, the velocities change at once,

        v+ = v- - (1 + e) (b.v-)/(b M^-1 b') M^-1 b',

    so that the speed of approach is reversed and multiplied by e. Each bounce is a row of
    ``result.contacts[name].impacts`` whose closing and opening are the same time. If forces press the body against the
    stop, bounces with e < 1 accumulate: the speed falls below any limit in a finite time. Once it is below 1e-9 of the
    largest speed of approach, the contact is pinned: it rests exactly at its gap until its reaction vanishes. With
    e = 0 it is pinned at once.

    Raises
    ------
    ArgumentError
        If `side` is missing, or is given for a stop between two points, or if a value is out of range.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, Springer 2016, doi:10.1007/978-3-319-28664-8.
    """

    a: End
    b: Annotated[
        Point | None,
        AtPoint(
            "``beam.at(x)`` or a `Mass`. With b, a is the lower point: the bodies touch when a has risen relative to b "
            "by the gap. Without b the stop is fixed in space."
        ),
    ] = None
    _: KW_ONLY
    gap: Annotated[float, Real("m", "The gap.")]
    restitution: Annotated[
        float,
        Real("", "Coefficient of restitution e: speed after over speed before an impact.", least=0.0, most=1.0),
    ]
    side: Side = None

    def compile(self, builder: SystemBuilder) -> None:
        """Add the row and the coefficient."""
        row = self._row(builder, -1.0 if self.side == "below" else 1.0)
        builder.add_contact(ContactEntry(name=self.name, row=row, gap=self.gap, restitution=self.restitution))

    def describe(self) -> str:
        """Return points, gap and coefficient."""
        return f"RigidStop {self.name!r} {self._place()}, restitution {self.restitution:g}"
