"""Substitutes in a loaded run for Python functions and for bodies of other packages, which files cannot hold.

Each substitute holds the values that the run used, and returns them. If another
value is needed, it raises `MissingCallableError`, which names the function. The
substitutes are plain data, so that a loaded run can be saved again.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.assembly import SystemBuilder
from vofem.bodies.base import (
    BaseBody,
    BodyMatrices,
    DegreesOfFreedom,
    IntArray,
    Point,
    Row,
    Shape,
    ShapePoint,
    place_of,
)
from vofem.errors import ArgumentError, MissingCallableError, VofemError
from vofem.initial import StoredState
from vofem.laws import SmoothLaws
from vofem.time_functions import Piece, TimeFunction

Array = NDArray[np.float64]

# Files of earlier versions name `StoredState` in this module.
__all__ = ["StoredCallable", "StoredEffect", "StoredFunction", "StoredLaw", "StoredState", "missing", "name_of"]


def name_of(function: Any) -> str:
    """Return the name of a function for messages; for a lambda also its place in the source."""
    name = str(getattr(function, "__name__", None) or type(function).__qualname__)
    code = getattr(function, "__code__", None)
    if name != "<lambda>" or code is None:
        return name
    return f"{name} in {os.path.basename(code.co_filename)}, line {code.co_firstlineno}"


def missing(what: str, name: str, cure: str) -> MissingCallableError:
    """Return the error for a value that only the original function could give."""
    return MissingCallableError(f"{what} needs the callable {name!r}, which the saved run does not hold; {cure}")


@dataclass(frozen=True, eq=False)
class StoredFunction(TimeFunction):
    """A load's function of time, known by its values at the times of the run.

    Attributes
    ----------
    name : str
    shown : str
        The repr of the original function.
    t, values : ndarray, shape (n_times,)
        Times in s, all different, and values in the unit of the load.
    """

    name: str
    shown: str
    t: Array
    values: Array

    closed_form = False

    @classmethod
    def of(cls, function: Any, times: Array) -> StoredFunction:
        """Return the substitute for a function, with values at the times at which the run uses it."""
        t = np.unique(times)
        inner = getattr(function, "function", None)
        name = name_of(inner) if callable(inner) else type(function).__qualname__
        return cls(name, repr(function), t, np.array(function(t), dtype=float))

    def __repr__(self) -> str:
        return self.shown

    def __eq__(self, other: object) -> bool:
        """Compare by name and values: bodies on one base share its motion."""
        if not isinstance(other, StoredFunction) or (self.name, self.shown) != (other.name, other.shown):
            return False
        return np.array_equal(self.t, other.t) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return hash((self.name, self.shown))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at stored times; any other time raises `MissingCallableError`."""
        wanted = np.asarray(t, dtype=float)
        place = np.clip(np.searchsorted(self.t, wanted), 0, self.t.size - 1)
        unknown = self.t[place] != wanted
        if np.any(unknown):
            raise self._missing(f"the load at t = {np.atleast_1d(wanted)[np.atleast_1d(unknown)][0]:g} s")
        return self.values[place]

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Raise `MissingCallableError`."""
        raise self._missing("the derivative of a load")

    def piece(self, t0: float) -> Piece:
        """Raise `MissingCallableError`."""
        raise self._missing("the closed form of a load")

    def _missing(self, what: str) -> MissingCallableError:
        return missing(what, self.name, "its values are known at the run's `times` only; build the scene in Python")


@dataclass(frozen=True, eq=False)
class StoredLaw:
    """A law written in Python, such as that of a nonlinear spring, known by its values at the times of the run.

    Attributes
    ----------
    name : str
        Name of the spring.
    functions : str
        Names of its functions, or of its class.
    u : ndarray, shape (k,)
        Elongations in m, ascending.
    forces, energies : ndarray, shape (k,)
        Forces in N and energies in J.
    shown : str
        Name with the class of the effect; empty in files of earlier versions, which hold nonlinear springs only.
    """

    name: str
    functions: str
    u: Array
    forces: Array
    energies: Array
    shown: str = ""

    @property
    def monotone(self) -> bool:
        """False, because nothing is known of the spring between its stored elongations."""
        return False

    @property
    def label(self) -> str:
        """Name with the class of the effect."""
        return self.shown or f"NonlinearSpring {self.name!r}"

    @property
    def group(self) -> type[SmoothLaws]:
        """The group that gathers laws of this kind."""
        return SmoothLaws

    def reaction(self, u: float) -> float:
        """Return R(u) in N at a stored elongation."""
        return float(self.forces[self._place(u)])

    def energy(self, u: float) -> float:
        """Return V(u) in J at a stored elongation."""
        return float(self.energies[self._place(u)])

    def potential(self, u: float) -> float:
        """Return V(u) in J at a stored elongation."""
        return self.energy(u)

    def force(self, u: float) -> float:
        """Return R(u) in N at a stored elongation."""
        return self.reaction(u)

    def tangent(self, u: float, step: float = 1e-6) -> float:
        """Raise `MissingCallableError`."""
        raise self._missing("its tangent")

    def _place(self, u: float) -> int:
        place = min(int(np.searchsorted(self.u, u)), self.u.size - 1)
        if self.u[place] != u:
            raise self._missing(f"its force at an elongation of {u:g} m")
        return place

    def _missing(self, what: str) -> MissingCallableError:
        cure = "the law is known at the run's `times` only; build the scene in Python"
        return missing(f"{self.label}: {what}", self.functions, cure)


@dataclass(frozen=True, eq=False)
class StoredCallable:
    """A Python function of which only the name is known."""

    name: str

    def __call__(self, *_arguments: Any) -> Any:
        """Raise `MissingCallableError`."""
        raise missing("this", self.name, "build the scene in Python")


@dataclass(frozen=True, eq=False)
class StoredEffect:
    """An effect that can be shown and has points, but cannot be part of another scene.

    Attributes
    ----------
    kind : str
        Name of its class.
    shown : str
        Its description.
    touched : tuple of points
    callables : str
        Names of the Python functions that it needs.
    name : str
        Its name; empty if it has none.
    of : str
        "displacement" or "rotation", on which it acts.
    """

    kind: str
    shown: str
    touched: tuple[Point, ...]
    callables: str
    name: str = ""
    of: str = "displacement"

    def points(self) -> tuple[Point, ...]:
        """Return its points."""
        return self.touched

    def compile(self, builder: SystemBuilder) -> None:
        """Raise `MissingCallableError`."""
        raise missing(self.shown, self.callables, "build this effect in Python")

    def describe(self) -> str:
        """Return its description."""
        return self.shown


@dataclass(frozen=True, eq=False)
class StoredBody(BaseBody):
    """A body of a class of another package, stored by its numbers. It can be simulated again.

    Attributes
    ----------
    name, kind, shown_label, shown : str
        Name, name of its class, and what `label` and `summary` said.
    known : DegreesOfFreedom
    parts : BodyMatrices
    strains : csr_matrix or ndarray, optional
    drawn : Shape
    quantities : dict of str to matrix
        Its `sections`.
    upward, rigid : ndarray
        Its `translation` and `rigid_motions`.
    """

    name: str
    kind: str
    shown_label: str
    shown: str
    known: DegreesOfFreedom
    parts: BodyMatrices
    strains: Any
    drawn: Shape
    quantities: dict[str, Any]
    upward: Array
    rigid: Array

    @classmethod
    def of(cls, body: Any) -> StoredBody:
        """Return the substitute for a body."""
        shape = body.shape
        return cls(
            body.name, type(body).__name__, body.label, body.summary(), body.degrees_of_freedom, body.matrices(),
            body.strain_rows(), shape, dict(body.sections()), body.translation(), body.rigid_motions(),
        )  # fmt: skip

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return int(self.known.x.size)

    @property
    def degrees_of_freedom(self) -> DegreesOfFreedom:
        """Place and kind of every degree of freedom."""
        return self.known

    @property
    def shape(self) -> Shape:
        """How the body lies and moves."""
        return self.drawn

    @property
    def label(self) -> str:
        """Kind and name of the body that was saved."""
        return self.shown_label

    def summary(self) -> str:
        """Return the line that the saved body gave for `explain`."""
        return self.shown

    def matrices(self) -> BodyMatrices:
        """Return mass, stiffness, damping and supports."""
        return self.parts

    def strain_rows(self) -> Any:
        """Return D with ``K = D'D``, or None."""
        return self.strains

    def sections(self) -> dict[str, Any]:
        """Return what else is known along the shape."""
        return self.quantities

    def translation(self) -> Array:
        """Return the unit displacement upward."""
        return self.upward

    def rigid_motions(self) -> Array:
        """Return the motions without strain."""
        return self.rigid

    def interpolate(self, field: Any, what: str) -> Array:
        """Refuse: only the class of the body knows how."""
        raise missing(f"{what} of {self.label}", self.kind, "start from an outcome, or build the scene in Python")

    def at(self, where: float | str) -> ShapePoint:
        """Return a point at a place of the shape; others are known to the class of the body only."""
        point = super().at(where)
        if not np.any(np.isclose(self.shape.x, point.x, rtol=1e-9, atol=1e-12)):
            raise missing(
                f"{self.label} at x = {point.x:g} m", self.kind, "give a point of the body that was simulated"
            )
        return point

    def resolve(self, point: Point) -> Row:
        """Return the row of a point of the body that was simulated, or of one at a place of the shape."""
        return point.row() if point.body.size == self.size else super().resolve(point)


