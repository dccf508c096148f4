"""The interface of methods for periodic orbits, so that one code follows branches with all methods.

A method (shooting, harmonic balance) describes the orbits of one scene as the
roots of as many equations as unknowns: `OrbitProblem`. A branch needs the same
problem at other values of a parameter: `family.Family`. Derivatives with respect
to the parameter are taken by differences of residuals, so that a scene may
depend on it in any way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.scene import Scene
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.system import Counters


@dataclass
class Work:
    """Work done to find orbits."""

    #: Evaluations of the equations. For shooting these are flows over one orbit, with or without monodromy matrix.
    flows: int = 0
    checks: int = 0  #: Flows over orbits that are known, with which these are checked.
    runs: Counters = field(default_factory=Counters)  #: Work of these evaluations.


class Evaluation(Protocol):
    """The equations at one set of unknowns."""

    @property
    def residual(self) -> Array:
        """Residual of the equations, shape (n,)."""

    @property
    def jacobian(self) -> Array:
        """Derivative of the residual with respect to the unknowns, shape (n, n); only if it was requested."""

    @property
    def error(self) -> float:
        """Size of the residual over that of the motion: the value of `PeriodicOrbit.residual`."""

    @property
    def multipliers(self) -> NDArray[np.complex128] | None:
        """Floquet multipliers by decreasing modulus; None if the method does not compute them."""


class Equations(Protocol):
    """As many equations as unknowns, for Newton's method."""

    @property
    def tolerance(self) -> float:
        """`Evaluation.error` at or below which the equations count as solved."""

    def evaluate(self, unknowns: Array, *, derivative: bool = True) -> Any:
        """Return the equations, an `Evaluation`, with their Jacobian matrix where `derivative` is true.

        Raises `ConvergenceError` if the equations cannot be evaluated at these unknowns.
        """


class OrbitProblem(Protocol):
    """Periodic orbits of one scene as roots of equations: those of harmonics, or those of a `Signature`."""

    scene: Scene
    periods: int  #: Number of periods of the loads after which an orbit repeats.
    size: int  #: Number n of unknowns.
    #: Positive sizes by which unknowns are divided before they are compared with each other; they need to be right up
    #: to a common factor. A problem without unknowns of different kinds gives ones. Shape (n,).
    scales: Array
    parameters: tuple[float, ...]  #: Values of the parameters at which the problem was built along a branch.

    def from_rest(self) -> Array:
        """Return a first guess of the unknowns without a known orbit, shape (n,)."""

    def from_orbit(self, orbit: Any) -> Array:
        """Return the unknowns of a `PeriodicOrbit` or of the last period of a `Result`, of any method, shape (n,)."""

    def orbit(self, unknowns: Array, evaluation: Any) -> PeriodicOrbit:
        """Return the orbit of a solution of the equations, from the problem's own evaluation there."""

    def shortest_period(self, unknowns: Array, evaluation: Any) -> int:
        """Return after how many periods of the loads a solution first repeats: `periods` or a divisor of it."""
