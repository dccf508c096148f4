"""Springpots: fractional dashpots, whose behaviour lies between that of a spring and that of a dashpot."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem._validate import number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, automatic_name
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.fractional.laws import ConstantOrder, OrderLaw
from vofem.laws import SpringpotLaw
from vofem.time_functions import Constant


class Springpot(TwoPoints):
    """A fractional dashpot between two points, or from a point to ground: ``force = coefficient D^order u``.

    Here u is the elongation ``u_a - u_b``, and D^order is Caputo's derivative
    from t = 0: the past rates of elongation, weighted with
    ``age^-order/Gamma(1 - order)`` and integrated. Order 1 is a dashpot; as the
    order tends to 0 the springpot becomes a spring. The structure is taken to
    have been at rest, in its initial place, before t = 0. An elongation at
    t = 0 therefore causes no force. Under a constant force a springpot of an
    order above 0 creeps without end.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    coefficient : float
        Coefficient of the law, N s^order/m, not negative.
    order : float or callable
        A number in (0, 1], or a function of time with values in [0, 1]. Such a
        function is a callable that takes an array of times in s, for example a
        law of `vofem.fractional`. The force at t is computed from the whole past
        with the order at t.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        For arguments out of range.

    References
    ----------
    R. C. Koeller, Applications of fractional calculus to the theory of viscoelasticity, J. Appl. Mech. 51 (1984)
    299-307, https://doi.org/10.1115/1.3167616.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        coefficient: float,
        order: float | OrderLaw,
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "Springpot")
        label = f"Springpot {self.name!r}"
        self._attach(label, a, b, of)
        self.coefficient = number(f"{label}: coefficient", coefficient, minimum=0)
        self.order: float | OrderLaw = _order(label, order)

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        law = SpringpotLaw(f"Springpot {self.name!r}", self.name, self.coefficient, self.order)
        builder.add_law(self._row(builder), law)

    def describe(self) -> str:
        """Return name, points and numbers."""
        force, coordinate = self.units.force, self.units.coordinate
        if callable(self.order):
            what = f"{self.coefficient:g} {force} s^order/{coordinate}, order {_shown(self.order)}"
        else:
            what = f"{self.coefficient:g} {force} s^{self.order:g}/{coordinate}"
        return f"Springpot {self.name!r} from {self._where()}: {what}"


def _order(label: str, order: Any) -> float | OrderLaw:
    """Return an order, checked; laws that never change as a number."""
    if isinstance(order, (ConstantOrder, Constant)):
        order = order.value
    if callable(order) and not isinstance(order, type):
        law: OrderLaw = order
        return law
    if isinstance(order, (str, bytes)) or np.ndim(order) > 0:
        raise ArgumentError(f"{label}: order is {order!r}, expected a number from 0 to 1, or a function of time")
    value = number(f"{label}: order", order)
    if not 0.0 < value <= 1.0:
        cure = "; a Spring is what order 0 would be" if value == 0.0 else ""
        raise ArgumentError(f"{label}: order is {value:g}, expected a number above 0 and up to 1{cure}")
    return value


def _shown(law: Any) -> str:
    """Return a law as text; a function is shown by its name."""
    return str(getattr(law, "__name__", None) or type(law).__name__)
