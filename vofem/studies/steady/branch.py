"""A branch of periodic orbits along a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.bodies.base import as_point
from vofem.cards import Saved
from vofem.errors import ArgumentError
from vofem.histories import Table
from vofem.histories.table import by_name
from vofem.histories.tables import points_of_interest
from vofem.kernels.choice import by_need
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.special import SpecialPoint


@dataclass
class BranchCounters:
    """Work done for a branch.

    Attributes
    ----------
    points : int
        Orbits of the branch.
    flows : int
        Evaluations of the equations, with their derivatives, for points that were kept. For shooting, one evaluation
        is the motion along the segments of the orbit with the derivatives of its states. Evaluations for derivatives
        with respect to the parameter are not included.
    refinement_flows : int
        The same for special points.
    rejected_flows : int
        The same for steps that were tried and taken back.
    search_flows : int
        The same for the first orbit.
    eigensolves : int
        Full eigenvalue problems of the structure.
    check_flows : int
        Ordinary flows with which orbits are checked: one for most points, from t = 0 of the loads.
    """

    points: int = 0
    flows: int = 0
    refinement_flows: int = 0
    rejected_flows: int = 0
    search_flows: int = 0
    eigensolves: int = 0
    check_flows: int = 0


class Source(Protocol):
    """An object that computes further orbits of a branch."""

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return all orbits at a value of the parameter, computed by Newton's method."""

    def switch(self, special: SpecialPoint) -> Branch:
        """Return the branch that leaves at a special point."""


@dataclass(eq=False, repr=False, kw_only=True)
class Curve(Saved):
    """A curve of orbits that files hold and that notebooks show; see `Branch` and `Locus` for its attributes."""

    _saver = "curve"

    values: Array
    special: list[SpecialPoint]
    counters: BranchCounters
    notes: list[str] = field(default_factory=list)
    interrupted: bool = False

    def _kinds(self) -> str:
        """Return how many special points of each kind there are."""
        kinds = [point.kind for point in self.special]
        return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "nothing special"


