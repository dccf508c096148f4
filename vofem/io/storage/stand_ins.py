"""What stands in a loaded run for Python callables, which no file holds.

Each knows the values that the run itself took, and answers with them. What
would need the callable itself raises `MissingCallableError`, which names it.
All of them are plain data, so that a loaded run can be saved again.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.effects.time_functions import Piece, TimeFunction
from vofem.errors import ArgumentError, MissingCallableError
from vofem.laws import SmoothLaws

Array = NDArray[np.float64]


def name_of(function: Any) -> str:
    """Return how messages call a callable: its name, and where a lambda stands."""
    name = str(getattr(function, "__name__", None) or type(function).__qualname__)
    code = getattr(function, "__code__", None)
    if name != "<lambda>" or code is None:
        return name
    return f"{name} in {os.path.basename(code.co_filename)}, line {code.co_firstlineno}"


def missing(what: str, name: str, cure: str) -> MissingCallableError:
    """Return the error of something that needs a callable."""
    return MissingCallableError(f"{what} needs the callable {name!r}, which the saved run does not hold; {cure}")


@dataclass(frozen=True, eq=False)
class StoredFunction(TimeFunction):
    """A load's function of time of which the values at the run's times are known.

    Attributes
    ----------
    name : str
    shown : str
        What the function's repr was.
    t, values : ndarray, shape (n_times,)
        In s and in the unit of the load; without equal times.
    """

    name: str
    shown: str
    t: Array
    values: Array

    closed_form = False

    @classmethod
    def of(cls, function: Any, times: Array) -> StoredFunction:
        """Return what stands for a function that is called as the run would call it."""
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
        """Refuse."""
        raise self._missing("the derivative of a load")

    def piece(self, t0: float) -> Piece:
        """Refuse."""
        raise self._missing("the closed form of a load")

    def _missing(self, what: str) -> MissingCallableError:
        return missing(what, self.name, "its values are known at the run's `times` only; build the scene in Python")


@dataclass(frozen=True, eq=False)
class StoredLaw:
    """A nonlinear spring's law of which the values at the run's times are known.

    Attributes
    ----------
    name : str
        Of the spring.
    functions : str
        Names of its potential and its force.
    u : ndarray, shape (k,)
        Elongations in m, ascending.
    forces, energies : ndarray, shape (k,)
        In N and J.
    """

    name: str
    functions: str
    u: Array
    forces: Array
    energies: Array

    @property
    def monotone(self) -> bool:
        """Nothing is known of the spring between its stored elongations."""
        return False

    @property
    def label(self) -> str:
        """Name with the class of the effect."""
        return f"NonlinearSpring {self.name!r}"

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
        """Refuse."""
        raise self._missing("its tangent")

    def _place(self, u: float) -> int:
        place = min(int(np.searchsorted(self.u, u)), self.u.size - 1)
        if self.u[place] != u:
            raise self._missing(f"its force at an elongation of {u:g} m")
        return place

    def _missing(self, what: str) -> MissingCallableError:
        cure = "the law is known at the run's `times` only; build the scene in Python"
        return missing(f"NonlinearSpring {self.name!r}: {what}", self.functions, cure)


@dataclass(frozen=True, eq=False)
class StoredCallable:
    """A callable of which nothing but its name is known."""

    name: str

    def __call__(self, *_arguments: Any) -> Any:
        """Refuse."""
        raise missing("this", self.name, "build the scene in Python")


@dataclass(frozen=True, eq=False)
class StoredEffect:
    """An effect that can be shown and asked for its points, and not be built into another scene.

    Attributes
    ----------
    kind : str
        Name of its class.
    shown : str
        What its `describe` said.
    touched : tuple of points
    callables : str
        Names of what it needs.
    """

    kind: str
    shown: str
    touched: tuple[Point, ...]
    callables: str

    def points(self) -> tuple[Point, ...]:
        """Return the points that it touches."""
        return self.touched

    def compile(self, builder: SystemBuilder) -> None:
        """Refuse."""
        raise missing(self.shown, self.callables, "build this effect in Python")

    def describe(self) -> str:
        """Return what the effect said."""
        return self.shown


@dataclass(frozen=True, eq=False)
class StoredState:
    """The state at t = 0 of a saved run, as the degrees of freedom of every body; starts a scene like an outcome.

    Attributes
    ----------
    states : dict of str to (ndarray, ndarray)
        Degrees of freedom and rates by the name of the body, each (size,).
    springs : dict of str to ndarray
        States of springs with memory by name.
    """

    states: dict[str, tuple[Array, Array]]
    springs: dict[str, Array]

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return a body's degrees of freedom and their rates, each (size,)."""
        if body_name not in self.states:
            raise ArgumentError(f"the saved state holds no body {body_name!r}; there are {list(self.states)}")
        return self.states[body_name]

    def spring_state(self, name: str) -> Array | None:
        """Return the state of a spring with memory, or None."""
        return self.springs.get(name)
