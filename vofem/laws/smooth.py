"""Laws written in Python: a smooth force with a potential.

A law of this kind gives its force, energy and tangent as plain Python methods of
one coordinate. All methods that step in time accept it, and so do energies.
Statics accepts it if its force grows with the coordinate. Every evaluation costs
a call of Python.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.law import FORCE, KINK, MEAN, STORED, TANGENT, Function, Law

_GAUSS = np.sqrt(0.6)

#: Length of a path divided by the coordinate, above which the difference of potentials is accurate enough for the work.
_LONG = 1e-3


@runtime_checkable
class ScalarLaw(Protocol):
    """The methods that a law written in Python must have. Its coordinate is u in m.

    `name`, `label`: the name, and the name with the class of its effect in front for messages.
    `monotone`: whether the force never falls as u rises. An equilibrium is then unique.
    """

    @property
    def name(self) -> str:
        """Name of the effect."""

    @property
    def monotone(self) -> bool:
        """Whether the force never falls as u rises."""

    @property
    def label(self) -> str:
        """Name with the class of the effect."""

    @property
    def group(self) -> type[LawGroup]:
        """`SmoothLaws`."""

    def reaction(self, u: float) -> float:
        """Return the force R in N; the force on the structure is ``-b R``."""

    def energy(self, u: float) -> float:
        """Return the stored energy V in J, ``R = dV/du``."""

    def tangent(self, u: float) -> float:
        """Return dR/du in N/m."""


@dataclass(frozen=True)
class SmoothLaw:
    """A smooth scalar law ``R = dV/du`` on a row; the force on the structure is ``-b R``."""

    name: str
    #: `potential`, `force`: V in J and R in N of the elongation u in m.
    potential: Callable[[float], float]
    force: Callable[[float], float]

    @property
    def monotone(self) -> bool:
        """False, because a function of the user may fall, so that the spring may have several equilibria."""
        return False

    @property
    def group(self) -> type[LawGroup]:
        """The group that gathers laws of this kind."""
        return SmoothLaws

    @property
    def label(self) -> str:
        """Name with the class of the effect."""
        return f"NonlinearSpring {self.name!r}"

    def reaction(self, u: float) -> float:
        """Return R(u) in N; infinite where Python's floats overflow."""
        try:
            return float(self.force(u))
        except OverflowError:
            return float("inf")

    def energy(self, u: float) -> float:
        """Return V(u) in J; infinite where Python's floats overflow."""
        try:
            return float(self.potential(u))
        except OverflowError:
            return float("inf")

    def tangent(self, u: float, step: float = 1e-6) -> float:
        """Return dR/du in N/m by a central difference."""
        width = step * max(1.0, abs(u))
        return (self.reaction(u + width) - self.reaction(u - width)) / (2.0 * width)

    def scaled(self, factor: float) -> SmoothLaw:
        """Return the law with force and potential times a factor."""
        potential, force = self.potential, self.force
        return SmoothLaw(self.name, lambda u: factor * potential(u), lambda u: factor * force(u))


def mean_reaction(law: ScalarLaw, u0: float, u1: float) -> float:
    """Return the mean force over a path: from the potential over long paths, by quadrature over short ones."""
    if abs(u1 - u0) > _LONG * max(abs(u0), abs(u1)):
        return (law.energy(u1) - law.energy(u0)) / (u1 - u0)
    middle, half = 0.5 * (u0 + u1), 0.5 * (u1 - u0) * _GAUSS
    return (5.0 * law.reaction(middle - half) + 8.0 * law.reaction(middle) + 5.0 * law.reaction(middle + half)) / 18.0


def _function(law: ScalarLaw) -> Function:
    """Return the function of a law written in Python; see `law`."""

    def answer(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
        if what == FORCE:
            return law.reaction(u1)
        if what == TANGENT:
            return law.tangent(u1)
        if what == MEAN:
            return mean_reaction(law, u0, u1)
        if what == STORED:
            return law.energy(u1)
        return float("nan") if what == KINK else 0.0

    return answer


@dataclass(frozen=True)
class SmoothLaws(ListedLaws):
    """Laws written in Python, one per row.

    `rows` has shape (n_laws, n).
    """

    place: ClassVar[int] = 1
    kind: ClassVar[str] = "nonlinear springs"
    laws: tuple[ScalarLaw, ...]

    def nonlinearity(self, method: str) -> str:
        """Return why the force is not piecewise linear."""
        return f"{self.labels[0]} is not piecewise linear, which {method} needs"

    def statics_refusal(self, path: bool) -> str | None:
        """Return why statics cannot treat a law whose force may fall."""
        several = next((law for law in self.laws if not law.monotone), None)
        if several is None:
            return None
        return (
            f"{'quasi_static' if path else 'equilibrium'}: {several.label} may have several equilibria or none; "
            "let a damped simulation settle instead"
        )

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return f"{self.labels[0]} has no modes; put a Spring of its tangent there"

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The laws as functions."""
        return tuple(Law(law.label, law.name, _function(law), rising=False) for law in self.laws)

    def scaled(self, factor: float) -> SmoothLaws | None:
        """Return laws with force and potential times a factor."""
        laws = [law for law in self.laws if isinstance(law, SmoothLaw)]
        if len(laws) < len(self.laws):
            return None
        return SmoothLaws(self.rows, tuple(law.scaled(factor) for law in laws))
