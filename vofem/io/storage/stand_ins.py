"""Substitutes in a loaded run for Python functions, which files cannot hold.

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
from vofem.bodies.base import Point
from vofem.errors import MissingCallableError
from vofem.laws import SmoothLaws
from vofem.time_functions import Piece, TimeFunction

Array = NDArray[np.float64]


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
        Name with the class of the effect.
    """

    name: str
    functions: str
    u: Array
    forces: Array
    energies: Array
    shown: str

    @property
    def monotone(self) -> bool:
        """False, because nothing is known of the spring between its stored elongations."""
        return False

    @property
    def label(self) -> str:
        """Name with the class of the effect."""
        return self.shown

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