@dataclass(eq=False, repr=False, kw_only=True)
class Branch(Curve):
    """A branch of periodic orbits along a parameter.

    Attributes
    ----------
    values : ndarray, shape (n_points,)
        Values of the parameter in the order of the branch. They reverse their direction at folds.
    orbits : sequence of PeriodicOrbit
        The orbits. There is one just before and one just after every grazing.
    special : list of SpecialPoint
        The special points in the order of the branch.
    counters : BranchCounters
    notes : list of str
        Sentences that a user should read, such as why the branch ended.
    periods : int
        Number of periods of the loads after which an orbit repeats.
    interrupted : bool
        Whether Ctrl-C was pressed while the branch was followed; then it may end before its interval does.
    """

    orbits: Sequence[PeriodicOrbit]
    periods: int = 1
    _source: Source | None = None

    def __len__(self) -> int:
        return len(self.orbits)

    def __repr__(self) -> str:
        span = f"{self.values.min():.6g} to {self.values.max():.6g}" if self.values.size else "empty"
        return f"Branch({len(self)} orbits, {span}; {self._kinds()})"

    @property
    def stable(self) -> NDArray[np.object_]:
        """Whether each orbit is stable: True, False, or None where it is not decided; shape (n_points,)."""
        return np.array([orbit.stable for orbit in self.orbits], dtype=object)

    def amplitude(self, point: Any) -> Array:
        """Return the amplitude of every orbit at a point, m, shape (n_points,); see `PeriodicOrbit.amplitude`."""
        return np.array([orbit.amplitude(point) for orbit in self.orbits])

    def table(self, point: Any = None, parameter: str = "parameter") -> Table:
        """Return the orbits as a table, in the order of the branch, with the special points among them.

        The columns are the parameter, the frequency, the displacement of a point, whether the orbit is stable (None
        where it is not decided), the modulus of its largest multiplier (NaN where it is not known), and the kind of a
        special point.

        Parameters
        ----------
        point : point, optional
            The default is the point of the first contact.
        parameter : str
            Name of the first column.

        Raises
        ------
        ArgumentError
            If `parameter` is the name of another column.
        """
        found = [(float(k), float(value), self.orbits[k], "") for k, value in enumerate(self.values)]
        found += [(special.place, special.value, special.orbit, special.kind) for special in self.special]
        found.sort(key=lambda row: row[0])
        orbits = [orbit for _, _, orbit, _ in found]
        scene = orbits[0].scene if orbits else None
        point = points_of_interest(scene)[0] if point is None and scene else point
        place = as_point("table: point", point, scene.bodies if scene else ())
        low, high = np.array([orbit.extremes(place) for orbit in orbits]).reshape(-1, 2).T
        omega = np.array([orbit.omega for orbit in orbits])
        known = (np.nan if one.multipliers is None else np.abs(one.multipliers).max(initial=0.0) for one in orbits)
        columns: dict[str, tuple[Any, str]] = {
            "frequency": (omega / (2.0 * np.pi), "Hz"),
            "angular frequency": (omega, "rad/s"),
            f"{place.name} amplitude": (0.5 * (high - low), "m"),
            f"{place.name} least": (low, "m"),
            f"{place.name} largest": (high, "m"),
            "stable": (np.array([orbit.stable for orbit in orbits], dtype=object), ""),
            "largest multiplier": (np.array(list(known), dtype=float), ""),
            "special": (np.array([kind for _, _, _, kind in found], dtype=str), ""),
        }
        values = np.array([value for _, value, _, _ in found]), ""
        return Table(by_name("table: parameter", [(parameter, values), *columns.items()]), "Branch", tuple(self.notes))

    def to_dataframe(self, point: Any = None, parameter: str = "parameter") -> Any:
        """Return `table` as a `pandas.DataFrame`."""
        return self.table(point, parameter).to_dataframe()

    @property
    def omega(self) -> Array:
        """Angular frequency of the loads, or of free oscillations, rad/s, shape (n_points,)."""
        return np.array([orbit.omega for orbit in self.orbits])

    @property
    def energy(self) -> Array:
        """Energy of the free oscillations of a backbone, J, shape (n_points,).

        Raises
        ------
        ArgumentError
            If the orbits are forced, because the energy of a forced orbit changes in time.
        """
        self._free("energy")
        return self.values

    def q0(self, point: Any) -> Array:
        """Return the displacement of a point when the motion comes to rest farthest from the stops, m, (n_points,).

        Raises
        ------
        ArgumentError
            If the orbits are forced.
        """
        self._free("q0")
        return np.array([orbit.start_of(point) for orbit in self.orbits])

    def _free(self, what: str) -> None:
        if not all(orbit.autonomous for orbit in self.orbits):
            raise ArgumentError(
                f"{what} is told of free oscillations, those of vofem.backbone; these orbits are forced"
            )

    @one_thread
    @by_need("steady states", small=False)
    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return all orbits of the branch at exactly this value of the parameter, in the order of the branch.

        A branch with folds has several orbits at one value. Each orbit is computed by Newton's method from its stored
        neighbours and not interpolated. There is no orbit outside the branch.

        A file holds the scenes of the orbits instead of a function that builds scenes. Numbers that change from one
        scene to the next are therefore read as polynomials in the parameter, if they are that to rounding.

        Raises
        ------
        ArgumentError
            If the branch is a backbone. If it was loaded from a file whose scenes depend on the parameter in another
            way.
        ConvergenceError
            If the branch was loaded, and an orbit is not found from its neighbours.
        """
        return self._finder("at").at(number("at: value", value))

    @one_thread
    @by_need("steady states", small=False)
    def switch(self, special: SpecialPoint) -> Branch:
        """Return the branch that leaves at a special point.

        At a period doubling this is the branch of orbits that take twice as many periods. At a branch point it is the
        other branch through the point. It begins at the special point and is followed within the interval of this
        branch, with the same `max_step`, `max_points` and `max_seconds`.

        Parameters
        ----------
        special : SpecialPoint
            One of `special`, of kind "period_doubling" or "branch_point".

        Raises
        ------
        ArgumentError
            If the point is of another kind, where no branch of periodic orbits leaves, or if this branch was loaded
            from a file.
        ConvergenceError
            If no orbit of the other branch is found near the point.
        """
        if not isinstance(special, SpecialPoint):
            raise ArgumentError(f"switch: special is {special!r}, expected an entry of branch.special")
        if special.kind not in ("period_doubling", "branch_point"):
            raise ArgumentError(
                f"switch: at a {special.kind} no other branch of periodic orbits leaves; expected a period_doubling or "
                "a branch_point"
            )
        return self._finder("switch").switch(special)

    def _finder(self, what: str) -> Source:
        if self._source is None:
            raise ArgumentError(f"{what}: a backbone has no parameter of scenes; ask vofem.backbone for other levels")
        return self._source
