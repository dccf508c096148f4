"""The equations of orbits along a parameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from vofem.errors import ArgumentError
from vofem.scene import Scene
from vofem.studies.steady.counters import Work
from vofem.studies.steady.methods import chosen, problem_of
from vofem.studies.steady.problem import OrbitProblem
from vofem.studies.steady.rebuild import recompiled

#: Problems that are kept, by the value of the parameter.
_KEPT = 8


@dataclass
class Family:
    """The equations of orbits along a parameter; unknowns mean the same at all values.

    Attributes
    ----------
    what : str
        Name of the function whose arguments these are, for messages.
    build : callable
        Returns the scene at a value.
    method : str
        "auto" is replaced at the first value.
    periods : int
    harmonics : int, optional
    work : Work
    """

    what: str
    build: Callable[[float], Scene]
    method: str = "auto"
    periods: int = 1
    harmonics: int | None = None
    work: Work = field(default_factory=Work)
    _known: dict[float, OrbitProblem] = field(default_factory=dict)
    _latest: OrbitProblem | None = None

    def at(self, value: float) -> Any:
        """Return the equations at a value of the parameter."""
        value = float(value)
        known = self._known.get(value)
        if known is not None:
            return known
        scene = self.build(value)
        if not isinstance(scene, Scene):
            raise ArgumentError(f"{self.what}: build({value:g}) returned {scene!r}, expected a vofem.Scene")
        if self._latest is not None:
            scene = recompiled(scene, self._latest.scene)
        self.method = chosen(scene, self.method, self.harmonics)
        problem = problem_of(
            self.what, scene, self.method, self.periods, harmonics=self.harmonics, earlier=self._latest, work=self.work
        )
        while len(self._known) >= _KEPT:
            del self._known[next(iter(self._known))]
        self._known[value] = self._latest = problem
        return problem

    def begin_with(self, value: float, problem: OrbitProblem) -> None:
        """Use a given problem at a value of the parameter. Later problems are derived from it."""
        self._known = {float(value): problem}
        self._latest = problem

    def over(self, periods: int) -> Family:
        """Return the family of orbits over another number of periods, which shares modes but has its own counters."""
        other = Family(self.what, self.build, self.method, periods, self.harmonics)
        other._latest = self._latest
        return other
