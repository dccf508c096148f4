"""A branch of periodic orbits along a parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.scene import Scene
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.special import SpecialPoint

Array = NDArray[np.float64]


@dataclass
class BranchCounters:
    """Work done for a branch.

    Attributes
    ----------
    points : int
        Orbits of the branch.
    flows : int
        Evaluations of the equations for points that were kept: of shooting, one flow over the orbit with its
        monodromy. Evaluations for derivatives with respect to the parameter count.
    refinement_flows : int
        The same for special points.
    rejected_flows : int
        The same for steps that were tried and taken back.
    eigensolves : int
        Full eigenvalue problems of the structure.
    """

    points: int = 0
    flows: int = 0
    refinement_flows: int = 0
    rejected_flows: int = 0
    eigensolves: int = 0


class Branch:
    """A branch of periodic orbits along a parameter.

    Attributes
    ----------
    values : ndarray, shape (n_points,)
        The parameter, in the order of the branch; it goes back and forth at folds.
    orbits : sequence of PeriodicOrbit
    special : list of SpecialPoint
        In the order of the branch.
    counters : BranchCounters
    notes : list of str
        What a user should know, such as why the branch ended.
    periods : int
        Periods of the loads that an orbit takes.
    """

    def __init__(
        self,
        values: Array,
        orbits: Sequence[PeriodicOrbit],
        special: Sequence[SpecialPoint],
        counters: BranchCounters,
        *,
        notes: Sequence[str] = (),
        periods: int = 1,
        build: Callable[[float], Scene] | None = None,
    ) -> None:
        self.values = np.asarray(values, dtype=float)
        self.orbits = orbits
        self.special = list(special)
        self.counters = counters
        self.notes = list(notes)
        self.periods = periods
        self._build = build

    def __len__(self) -> int:
        return len(self.orbits)

    def __repr__(self) -> str:
        kinds = {kind: sum(point.kind == kind for point in self.special) for kind in {p.kind for p in self.special}}
        shown = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        span = f"{self.values.min():.6g} to {self.values.max():.6g}" if self.values.size else "empty"
        return f"Branch({len(self)} orbits, {span}; {shown or 'nothing special'})"

    @property
    def stable(self) -> NDArray[np.object_]:
        """Whether each orbit is stable: True, False, or None where it is not decided; shape (n_points,)."""
        return np.array([orbit.stable for orbit in self.orbits], dtype=object)

    def amplitude(self, point: Any) -> Array:
        """Return the amplitude of every orbit at a point, m, shape (n_points,); see `PeriodicOrbit.amplitude`."""
        return np.array([orbit.amplitude(point) for orbit in self.orbits])
