"""Laws written in Python: a smooth force with a potential.

All methods that step in time accept them, and so do energies. Statics accepts them if the force grows with the
coordinate. Every evaluation costs a call of Python.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from vofem.laws.group import ListedLaws
from vofem.laws.law import FORCE, KINK, MEAN, STORED, TANGENT, Law

_GAUSS, _EPS = np.sqrt(0.6), float(np.finfo(float).eps)

#: Length of a path divided by the coordinate, above which the difference of potentials is accurate enough for the work.
_LONG = 1e-3

#: Width of a difference of forces over the coordinate, least and largest one in m, and differences over forces that are
#: lost in rounding, and that are nothing but rounding.
_WIDTH, _LEAST, _MOST, _LOST, _ROUNDING = 1e-5, 1e-150, 1e150, 1e-7, 1e-13


@dataclass(frozen=True)
class Smooth:
    """The function of a law ``R = dV/du``, see `law`; values are infinite where Python's floats overflow."""

    #: `potential`, `force`: V in J and R in N of the coordinate u in m.
    potential: Callable[[float], float]
    force: Callable[[float], float]
    slope: Callable[[float], float] | None = None  #: dR/du in N/m; a difference of forces where it is not given.

    def reaction(self, u: float) -> float:
        """Return R(u) in N."""
        return _finite(self.force, u)

    def energy(self, u: float) -> float:
        """Return V(u) in J."""
        return _finite(self.potential, u)

    def tangent(self, u: float) -> float:
        """Return dR/du in N/m.

        The width of a difference follows from u, so that no unit of length is preferred. Where the difference is lost
        in the forces, as near u = 0 in a law with an offset, the width grows, but not to where the law bends.
        """
        if self.slope is not None:
            return _finite(self.slope, u)
        width, slope, straight = max(_WIDTH * abs(u), _LEAST), float("nan"), float("inf")
        while True:
            above, below = self.reaction(u + width), self.reaction(u - width)
            change, size = abs(above - below), abs(above) + abs(below)
            if not change <= straight:
                return slope
            slope = (above - below) / (2.0 * width)
            if change > _LOST * size or size == 0.0 or width > _MOST:
                return slope
            wider = 1e4 if change <= _ROUNDING * size else 10.0
            straight = 10.0 * wider * (change + _EPS * size)
            width *= wider

    def mean(self, u0: float, u1: float) -> float:
        """Return the mean force over a path: from the potential over long paths, by quadrature over short ones."""
        if abs(u1 - u0) > _LONG * max(abs(u0), abs(u1)):
            return (self.energy(u1) - self.energy(u0)) / (u1 - u0)
        middle, half = 0.5 * (u0 + u1), 0.5 * (u1 - u0) * _GAUSS
        ends = 5.0 * self.reaction(middle - half) + 8.0 * self.reaction(middle) + 5.0 * self.reaction(middle + half)
        return ends / 18.0

    def __call__(self, what: int, p: Any, z: Any, u0: float, u1: float) -> float:
        """Answer a question."""
        if what == FORCE:
            return self.reaction(u1)
        if what == TANGENT:
            return self.tangent(u1)
        if what == MEAN:
            return self.mean(u0, u1)
        if what == STORED:
            return self.energy(u1)
        return float("nan") if what == KINK else 0.0


def _finite(function: Callable[[float], float], u: float) -> float:
    try:
        return float(function(u))
    except OverflowError:
        return float("inf")


@dataclass(frozen=True)
class SmoothLaws(ListedLaws):
    """Laws written in Python, one per row.

    `rows` has shape (n_laws, n).
    """

    place: ClassVar[int] = 1
    kind: ClassVar[str] = "nonlinear springs"
    laws: tuple[Law, ...]

    def nonlinearity(self, method: str) -> str:
        """Return why the force is not piecewise linear."""
        return f"{self.labels[0]} is not piecewise linear, which {method} needs"

    def statics_refusal(self, path: bool) -> str | None:
        """Return why statics cannot treat a law whose force may fall."""
        several = next((law for law in self.laws if not law.rising), None)
        if several is None:
            return None
        return (
            f"{'quasi_static' if path else 'equilibrium'}: {several.label} may have several equilibria or none; "
            "let a damped simulation settle instead"
        )

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return f"{self.labels[0]} has no modes; put a Spring of its tangent there"

    @property
    def forms(self) -> tuple[Law, ...]:
        """The laws."""
        return self.laws

    def scaled(self, factor: float) -> SmoothLaws | None:
        """Return laws with force and potential times a factor."""
        known = [law.function for law in self.laws if isinstance(law.function, Smooth)]
        if len(known) < len(self.laws):
            return None
        laws = (
            replace(law, function=_scaled(function, factor)) for law, function in zip(self.laws, known, strict=True)
        )
        return SmoothLaws(self.rows, tuple(laws))


def _scaled(law: Smooth, factor: float) -> Smooth:
    """Return a law with force and potential times a factor."""
    return Smooth(lambda u: factor * law.potential(u), lambda u: factor * law.force(u))
