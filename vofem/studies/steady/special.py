"""Points of a branch where its orbits change in kind."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan
from typing import Any

from vofem.studies.steady.orbit import PeriodicOrbit

#: Kinds of special points that have loci.
KINDS = ("fold", "period_doubling", "neimark_sacker", "grazing", "branch_point")


@dataclass(frozen=True, repr=False)
class SpecialPoint:
    """A point of a branch where its orbits change in kind.

    Attributes
    ----------
    kind : str
        "fold": a multiplier is 1 and the branch turns smoothly in its parameter. "branch_point": a multiplier passes 1
        and the branch does not turn, or the branch comes back along mirrored orbits. "period_doubling": a multiplier
        passes -1. "neimark_sacker": a pair of complex multipliers crosses the unit circle. "grazing": a local extremum
        of a gap function touches zero, whether or not the branch turns there. "sticking": a stop of a slider begins
        or ends, where it turns or on its way, or a motion while it sticks.
    value : float
        Value of the branch's parameter at the point.
    orbit : PeriodicOrbit
    contact : str
        Name of the contact that grazes, or of the friction that sticks; empty for other kinds.
    place : float
        Position of the point on the branch: the number of the orbit before it, plus the fraction of the way to the next
        orbit.
    other : float
        Value of the second parameter on a `Locus`; NaN on a branch.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit
    contact: str = ""
    place: float = 0.0
    other: float = float("nan")
    #: The `Point` of the continuation; None for points from a file.
    point: Any = field(default=None, compare=False)

    def __repr__(self) -> str:
        kind = f"{self.kind} of {self.contact!r}" if self.contact else self.kind
        other = "" if isnan(self.other) else f", {self.other:.12g}"
        return f"SpecialPoint({kind} at {self.value:.12g}{other}, {self.orbit!r})"


def special_at(kind: str, point: Any, place: float, contact: str = "") -> SpecialPoint:
    """Return a point of a branch or locus as a special point."""
    value, other = (*point.problem.parameters, float("nan"))[:2]
    return SpecialPoint(kind, value, point.orbit(), contact, place, other, point)
