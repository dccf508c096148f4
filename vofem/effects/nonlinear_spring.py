"""Springs with a smooth law that is given as Python functions, such as cubic, bistable or softening springs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, automatic_name
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.laws import SmoothLaw

#: Elongations in m at which force and potential are compared.
_SAMPLES = (-1.0, -0.1, -1e-2, -1e-3, 1e-3, 1e-2, 0.1, 1.0)


class NonlinearSpring(TwoPoints):
    """An elastic spring with a law written in Python, between two points or from a point to ground.

    The methods that step in time accept it, and so does harmonic balance.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    potential : callable
        The energy V(u) in J, as a function of the elongation ``u = u_a - u_b`` in m.
    force : callable
        The derivative ``F(u) = dV/du`` in N. The spring acts on a with -F and on b with +F; a linear
        spring has ``F = k u``.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        If the force is not the derivative of the potential.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        potential: Callable[[float], float],
        force: Callable[[float], float],
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "NonlinearSpring")
        label = f"NonlinearSpring {self.name!r}"
        self._attach(label, a, b, of)
        for what, function in (("potential", potential), ("force", force)):
            if not callable(function):
                raise ArgumentError(
                    f"{label}: {what} is {function!r}, expected a callable of the elongation in {self.units.coordinate}"
                )
        self.law = SmoothLaw(self.name, potential, force)
        self._check(label)

    @property
    def potential(self) -> Callable[[float], float]:
        """The energy V in J, as a function of the elongation in m."""
        return self.law.potential

    @property
    def force(self) -> Callable[[float], float]:
        """The force dV/du in N, as a function of the elongation in m."""
        return self.law.force

    def _check(self, label: str) -> None:
        """Compare the force with a difference quotient of the potential, to find mistakes such as a wrong sign."""
        with np.errstate(all="ignore"):
            for u in _SAMPLES:
                step = 1e-4 * abs(u)
                right, middle, left = (self.law.energy(u + i * step) for i in (1, 0, -1))
                force = self.law.reaction(u)
                if not np.all(np.isfinite([right, middle, left, force])):
                    continue
                slope = (right - left) / (2.0 * step)
                # The error of the quotient itself, from the curvature and from rounding.
                slack = abs(right - 2.0 * middle + left) / step + 1e-12 * (abs(right) + abs(left)) / step
                if abs(slope - force) > 1e-3 * (abs(slope) + abs(force)) + slack:
                    raise ArgumentError(
                        f"{label}: force({u:g}) is {force:g} {self.units.force}, but the potential grows by {slope:g} "
                        f"{self.units.force} there; "
                        "expected force = dV/du (positive in tension, like k*u)"
                    )

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder), self.law)

    def describe(self) -> str:
        """Return name and points."""
        return f"NonlinearSpring {self.name!r} from {self._where()}"
