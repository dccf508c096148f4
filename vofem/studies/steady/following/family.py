"""The equations of orbits by the methods that find them, of one scene and along a parameter."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from vofem.arrays import Array
from vofem.errors import ArgumentError, ConvergenceError, MethodError, VofemError
from vofem.scene import Scene
from vofem.studies.steady.problem import OrbitProblem, Work
from vofem.studies.steady.segments.rebuild import recompiled
from vofem.studies.steady.segments.shooting import Shooting, shooting_refusal

#: Methods that find orbits.
METHODS = ("auto", "shooting", "harmonic_balance")

#: Length of an interval, as a share of its ends, that is rounding.
_ROUNDED = 1e-13

#: Share of a wide interval that counts as much as a value that is less.
_WIDE = 1e-2

#: Step of the parameter by which derivatives are taken: share of the size of changes that matter at so many times the
#: value, and least share of the value.
_DIFFERENCE, _TIMES, _LEAST = 1e-8, 100.0, 1e-9

#: Problems that are kept, by the value of the parameter.
_KEPT = 8


def chosen(scene: Scene, method: str, harmonics: int | None) -> str:
    """Return the method for a scene: shooting if it applies and no number of harmonics is given."""
    if method != "auto":
        return method
    return "harmonic_balance" if harmonics is not None or shooting_refusal(scene) is not None else "shooting"


def problem_of(
    what: str,
    scene: Scene,
    method: str,
    periods: int,
    *,
    period: float | None = None,
    harmonics: int | None = None,
    earlier: Any = None,
    work: Work | None = None,
) -> OrbitProblem:
    """Return the equations of the orbits of a scene by a method other than "auto".

    `what`: name of the function whose argument the scene is, for messages.
    `period`: period of the loads in s.
    `earlier`: a problem of the same method at another value of a parameter. Its unknowns have the same meaning, and its
    data are used again.
    `work`: counters to which the work is added.
    """
    if method == "harmonic_balance":
        # Most users need shooting alone.
        from vofem.studies.steady.harmonic.balance import HarmonicBalance

        try:
            return HarmonicBalance(what, scene, periods, period=period, harmonics=harmonics, earlier=earlier, work=work)
        except MethodError as error:
            reason = shooting_refusal(scene)
            if reason is None:
                raise
            raise MethodError(f"{error}; shooting does not take the scene either: {reason}") from error
    if harmonics is not None:
        raise ArgumentError(f"{what}: harmonics was given, but shooting has none; leave it out")
    return Shooting(what, scene, periods, period=period, earlier=earlier, work=work)


@dataclass(frozen=True)
class Interval:
    """The interval of the parameter along which a branch is followed."""

    start: float
    stop: float

    @property
    def size(self) -> float:
        """Length of the interval."""
        return abs(self.stop - self.start)

    def scale(self, value: float) -> float:
        """Return the size of changes of the parameter that matter at a value: its own, in a wide interval."""
        return min(self.size, max(abs(value), _WIDE * self.size))

    @property
    def way(self) -> float:
        """1 where the parameter grows from start to stop, else -1."""
        return 1.0 if self.stop > self.start else -1.0

    @property
    def empty(self) -> bool:
        """Whether both ends are the same number up to rounding."""
        return self.size <= _ROUNDED * max(abs(self.start), abs(self.stop))

    def beyond(self, value: float) -> float | None:
        """Return the end that a value lies beyond, or None."""
        low, high = min(self.start, self.stop), max(self.start, self.stop)
        return low if value < low else high if value > high else None

    def beside(self, value: float) -> float:
        """Return a value near another one, inside the interval unless that one itself lies outside."""
        step = max(_DIFFERENCE * self.scale(_TIMES * value), _LEAST * abs(value))
        return value - step if value > 0.5 * (self.start + self.stop) else value + step

    def left(self, value: float) -> bool:
        """Return whether a value lies beyond an end by more than rounding."""
        end = self.beyond(value)
        return end is not None and abs(value - end) > _ROUNDED * max(self.size, abs(end))


@dataclass
class Family:
    """The equations of orbits along a parameter; unknowns mean the same at all values."""

    what: str  #: Name of the function whose arguments these are, for messages.
    build: Callable[..., Scene]  #: Returns the scene at a value of each parameter.
    interval: Interval  #: Where the last parameter lies.
    method: str = "auto"  #: "auto" is replaced at the first value.
    periods: int = 1
    harmonics: int | None = None
    work: Work = field(default_factory=Work)
    period: float | None = None  #: Of the loads in s; by default their common one.
    parameters: int = 1  #: Number of parameters.
    _known: dict[tuple[float, ...], OrbitProblem] = field(default_factory=dict)
    _latest: OrbitProblem | None = None

    def of(self, y: Array) -> Any:
        """Return the equations at the parameters of a point, which are the last of its coordinates."""
        return self.at(*y[y.size - self.parameters :].tolist())

    def at(self, *values: float) -> Any:
        """Return the equations at a value of each parameter."""
        values = tuple(map(float, values))
        known = self._known.get(values)
        if known is not None:
            return known
        try:
            scene = self.build(*values)
        except (VofemError, ValueError, ArithmeticError) as error:
            if self.interval.beyond(values[-1]) is None:
                raise
            raise ConvergenceError(f"there is no scene at {values[-1]:.9g}, beyond the interval ({error})") from error
        except TypeError:
            self._refuse_arguments(values)
            raise
        if not isinstance(scene, Scene):
            shown = ", ".join(f"{value:g}" for value in values)
            raise ArgumentError(f"{self.what}: build({shown}) returned {scene!r}, expected a vofem.Scene")
        if self._latest is not None:
            scene = recompiled(scene, self._latest.scene)
        self.method = chosen(scene, self.method, self.harmonics)
        problem = problem_of(
            self.what, scene, self.method, self.periods, period=self.period, harmonics=self.harmonics,
            earlier=self._latest, work=self.work,
        )  # fmt: skip
        while len(self._known) >= _KEPT:
            del self._known[next(iter(self._known))]
        problem.parameters, problem.centred = values, True
        self._known[values] = self._latest = problem
        return problem

    def _refuse_arguments(self, values: tuple[float, ...]) -> None:
        """Raise `ArgumentError` if `build` does not take one number for each parameter."""
        try:
            inspect.signature(self.build).bind(*values)
        except TypeError as error:
            taken = "build(value)" if self.parameters == 1 else "build(value, other)"
            raise ArgumentError(f"{self.what}: expected a function that is called as {taken}: {error}") from None
        except ValueError:
            return  # Some functions of extension modules have no signature.

    def begin_with(self, problem: OrbitProblem, *values: float) -> None:
        """Use a given problem at a value of each parameter. Later problems are derived from it."""
        problem.parameters, problem.centred = tuple(map(float, values)), True
        self._known = {problem.parameters: problem}
        self._latest = problem

    def over(self, periods: int) -> Family:
        """Return the family of orbits over another number of periods, which shares modes but has its own counters."""
        harmonics = None if self.harmonics is None else max(1, self.harmonics * periods // self.periods)
        # Harmonic balance takes as many harmonics for each period of the loads, so its unknowns are others.
        latest = self._latest if self.method == "shooting" or periods == self.periods else None
        return replace(self, periods=periods, harmonics=harmonics, work=Work(), _known={}, _latest=latest)
