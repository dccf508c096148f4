"""The substitute in a loaded run for a Python function: what it was asked, and what it answered.

Before a scene is saved, `Recorder` copies it with functions that note every argument and value. The scene is assembled
once more, and its loads and laws are evaluated where the run has used them. A file holds these values. When it is
loaded, assembly asks for the same values again and finds all of them, to the last bit. Any other value raises
`MissingCallableError`, which names the function.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.arrays import Array
from vofem.bodies import Beam, Body, Point, TravellingPoint
from vofem.bodies.coefficient import evaluate_along
from vofem.errors import MissingCallableError
from vofem.io.storage.tree import name_of_class
from vofem.parameters import changed, declarations, is_declared, label_of, values_of
from vofem.scene import Scene
from vofem.time_functions import Arbitrary, Piece, TimeFunction

#: Values per element of a function of x.
_PER_ELEMENT = 20

#: Error, over the largest value, up to which the polynomial of an element counts as the function itself.
_FAITHFUL = 1e-10


def name_of(function: Any) -> str:
    """Return the name of a function for messages; for a lambda also its place in the source."""
    name = str(getattr(function, "__name__", None) or type(function).__qualname__)
    code = getattr(function, "__code__", None)
    if name != "<lambda>" or code is None:
        return name
    return f"{name} in {os.path.basename(code.co_filename)}, line {code.co_firstlineno}"


@dataclass(frozen=True, eq=False)
class Recorded:
    """A function known by the values that it was asked for; along a beam also by a polynomial on every element."""

    name: str
    #: `x`, `values`: arguments, ascending, and values, shape (k,).
    x: Array
    values: Array
    #: Nodes of the beam in m; empty where it is no function along a beam. Shape (n_elements + 1,).
    nodes: Array = field(default_factory=lambda: np.empty(0))
    #: Values at Chebyshev points inside every element, from left to right, shape (n_elements, n_points).
    polynomials: Array = field(default_factory=lambda: np.empty((0, 0)))
    #: The largest deviation of each polynomial found when it was stored, over the largest value, shape (n_elements,).
    error: Array = field(default_factory=lambda: np.empty(0))

    @property
    def __name__(self) -> str:
        """The name of the function, as in its representation."""
        return self.name.split(" in ")[0]

    def __repr__(self) -> str:
        return f"the stored values of {self.name}"

    def __call__(self, x: ArrayLike, *more: Any) -> Any:
        """Return the values at x; raise `MissingCallableError` where they are not known."""
        wanted = np.asarray(x, dtype=float)
        flat = wanted.ravel()
        if not self.x.size:
            raise self.missing("this")
        place = np.clip(np.searchsorted(self.x, flat), 0, self.x.size - 1)
        result = self.values[place]
        other = self.x[place] != flat
        if np.any(other):
            result[other] = self._between(flat[other])
        return result.reshape(wanted.shape)[()]

    def _between(self, x: Array) -> Array:
        """Return the values of the polynomials."""
        if not self.nodes.size:
            raise self.missing(f"a value at {x[0]:g}")
        element = np.clip(np.searchsorted(self.nodes, x, side="right") - 1, 0, self.nodes.size - 2)
        rough = ~(self.error[element] <= _FAITHFUL)
        if np.any(rough):
            raise self.missing(f"a value at x = {x[rough][0]:g} m", "put a node where it jumps before saving, or ")
        xi = (x - self.nodes[element]) / (self.nodes[element + 1] - self.nodes[element])
        return interpolated(self.polynomials, element, xi)

    def missing(self, what: str, cure: str = "") -> MissingCallableError:
        """Return the error for a value that only the function itself could give."""
        return MissingCallableError(
            f"{what} needs the callable {self.name!r}, of which the saved run holds the values that it has used; "
            f"{cure}build the scene in Python"
        )


@dataclass(frozen=True)
class RecordedLoad(Arbitrary):
    """The substitute for a load's function of time: its values are those of a `Recorded` function."""

    function: Recorded

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t that the run has used."""
        return np.asarray(self.function(t), dtype=float)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Raise `MissingCallableError`."""
        raise self.function.missing("the derivative of a load")

    def piece(self, t0: float) -> Piece:
        """Raise `MissingCallableError`."""
        raise self.function.missing("the closed form of a load")


class Recording:
    """A function that notes what it is asked and what it answers."""

    def __init__(self, function: Callable[..., Any], name: str, beam: Beam | None = None) -> None:
        self._function, self._name, self._beam = function, name, beam
        self._known: dict[float, float] = {}

    @property
    def __name__(self) -> str:
        """The name of the function."""
        return str(getattr(self._function, "__name__", None) or type(self._function).__qualname__)

    def __call__(self, x: Any, *more: Any) -> Any:
        """Return what the function returns."""
        answer = self._function(x, *more)
        values = np.broadcast_to(np.asarray(answer, dtype=float), np.shape(x))
        self._known.update(zip(np.ravel(x).tolist(), np.ravel(values).tolist(), strict=True))
        return answer

    def recorded(self) -> Recorded:
        """Return the substitute."""
        if self._beam is not None:
            nodes = self._beam.nodes
            # Other meshes and fields ask at nodes and midpoints.
            evaluate_along(self._name, self, np.unique(np.concatenate([nodes, 0.5 * (nodes[:-1] + nodes[1:])])))
        x = np.array(sorted(self._known), dtype=float)
        known = Recorded(self._name, x, np.array([self._known[one] for one in x.tolist()]))
        return known if self._beam is None else _along(self._function, self._beam.nodes, known)


