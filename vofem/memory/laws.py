"""Laws whose force depends on the past of their elongation, as numbers.

A cyclic law is elastic between two forces, the largest that tension and
compression have reached, and follows its backbone beyond either of them. Its
state is six numbers, `virgin` says which. A Jenkins law is a spring beside
elements of a spring and a slider each; its state is the places of the sliders.
Both are rate independent: the force follows from the state and the elongation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Kinds of laws.
HYPERBOLIC, TABULATED, JENKINS = 0, 1, 2


@dataclass(frozen=True)
class MemoryLaw:
    """A rate-independent law with memory on a row; the force on the structure is ``-b R``.

    Attributes
    ----------
    label : str
        Class and name of its spring, for messages.
    name : str
    kind : int
        HYPERBOLIC, TABULATED or JENKINS.
    stiffness : float
        That of the virgin law in N/m, the largest it ever has.
    onset : float
        Force at which it first yields, N.
    limit : float
        Force that it never reaches, N; inf where there is none.
    one_sided : bool
        Whether it cannot pull, as a stop.
    gap : float
        Elongation from which the law counts, m.
    parameters : ndarray
        Of HYPERBOLIC the range of forces over which the secant stiffness falls
        to zero, N. Of TABULATED elongation, force, slope and work at the knots
        of the backbone, one after the other. Of JENKINS the stiffness of the
        spring beside, then those of the elements, then their slip forces.
    unit : str
        Of its force, for messages: "N m" where it acts on a rotation, and then
        the numbers above are in rad, N m and N m/rad.
    """

    label: str
    name: str
    kind: int
    stiffness: float
    onset: float
    limit: float
    one_sided: bool
    gap: float
    parameters: Array
    unit: str = "N"

    def virgin(self) -> Array:
        """Return the state before any load: energy dissipated (J), then what the kind remembers.

        A cyclic law: elongation on the backbone and force where tension goes
        on, both where compression goes on, residual elongation. A Jenkins law:
        the sliders' places.
        """
        if self.kind == JENKINS:
            return np.zeros(1 + (self.parameters.size - 1) // 2)
        reach = self.onset / self.stiffness
        return np.array([0.0, reach, self.onset, reach, self.onset, 0.0])


@dataclass(frozen=True)
class LinearLevel:
    """The softening number that grows linearly with the force: ``(F - onset)/span``, both in N."""

    onset: float
    span: float

    def __call__(self, force: float) -> float:
        """Return the number at a force of a magnitude in N."""
        return max(force - self.onset, 0.0) / self.span


@dataclass(frozen=True)
class PrintedLaw:
    """Eqs. 22-25 as they stand: a secant stiffness that follows the applied force.

    Attributes
    ----------
    label, name : str
    stiffness : float
        K in N/m.
    linear_limit : float
        d0 in m.
    level : callable
        The softening number of a force's magnitude in N.
    limit : float
        Force in N at which the secant stiffness is zero; inf where there is none.
    """

    label: str
    name: str
    stiffness: float
    linear_limit: float
    level: Callable[[float], float]
    limit: float


def past_of(laws: tuple[MemoryLaw, ...], states: Array, name: str) -> Array | None:
    """Return the state of the law of that name among those of all, one after the other, or None."""
    start = 0
    for law in laws:
        size = law.virgin().size
        if law.name == name:
            return states[start : start + size].copy()
        start += size
    return None
