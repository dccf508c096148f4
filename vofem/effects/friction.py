"""Dry friction between two points, a point and ground, or a point and a belt."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np

from vofem._validate import wrong
from vofem.assembly import SystemBuilder
from vofem.effects.contact import Contact
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.laws.friction import FrictionLaw
from vofem.parameters import Name, Real, declared, label_of, rule
from vofem.parameters.place import Book
from vofem.time_functions.base import Constant, OfTime, TimeFunction


@dataclass(frozen=True)
class OfContact(Name):
    """A contact, or its name; in scene files its name."""

    shown = "Contact or str"
    expected = "a Contact, or the name of one"

    def check(self, what: str, value: Any) -> Contact | str:
        """Return the contact or the name."""
        if isinstance(value, Contact):
            return value
        if not isinstance(value, str) or not value:
            raise ArgumentError(f"{what} is {value!r}, expected {self.expected}")
        return value

    def write(self, value: Any, book: Book) -> str:
        """Return the name."""
        return super().write(value.name if isinstance(value, Contact) else value, book)


@declared()
class Friction(TwoPoints):
    """Coulomb friction under a given normal force, or under the force of a contact.

    The slip speed is ``w = v_a - v_b - belt``. While it slides, the force on a is ``coefficient * normal`` against w.
    While it sticks, w is zero exactly, and the force is the reaction that keeps it so; sticking ends where the reaction
    reaches ``static * normal``. With `stiffness` the slider is behind a spring (a Jenkins element): while it sticks,
    w stretches the spring. This spring is relaxed at the start of a run, wherever a is then; hysteretic springs count
    their elongation from ``u = 0`` instead. `result.frictions` has the histories.

    ``"event_driven"`` treats sliders under a constant normal force, the methods that step in time all sliders. Harmonic
    balance treats those with `stiffness`, and shooting rigid ones, both under a constant normal force; shooting takes
    no belt.

    Raises
    ------
    ArgumentError
        If not exactly one of `normal` and `contact` is given, if `static` is below `coefficient`, or if a value is out
        of range.

    References
    ----------
    R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004,
    doi:10.1007/978-3-540-44398-8.
    """

    symbol = "damper"

    _: KW_ONLY
    coefficient: Annotated[float, Real("", "Coefficient of friction while it slides.", above=0.0)]
    static: Annotated[
        float | None, Real("", "Coefficient at break-away, not below `coefficient`, which is the default.", above=0.0)
    ] = None
    normal: Annotated[
        TimeFunction | float | None,
        OfTime("N", "Normal force; where it depends on time, it presses only while it is positive."),
    ] = None
    contact: Annotated[
        Contact | str | None,
        OfContact(
            "`Contact` whose force presses, or its name; ``N = max(force, 0)``. Give either this or `normal`. Methods "
            "that step in time treat it."
        ),
    ] = None
    stiffness: Annotated[
        float | None, Real("N/m", "Stiffness of the spring in series. Without it sticking is rigid.", above=0.0)
    ] = None
    belt: Annotated[
        TimeFunction | float | None, OfTime("m/s", "Speed of the belt on which a lies. Without it there is no belt.")
    ] = None

    @rule("normal", "contact")
    def _pressed_once(self) -> None:
        if (self.normal is None) == (self.contact is None):
            found = (
                "neither normal nor contact is given" if self.normal is None else "both normal and contact are given"
            )
            raise ArgumentError(
                f"{label_of(self)}: {found}, expected one of them: normal=5.0 for a "
                "constant force in N, or contact= with a Contact, or its name, for the force of that contact"
            )

    @rule("normal")
    def _presses(self) -> None:
        if isinstance(self.normal, Constant) and not self.normal.value > 0.0:
            raise wrong(f"{label_of(self)}: normal", f"{self.normal.value:g}", "a force above 0 N")

    @rule("static", "coefficient")
    def _harder_to_start(self) -> None:
        if self.static is not None and self.static < self.coefficient:
            raise wrong(
                f"{label_of(self)}: static", f"{self.static:g}",
                f"a number not below coefficient = {self.coefficient:g}", "; exchange the two",
            )  # fmt: skip

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        static = self.coefficient if self.static is None else self.static
        belt = self.belt if isinstance(self.belt, TimeFunction) else None
        constant = self.normal.value if isinstance(self.normal, Constant) else None
        varies = self.normal if constant is None and isinstance(self.normal, TimeFunction) else None
        normal = 1.0 if constant is None else constant
        law = FrictionLaw(
            self.name, label_of(self), self.coefficient * normal, static * normal,
            np.inf if self.stiffness is None else self.stiffness, belt, normal, self.pressing, varies,
        )  # fmt: skip
        builder.add_law(self._row(builder), law)

    @property
    def pressing(self) -> str | None:
        """The name of the contact that presses; None where the normal force is constant."""
        return self.contact.name if isinstance(self.contact, Contact) else self.contact

    def describe(self) -> str:
        """Return points and numbers."""
        static = "" if self.static is None else f", {self.static:g} at break-away"
        spring = "" if self.stiffness is None else f", behind {self.stiffness:g} {self.units.stiffness}"
        belt = "" if self.belt is None else f", on a belt of speed {self.belt!r}"
        pressed = f"pressed by {self.pressing!r}" if self.normal is None else f"normal force {self.normal!r} N"
        if isinstance(self.normal, Constant):
            pressed = f"normal force {self.normal.value:g} N"
        return (
            f"Friction {self.name!r} from {self._where()}: coefficient {self.coefficient:g}{static}, {pressed}"
            f"{spring}{belt}"
        )
