"""Springpots: fractional dashpots, whose behaviour lies between that of a spring and that of a dashpot."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np

from vofem._validate import number, wrong
from vofem.assembly import SystemBuilder
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.fractional.laws import ConstantOrder, OrderLaw, TabulatedOrder
from vofem.laws import SpringpotLaw
from vofem.parameters import Kind, OneOf, Real, declared
from vofem.parameters.kinds import Either
from vofem.parameters.place import Invalid, Place
from vofem.time_functions import Constant

_TABLE = OneOf(classes={"tabulated": TabulatedOrder}, expected="{ tabulated = { x = [t0, t1, ...], orders = [...] } }")


@dataclass(frozen=True)
class Order(Either):
    """The order of a springpot: a number, or a function of time."""

    text: str = (
        "A number in (0, 1], or a function of time with values in [0, 1]. Such a function is a callable that takes an "
        "array of times in s, for example a law of `vofem.fractional`. The force at t is computed from the whole past "
        "with the order at t."
    )

    shown = "float or callable"
    expected = f"a positive number or {_TABLE.expected}"

    def check(self, what: str, value: Any) -> float | OrderLaw:
        """Return an order; laws that never change as a number."""
        if isinstance(value, (ConstantOrder, Constant)):
            value = value.value
        if callable(value) and not isinstance(value, type):
            law: OrderLaw = value
            return law
        if isinstance(value, (str, bytes)) or np.ndim(value) > 0:
            raise ArgumentError(f"{what} is {value!r}, expected a number from 0 to 1, or a function of time")
        order = number(what, value)
        if not 0.0 < order <= 1.0:
            cure = "; a Spring is what order 0 would be" if order == 0.0 else ""
            raise wrong(what, f"{order:g}", "a number above 0 and up to 1", cure)
        return order

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return both."""
        return Real(above=0.0), None, _TABLE

    def read(self, value: Any, place: Place) -> Any:
        """Return the number, or the law of a table."""
        found = super().read(value, place)
        return found if isinstance(value, dict) or isinstance(found, Invalid) else Kind.read(self, found, place)


@declared()
class Springpot(TwoPoints):
    """A fractional dashpot between two points, or from a point to ground: ``force = coefficient D^order u``.

    Here u is the elongation ``u_a - u_b``, and D^order is Caputo's derivative from t = 0: the past rates of elongation,
    weighted with ``age^-order/Gamma(1 - order)`` and integrated. Order 1 is a dashpot; as the order tends to 0 the
    springpot becomes a spring. The structure is taken to have been at rest, in its initial place, before t = 0. An
    elongation at t = 0 therefore causes no force. Under a constant force a springpot of an order above 0 creeps without
    end.

    Raises
    ------
    ArgumentError
        For arguments out of range.

    References
    ----------
    R. C. Koeller, Applications of fractional calculus to the theory of viscoelasticity, J. Appl. Mech. 51 (1984)
    299-307, https://doi.org/10.1115/1.3167616.
    """

    _: KW_ONLY
    coefficient: Annotated[float, Real("N s^order/m", "Coefficient of the law.", least=0)]
    order: Annotated[float | OrderLaw, Order()]

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        law = SpringpotLaw(f"Springpot {self.name!r}", self.name, self.coefficient, self.order)
        builder.add_law(self._row(builder), law)

    def describe(self) -> str:
        """Return name, points and numbers."""
        force, coordinate = self.units.force, self.units.coordinate
        if callable(self.order):
            law = getattr(self.order, "__name__", type(self.order).__name__)
            what = f"{self.coefficient:g} {force} s^order/{coordinate}, order {law}"
        else:
            what = f"{self.coefficient:g} {force} s^{self.order:g}/{coordinate}"
        return f"Springpot {self.name!r} from {self._where()}: {what}"
