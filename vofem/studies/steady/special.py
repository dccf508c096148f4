"""Points of a branch where its orbits change in kind."""

from __future__ import annotations

from dataclasses import dataclass

from vofem.studies.steady.orbit import PeriodicOrbit

#: Kinds of special points.
KINDS = ("fold", "period_doubling", "neimark_sacker", "grazing", "branch_point")


@dataclass(frozen=True)
class SpecialPoint:
    """A point of a branch where its orbits change in kind.

    Attributes
    ----------
    kind : str
        "fold": a multiplier is 1 and the branch turns smoothly in its parameter. "branch_point": a multiplier passes 1
        and the branch does not turn. "period_doubling": a multiplier passes -1. "neimark_sacker": a pair of complex
        multipliers crosses the unit circle. "grazing": a local extremum of a gap function touches zero, whether or not
        the branch turns there.
    value : float
        Of the branch's parameter.
    orbit : PeriodicOrbit
    contact : str
        Name of the contact that grazes; empty for other kinds.
    place : float
        Where the point lies on the branch: the number of the orbit before it, and the fraction of the way to the next.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit
    contact: str = ""
    place: float = 0.0
