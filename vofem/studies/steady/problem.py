"""The interface of methods for periodic orbits, so that one code follows branches with all methods.

A method (shooting, harmonic balance) describes the orbits of one scene as the
roots of as many equations as unknowns: `OrbitProblem`. An evaluation of these
equations has a `residual` (n,), its derivative `jacobian` (n, n) where it was
requested, the size `error` of the residual over that of the motion, and Floquet
`multipliers`, None if they are not known. A branch needs the same problem at
other values of a parameter: `family.Family`. Derivatives with respect to the
parameter are taken by differences of residuals, so that a scene may depend on it
in any way.
"""

from __future__ import annotations

import contextlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.scene import Scene
from vofem.studies.steady.loads import LoadPeriod, load_period
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.system import Counters, System


class OutOfTime(Exception):  # noqa: N818 (no error: what was found is returned)
    """The time is over that was given for a search, or Ctrl-C was pressed."""


def _never() -> bool:
    return False


@dataclass
class Work:
    """Work done to find orbits."""

    #: Evaluations of the equations; with segments as unknowns those with derivatives, which take most of the time.
    flows: int = 0
    checks: int = 0  #: Flows over orbits that are known, with which these are checked.
    runs: Counters = field(default_factory=Counters)  #: Work of these evaluations.
    until: float = np.inf  #: When the time is over, by `time.monotonic`.
    pressed: Callable[[], bool] = _never  #: Whether Ctrl-C was pressed.

    @contextlib.contextmanager
    def within(self, seconds: float | None, pressed: Callable[[], bool] | None = None) -> Iterator[None]:
        """Limit the time for what follows, if a number of seconds is given; a limit around this one holds too.

        `pressed`: whether Ctrl-C was pressed, which ends the time.
        """
        outer = self.until, self.pressed
        self.until = self.until if seconds is None else min(self.until, time.monotonic() + seconds)
        self.pressed = pressed or self.pressed
        try:
            yield
        finally:
            self.until, self.pressed = outer

    def begin(self) -> None:
        """Raise `OutOfTime` if the time is over; every evaluation and every run begins with this."""
        if time.monotonic() > self.until or self.pressed():
            raise OutOfTime


#: Relative change of a solution below which it repeats before its end.
_REPEATS = 1e-7


class OrbitProblem(ABC):
    """Periodic orbits of one scene as roots of equations: those of harmonics, or those of a `Signature`.

    `what`: name of the function whose argument the scene is, for messages.
    `system`: that of the scene, as the method takes it.
    `periods`: number of periods of the loads after which an orbit repeats.
    `period`: period of the loads in s; by default their common one.
    `work`: counters to which the work is added.
    """

    size: int  #: Number n of unknowns.
    parameters: tuple[float, ...] = ()  #: Values of the parameters at which the problem was built along a branch.
    #: Whether sliders that stick all along rest in the middle of where they may, as on branches; else where they are.
    centred = False
    least: float = 0.0  #: Least size of displacements to which changes are compared; 0 where motions tell it.

    def __init__(
        self, what: str, scene: Scene, system: System, periods: int, period: float | None, work: Work | None
    ) -> None:
        self.what, self.scene, self.periods, self.period = what, scene, periods, period
        self.loads: LoadPeriod = load_period(what, system, period)
        self.work = Work() if work is None else work

    @abstractmethod
    def from_rest(self) -> Array:
        """Return a first guess of the unknowns without a known orbit, shape (n,)."""

    @abstractmethod
    def from_orbit(self, orbit: Any) -> Array:
        """Return the unknowns of a `PeriodicOrbit` or of the last period of a `Result`, of any method, shape (n,)."""

    @abstractmethod
    def orbit(self, unknowns: Array, evaluation: Any) -> PeriodicOrbit:
        """Return the orbit of a solution of the equations, from the problem's own evaluation there."""

    @abstractmethod
    def change_after(self, count: int, unknowns: Array, evaluation: Any) -> float:
        """Return by how much a solution changes in so many periods of the loads, over the size of the motion."""

    def shortest_period(self, unknowns: Array, evaluation: Any) -> int:
        """Return after how many periods of the loads a solution first repeats: `periods` or a divisor of it."""
        divisors = [count for count in range(1, self.periods) if not self.periods % count]
        repeats = (count for count in divisors if self.change_after(count, unknowns, evaluation) <= _REPEATS)
        return next(repeats, self.periods)
