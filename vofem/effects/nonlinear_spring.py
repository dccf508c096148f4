"""Springs with a smooth law that is given as Python functions, such as cubic, bistable or softening springs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import Annotated

import numpy as np

from vofem.assembly import SystemBuilder
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.laws import Law, Smooth
from vofem.parameters import Function, declared, label_of, rule

#: Elongations in m at which force and potential are compared, and the width of a difference over them, which is no
#: multiple of the period of a law.
_SAMPLES, _WIDTH = (-1.0, -0.1, -1e-2, -1e-3, 1e-3, 1e-2, 0.1, 1.0), 1e-4 * np.sqrt(2.0)


@declared()
class NonlinearSpring(TwoPoints):
    """An elastic spring with a law written in Python, between two points or from a point to ground.

    The methods that step in time accept it, and so does harmonic balance.

    Raises
    ------
    ArgumentError
        If the force is not the derivative of the potential.
    """

    _: KW_ONLY
    potential: Annotated[
        Callable[[float], float],
        Function("the elongation", "The energy V(u) in J, as a function of the elongation ``u = u_a - u_b`` in m."),
    ]
    force: Annotated[
        Callable[[float], float],
        Function(
            "the elongation",
            "The derivative ``F(u) = dV/du`` in N. The spring acts on a with -F and on b with +F; a linear spring has "
            "``F = k u``.",
        ),
    ]

    @rule("force", "potential")
    def _force_is_the_derivative(self) -> None:
        """Compare the force with a difference quotient of the potential, to find mistakes such as a wrong sign."""
        label = label_of(self)
        law = Smooth(self.potential, self.force)
        self.law = Law(f"NonlinearSpring {self.name!r}", self.name, law, rising=False)
        with np.errstate(all="ignore"):
            for u in _SAMPLES:
                step = _WIDTH * abs(u)
                try:
                    left, right = law.energy(u - step), law.energy(u + step)
                    before, force, behind = (law.reaction(u + i * step) for i in (-1, 0, 1))
                except (ArithmeticError, ValueError):
                    continue  # The law is not defined there.
                if not np.all(np.isfinite([left, right, before, force, behind])):
                    continue
                slope = (right - left) / (2.0 * step)
                # The error of the quotient itself, from changes of the force and from rounding.
                slack = abs(before - force) + abs(behind - force) + 1e-12 * (abs(right) + abs(left)) / step
                if abs(slope - force) > 1e-3 * (abs(slope) + abs(force)) + slack:
                    raise ArgumentError(
                        f"{label}: force({u:g}) is {force:g} {self.units.force}, but the potential grows by {slope:g} "
                        f"{self.units.force} there; expected force = dV/du (positive in tension, like k*u)"
                    )

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder), self.law)

    def describe(self) -> str:
        """Return name and points."""
        return f"NonlinearSpring {self.name!r} from {self._where()}"
