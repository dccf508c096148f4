"""Dry friction between two points, a point and ground, or a point and a belt."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

import numpy as np

from vofem._validate import wrong
from vofem.assembly import SystemBuilder
from vofem.effects.kinds import Named
from vofem.effects.side import distinct
from vofem.effects.two_points import TwoPoints
from vofem.laws.friction import FrictionLaw
from vofem.parameters import CHOSEN, Real, declared, label_of, rule
from vofem.time_functions.base import OfTime, TimeFunction


@declared()
class Friction(TwoPoints):
    """Coulomb friction under a constant normal force, for ``method="event_driven"``.

    The slip speed is ``w = v_a - v_b - belt``. While it slides, the force on a is ``coefficient * normal`` against w.
    While it sticks, w is zero exactly, and the force is the reaction that keeps it so; sticking ends where the reaction
    reaches ``static * normal``. With `stiffness` the slider is behind a spring (a Jenkins element): while it sticks,
    w stretches the spring. `result.frictions` has the histories.

    Raises
    ------
    ArgumentError
        If `static` is below `coefficient`, or a value is out of range.

    References
    ----------
    R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004,
    doi:10.1007/978-3-540-44398-8.
    """

    symbol = "damper"

    _: KW_ONLY
    coefficient: Annotated[float, Real("", "Coefficient of friction while it slides.", above=0.0)]
    normal: Annotated[float, Real("N", "Normal force.", above=0.0)]
    static: Annotated[
        float | None, Real("", "Coefficient at break-away, not below `coefficient`, which is the default.", above=0.0)
    ] = None
    stiffness: Annotated[
        float | None, Real("N/m", "Stiffness of the spring in series. Without it sticking is rigid.", above=0.0)
    ] = None
    belt: Annotated[
        TimeFunction | float | None, OfTime("m/s", "Speed of the belt on which a lies. Without it there is no belt.")
    ] = None
    name: Named = CHOSEN

    @rule("b", "a")
    def _points_differ(self) -> None:
        distinct(label_of(self), self.a, self.b)

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
        law = FrictionLaw(
            self.name, label_of(self), self.coefficient * self.normal, static * self.normal,
            np.inf if self.stiffness is None else self.stiffness, belt, self.normal,
        )  # fmt: skip
        builder.add_law(self._row(builder), law)

    def describe(self) -> str:
        """Return points and numbers."""
        static = "" if self.static is None else f", {self.static:g} at break-away"
        spring = "" if self.stiffness is None else f", behind {self.stiffness:g} {self.units.stiffness}"
        belt = "" if self.belt is None else f", on a belt of speed {self.belt!r}"
        return (
            f"Friction {self.name!r} from {self._where()}: coefficient {self.coefficient:g}{static}, normal force "
            f"{self.normal:g} N{spring}{belt}"
        )
