"""The hysteretic law of Eqs. 22-25 as they are printed: a secant stiffness that depends on the applied force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from vofem.arrays import Array
from vofem.errors import LimitLoadError
from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.law import Law, affine


@dataclass(frozen=True)
class LinearLevel:
    """The softening ``(F - onset)/span``, which grows linearly with the force; F, onset and span are in N."""

    onset: float
    span: float

    def __call__(self, force: float) -> float:
        """Return the number at a force of a magnitude in N."""
        return max(force - self.onset, 0.0) / self.span


@dataclass(frozen=True)
class PrintedLaw:
    """The law of Eqs. 22-25 as they stand: a secant stiffness that depends on the applied force."""

    label: str
    name: str
    stiffness: float  #: K in N/m.
    linear_limit: float  #: d0 in m.
    level: Callable[[float], float]  #: The softening, without unit, as a function of the magnitude of the force in N.
    limit: float  #: Force in N at which the secant stiffness is zero; inf where there is none.

    @property
    def group(self) -> type[LawGroup]:
        """The group that gathers laws of this kind."""
        return PrintedLaws

    def stored(self, forces: Array) -> Array:
        """Return the stored energy in J at spring forces in N."""
        return np.asarray(0.5 * forces**2 / self.stiffness)

    def path(self, forces: Array, factors: Array) -> Array:
        """Return the elongations of Eq. 25 under applied forces in N, shape (n_factors,), from the unloaded state on.

        While the force is constant, the sign of its rate is the last one before. The
        supremum in Eq. 25 is taken over the path since the unloaded state.

        Raises `LimitLoadError` where the secant stiffness is not positive.
        """
        elongation = np.empty(forces.size)
        before, rising, top, force_at_top = 0.0, True, 0.0, 0.0
        for n, force in enumerate(forces.tolist()):
            if force != before:
                rising = force > before
            linear = force / self.stiffness
            if not rising:
                # Operator 3 acts: the residual elongation.
                xi = linear + (top - force_at_top / self.stiffness)
            elif abs(linear) <= self.linear_limit:
                xi = linear
            else:
                secant = 1.0 - self.level(abs(force))
                if not (secant > 0.0 and abs(force) < self.limit):
                    raise LimitLoadError(
                        f"{self.label}: the load reaches {force:.6g} N at load factor {factors[n]:g}, and the spring "
                        f"carries less than {self.limit:.6g} N: there its secant stiffness falls to zero, and no "
                        "equilibrium exists. Load it less, or change its softening",
                        force, float(factors[n]), self.limit,
                    )  # fmt: skip
                xi = linear / secant
            if xi > top:
                top, force_at_top = xi, force
            elongation[n], before = xi, force
        return elongation


@dataclass(frozen=True)
class PrintedLaws(ListedLaws):
    """The one law of this kind in a system of one degree of freedom.

    `rows` has shape (1, 1).
    """

    place: ClassVar[int] = 2
    kind: ClassVar[str] = "hysteretic springs"
    recorded: ClassVar[bool] = True
    named: ClassVar[str] = "springs"

    laws: tuple[PrintedLaw, ...]

    @property
    def driven(self) -> PrintedLaw:
        """The law, which the applied load drives."""
        return self.laws[0]

    def nonlinearity(self, method: str) -> str:
        """Return why the force is not piecewise linear."""
        return f"{self.driven.label} follows Eq. 22, whose stiffness varies with the applied force"

    def statics_refusal(self, path: bool) -> str | None:
        """Return why there is no equilibrium without a path."""
        return None if path else path_needed(self.driven.label)

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return no_modes(self.driven.label)

    def harmonic_refusal(self) -> str:
        """Return why harmonic balance does not take the law."""
        return (
            f"{self.driven.label} follows no law that harmonic balance knows, because the applied force drives it. "
            "Simulate until the motion settles instead"
        )

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The spring before the first load; the law itself is no function of the elongation."""
        numbers = np.array([0.0, self.driven.stiffness, 0.0, 0.0])
        return (Law(
            self.driven.label, self.driven.name, affine, numbers, stiffness=self.driven.stiffness,
            limit=self.driven.limit,
        ),)  # fmt: skip

    def numbers(self) -> Array:
        """Return stiffness, linear limit and limit load."""
        return np.array([self.driven.stiffness, self.driven.linear_limit, self.driven.limit])


def path_needed(label: str) -> str:
    """Return why a law with internal variables has no equilibrium without a load path."""
    return (
        f"equilibrium: {label} has equilibria that depend on the path to them; "
        "use vofem.quasi_static(scene, load_factors)"
    )


def no_modes(label: str) -> str:
    """Return why a law with internal variables has no modes."""
    return f"{label} has no modes; put a Spring of its initial stiffness there"
