"""What stands in a loaded run for Python callables, which no file holds.

Each knows the values that the run itself took, and answers with them. What
would need the callable itself raises `MissingCallableError`, which names it.
All of them are plain data, so that a loaded run can be saved again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.bodies.beam import Beam
from vofem.bodies.coefficient import evaluate_along
from vofem.effects.time_functions import Piece, TimeFunction
from vofem.errors import ArgumentError, MissingCallableError

Array = NDArray[np.float64]

#: Values per element of a function of x.
_PER_ELEMENT = 20

#: Up to here, relative to the largest value, the polynomials of a function of x count as the function itself.
_FAITHFUL = 1e-10


def name_of(function: Any) -> str:
    """Return how messages call a callable."""
    return str(getattr(function, "__qualname__", None) or getattr(function, "__name__", None) or repr(function))


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
        same = isinstance(other, StoredFunction) and (self.name, self.shown) == (other.name, other.shown)
        return same and np.array_equal(self.t, other.t) and np.array_equal(self.values, other.values)

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
class StoredField:
    """A function of x along a beam, known as a polynomial on every element, and by its values at the nodes.

    Attributes
    ----------
    name : str
    nodes : ndarray, shape (n_elements + 1,)
        In m.
    values : ndarray, shape (n_elements, n_points)
        At Chebyshev points inside every element, from the left.
    at_nodes : ndarray, shape (n_elements + 1,)
    error : float
        The largest deviation found when it was stored, over the largest value.
    """

    name: str
    nodes: Array
    values: Array
    at_nodes: Array
    error: float

    @classmethod
    def of(cls, function: Callable[[Array], Any], beam: Beam) -> StoredField:
        """Return what stands for a callable of x; how faithful it is, is tried at other points."""
        nodes = beam.nodes
        widths = np.diff(nodes)[:, None]

        def sampled(xi: Array) -> Array:
            return evaluated(nodes[:-1, None] + xi * widths)

        def evaluated(x: Array) -> Array:
            return np.array(evaluate_along(f"{name_of(function)!r} along {beam.label}", function, x))

        made = cls(name_of(function), nodes, sampled(_chebyshev(_PER_ELEMENT)), evaluated(nodes), 0.0)
        trial = _chebyshev(2 * _PER_ELEMENT + 3)
        true = sampled(trial)
        found = made._interpolated(np.repeat(np.arange(widths.size), trial.size), np.tile(trial, widths.size))
        scale = float(np.max(np.abs(true), initial=0.0))
        error = float(np.max(np.abs(found - true.ravel()), initial=0.0)) / scale if scale > 0.0 else 0.0
        return cls(made.name, nodes, made.values, made.at_nodes, error)

    def __call__(self, x: ArrayLike) -> Array:
        """Return the values at x; raises `MissingCallableError` between nodes where polynomials are no good."""
        x = np.asarray(x, dtype=float)
        flat = x.ravel()
        nearest = np.clip(np.searchsorted(self.nodes, flat), 0, self.nodes.size - 1)
        result = self.at_nodes[nearest]
        inside = self.nodes[nearest] != flat
        if np.any(inside):
            if not self.error <= _FAITHFUL:
                raise missing(
                    f"a value at x = {flat[inside][0]:g} m", self.name, "it is not smooth enough between nodes to be "
                    "known by its values; put nodes where it jumps before saving, or build the beam in Python",
                )  # fmt: skip
            element = np.clip(np.searchsorted(self.nodes, flat[inside], side="right") - 1, 0, self.nodes.size - 2)
            xi = (flat[inside] - self.nodes[element]) / (self.nodes[element + 1] - self.nodes[element])
            result[inside] = self._interpolated(element, xi)
        return result.reshape(x.shape)

    def _interpolated(self, element: NDArray[np.int64], xi: Array) -> Array:
        """Return the barycentric interpolant of each element, in memory that does not grow with the product."""
        points = _chebyshev(self.values.shape[1])
        weights = np.sin(np.pi * (np.arange(points.size) + 0.5) / points.size) * (-1.0) ** np.arange(points.size)
        above, below = np.zeros(xi.size), np.zeros(xi.size)
        exact = np.full(xi.size, np.nan)
        for k, point in enumerate(points):
            distance = xi - point
            hit = distance == 0.0
            exact[hit] = self.values[element[hit], k]
            share = weights[k] / np.where(hit, 1.0, distance)
            above += share * self.values[element, k]
            below += share
        return np.where(np.isnan(exact), above / below, exact)


def _chebyshev(count: int) -> Array:
    """Return the Chebyshev points of the first kind on (0, 1), ascending."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count), dtype=float)


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
    """

    states: dict[str, tuple[Array, Array]]

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return a body's degrees of freedom and their rates, each (size,)."""
        if body_name not in self.states:
            raise ArgumentError(f"the saved state holds no body {body_name!r}; there are {list(self.states)}")
        return self.states[body_name]