@dataclass(frozen=True, eq=False)
class StoredPoint:
    """A point of a class that no file can name, by its rows.

    Attributes
    ----------
    body : Body
    name, shown : str
        Its name, and what `describe` said.
    x : float
        Place on the axis of the body, m.
    indices, weights : ndarray
        Entries of the row of its displacement.
    slope : tuple of ndarray, optional
        Indices and weights of the row of its slope.
    """

    body: Any
    name: str
    shown: str
    x: float
    indices: IntArray
    weights: Array
    slope: tuple[IntArray, Array] | None

    @classmethod
    def of(cls, point: Any) -> StoredPoint:
        """Return the substitute for a point."""
        row = point.row()
        try:
            turned = point.slope_row()
        except VofemError:
            turned = None
        slope = None if turned is None else (turned.indices, turned.weights)
        x = place_of(point)
        return cls(point.body, point.name, point.describe(), x, row.indices, row.weights, slope)

    def row(self) -> Row:
        """Return the row of the displacement."""
        return Row(self.indices, self.weights)

    def slope_row(self) -> Row:
        """Return the row of the slope."""
        if self.slope is None:
            raise ArgumentError(f"{self.shown} has no rotation")
        return Row(*self.slope)

    def describe(self) -> str:
        """Return the description of the saved point."""
        return self.shown
