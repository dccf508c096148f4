"""Contact: a stiffness K_eq that switches with the sign of a gap function."""

from __future__ import annotations

from typing import Literal

import numpy as np

from vofem._validate import choice, number
from vofem.assembly import ContactEntry, SystemBuilder
from vofem.bodies.base import Point, automatic_name
from vofem.effects.side import distinct, side_of
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError


class Resolved:
    """The variable-order switch at a finite scaling factor s0 (Eq. 5), with the time in Eq. 4 set to 1 s.

    The contact stiffness grows over a finite penetration instead of jumping.
    For ``s > 0`` it is ``K0 / Gamma(1 - beta)`` with ``beta = exp(-s0 s)``; for
    ``s <= 0`` it is exactly 0.

    Parameters
    ----------
    s0 : float
        Scaling factor in 1/m, positive; `vofem.fractional.scaling_factor` computes one.
    """

    def __init__(self, s0: float) -> None:
        self.s0 = number("Resolved: s0", s0, positive=True)

    def __repr__(self) -> str:
        return f"Resolved(s0={self.s0:g})"


class Contact(TwoPoints):
    """A contact between two points, or between a point and a stop that is fixed in space.

    Let eta be the displacement of point a, positive upward. The gap function is
    ``s = u_a - u_b - gap`` between two points, ``s = -eta - gap`` for a stop
    below, and ``s = eta - gap`` for a stop above. The contact is closed while
    ``s > 0``, and s is then the penetration. A closed contact pushes the bodies
    apart (Eqs. 8-13 and 15-18 of the paper). A contact with a damper opens at
    zero penetration and not at zero force; its force can therefore be negative
    shortly before it opens.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. With b, a is the lower point: the contact
        closes when a has risen relative to b by more than the gap. Without b
        the contact is a stop that is fixed in space.
    gap : float
        The gap in m. A negative gap is a preload; it needs ``acts_on="penetration"``.
    stiffness : float
        Contact stiffness K0 in N/m, positive.
    damping : float
        Damping constant C0 in N s/m, not negative. The damper acts only while the contact is closed.
    side : "below" or "above"
        The side on which a fixed stop stands. A stop below closes when ``eta < -gap``, and a stop above closes when
        ``eta > gap``.
    acts_on : "displacement" or "penetration"
        "penetration" is an elastic stop behind a gap: the force is K0 times
        ``s``. "displacement" is the paper's law: the force is K0 times the whole
        displacement and jumps by ``K0 gap`` when the contact closes. There is no default.
    switch : "ideal" or Resolved
        "ideal" switches the stiffness at once (Eq. 8). `Resolved` is the operator at a finite scaling factor s0.
    of : {"displacement", "rotation"}
        Whether u and eta above are displacements in m, or rotations of beams in rad, positive like
        the slope. With rotations forces are moments in N m.
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        If `side` is missing, or is given for a contact between two points; if `acts_on` is missing; or if a value is
        out of range.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        gap: float,
        stiffness: float,
        damping: float = 0.0,
        side: Literal["below", "above"] | None = None,
        acts_on: Literal["displacement", "penetration"] | None = None,
        switch: Literal["ideal"] | Resolved = "ideal",
        of: Literal["displacement", "rotation"] = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "Contact")
        label = f"Contact {self.name!r}"
        self._attach(label, a, b, of)
        distinct(label, self.a, self.b)
        if acts_on is None:
            raise ArgumentError(
                f"{label}: acts_on is missing, expected 'displacement' (the paper's law: the force jumps by "
                "K0*gap at closing) or 'penetration' (an elastic stop behind a gap)"
            )
        self.acts_on = choice(f"{label}: acts_on", acts_on, ("displacement", "penetration"))
        self.side = side_of(label, "a contact", self.b, side)
        self.gap = number(f"{label}: gap", gap)
        if self.acts_on == "displacement" and self.gap < 0:
            raise ArgumentError(
                f"{label}: gap is {self.gap:g} {self.units.coordinate}, expected a number that is not negative "
                "with acts_on='displacement'; a preloaded contact needs acts_on='penetration'"
            )
        self.stiffness = number(f"{label}: stiffness", stiffness, positive=True)
        self.damping = number(f"{label}: damping", damping, minimum=0)
        if switch != "ideal" and not isinstance(switch, Resolved):
            raise ArgumentError(f"{label}: switch is {switch!r}, expected 'ideal' or vofem.Resolved(s0)")
        self.switch = switch

    def compile(self, builder: SystemBuilder) -> None:
        """Add the contact's row and law."""
        builder.add_contact(
            ContactEntry(
                name=self.name,
                row=self._row(builder, -1.0 if self.side == "below" else 1.0),
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
        return (
            f"Contact {self.name!r} {self._stop(self.side, self.gap)}, K0 = {self.stiffness:g} {units.stiffness}"
            f"{damper}, acts on {self.acts_on}{switch}"
        )