def _along(function: Callable[[Array], Any], nodes: Array, known: Recorded) -> Recorded:
    """Return a substitute that has polynomials too. Their error is estimated at further points."""
    start, widths = nodes[:-1, None], np.diff(nodes)[:, None]

    def at(points: Array) -> Array:
        return np.array(evaluate_along(known.name, function, start + points * widths))

    trial = _chebyshev(2 * _PER_ELEMENT + 3)
    values, true = at(_chebyshev(_PER_ELEMENT)), at(trial)
    count = widths.size
    found = interpolated(values, np.repeat(np.arange(count), trial.size), np.tile(trial, count)).reshape(true.shape)
    error = np.max(np.abs(found - true), axis=1) / (float(np.max(np.abs(true))) or 1.0)
    return Recorded(known.name, known.x, known.values, nodes, values, error)


def interpolated(values: Array, element: NDArray[np.int64], xi: Array) -> Array:
    """Return the barycentric interpolants of elements, of values (n_elements, n_points), at places xi from 0 to 1."""
    points = _chebyshev(values.shape[1])
    weights = np.sin(np.pi * (np.arange(points.size) + 0.5) / points.size) * (-1.0) ** np.arange(points.size)
    above, below = np.zeros(xi.size), np.zeros(xi.size)
    exact = np.full(xi.size, np.nan)
    for k, point in enumerate(points):
        distance = xi - point
        hit = distance == 0.0
        exact[hit] = values[element[hit], k]
        share = weights[k] / np.where(hit, 1.0, distance)
        above += share * values[element, k]
        below += share
    return np.where(np.isnan(exact), above / below, exact)


def _chebyshev(count: int) -> Array:
    """Return the Chebyshev points of the first kind on (0, 1), ascending."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count), dtype=float)


def is_plain(value: Any) -> bool:
    """Return whether a file can hold a callable as it is: a function of this package, made of numbers."""
    return is_declared(type(value)) or name_of_class(type(value)) is not None


class Recorder:
    """Makes a copy of a scene whose Python functions are noted; a function that occurs twice is one in the copy."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, str], Recording] = {}
        self._kept: list[Any] = []

    def scene(self, scene: Scene) -> Scene:
        """Return the copy, or the scene itself where there is no such function."""
        bodies: dict[Body, Body] = {body: self._of(body, {}) for body in scene.bodies}
        effects = [self._of(effect, bodies) for effect in scene.effects]
        if not self._made:
            return scene
        return Scene(list(bodies.values()), effects)

    def _of(self, thing: Any, bodies: Mapping[Body, Body]) -> Any:
        """Return a body or an effect with its functions replaced, on other bodies."""
        if not is_declared(type(thing)):
            return thing
        beam = thing if isinstance(thing, Beam) else getattr(thing, "beam", None)
        new = {name: self._value(value, name, thing, beam, bodies) for name, value in values_of(thing).items()}
        same = all(new[name] is value for name, value in values_of(thing).items())
        return thing if same else changed(thing, **new)

    def _value(self, value: Any, name: str, thing: Any, beam: Any, bodies: Mapping[Body, Body]) -> Any:
        if isinstance(value, Body):
            return bodies.get(value, value)
        if isinstance(value, Point):
            body: Any = bodies.get(value.body, value.body)
            if body is value.body:
                return value
            return TravellingPoint(body, value.path) if isinstance(value, TravellingPoint) else Point(body, value.x)
        if isinstance(value, TimeFunction):
            return self.function(value)
        if not callable(value) or is_plain(value):
            return value
        along = beam if isinstance(beam, Beam) else None
        return self._noted(value, f"{name} of {label_of(thing)} ({name_of(value)})", along)

    def function(self, function: Any) -> Any:
        """Return a function of time with its Python functions replaced."""
        if type(function) is Arbitrary:
            inner = function.function
            return function if isinstance(inner, Recording) else Arbitrary(self._noted(inner, name_of(inner), None))
        if is_declared(type(function)):
            new = {
                name: tuple(map(self.function, value)) if isinstance(value, tuple) else self.function(value)
                for name, value in values_of(function).items()
                if isinstance(value, (tuple, TimeFunction)) and name in declarations(type(function))
            }
            same = all(new[name] == getattr(function, name) for name in new)
            return function if same else changed(function, **new)
        return function if is_plain(function) else Arbitrary(self._noted(function, name_of(function), None))

    def _noted(self, function: Any, name: str, beam: Beam | None) -> Recording:
        self._kept.append(function)  # so that no other function gets its identity
        return self._made.setdefault((id(function), name), Recording(function, name, beam))
