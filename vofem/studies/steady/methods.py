"""The methods that find orbits, by name."""

from __future__ import annotations

from typing import Any

from vofem.errors import ArgumentError
from vofem.scene import Scene
from vofem.studies.steady.counters import Work
from vofem.studies.steady.problem import OrbitProblem
from vofem.studies.steady.shooting import Shooting, shooting_refusal

#: Methods that find orbits.
METHODS = ("auto", "shooting", "harmonic_balance")


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
        from vofem.studies.steady.harmonic_balance import HarmonicBalance

        return HarmonicBalance(what, scene, periods, period=period, harmonics=harmonics, earlier=earlier, work=work)
    if harmonics is not None:
        raise ArgumentError(f"{what}: harmonics was given, but shooting has none; leave it out")
    return Shooting(what, scene, periods, period=period, earlier=earlier, work=work)
