"""The substitute in a loaded run for a callable of x, such as EI(x): its values along the beam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.bodies.beam import Beam
from vofem.bodies.coefficient import evaluate_along
from vofem.io.storage.stand_ins import missing, name_of

Array = NDArray[np.float64]

#: Values per element of a function of x.
_PER_ELEMENT = 20

#: Error, over the largest value, up to which the polynomial of an element counts as the function itself.
_FAITHFUL = 1e-10


@dataclass(frozen=True, eq=False)
class StoredField:
    """A function of x along a beam: a polynomial on every element, and its own values at nodes and midpoints.

    Attributes
    ----------
    name : str
    nodes : ndarray, shape (n_elements + 1,)
        Places of the nodes, m.
    values : ndarray, shape (n_elements, n_points)
        Values at Chebyshev points inside every element, from left to right.
    known_x, known : ndarray, shape (k,)
        Places in m, ascending, where it is known to the last bit, and its values there.
    error : ndarray, shape (n_elements,)
        The largest deviation of each polynomial found when it was stored, over the largest value.
    """

    name: str
    nodes: Array
    values: Array
    known_x: Array
    known: Array
    error: Array

    def __repr__(self) -> str:
        return f"the stored values of {self.name}"

    @classmethod
    def of(cls, function: Callable[[Array], Any], beam: Beam, what: str) -> StoredField:
        """Return the substitute for a callable of x. Its error is estimated at further points."""
        name = f"{what} of {beam.label} ({name_of(function)})"
        nodes = beam.nodes
        arc, start, widths = nodes - beam.origin, nodes[:-1, None], np.diff(nodes)[:, None]
        # A Beam checks its coefficients at the midpoints of elements.
        x = np.unique(np.concatenate([nodes, beam.origin + 0.5 * (arc[:-1] + arc[1:])]))

        def evaluated(x: Array) -> Array:
            return np.array(evaluate_along(name, function, x))

        values, trial = evaluated(start + _chebyshev(_PER_ELEMENT) * widths), _chebyshev(2 * _PER_ELEMENT + 3)
        true = evaluated(start + trial * widths)
        exact = cls(name, nodes, values, x, evaluated(x), np.zeros(widths.size))
        found = exact._interpolated(np.repeat(np.arange(widths.size), trial.size), np.tile(trial, widths.size))
        scale = float(np.max(np.abs(true))) or 1.0
        error = np.max(np.abs(found.reshape(true.shape) - true), axis=1) / scale
        return cls(name, nodes, values, x, exact.known, error)

    def __call__(self, x: ArrayLike) -> Array:
        """Return the values at x; raise `MissingCallableError` where a polynomial is not accurate."""
        x = np.asarray(x, dtype=float)
        flat = x.ravel()
        nearest = np.clip(np.searchsorted(self.known_x, flat), 0, self.known_x.size - 1)
        result = self.known[nearest]
        other = self.known_x[nearest] != flat
        if np.any(other):
            flat = flat[other]
            element = np.clip(np.searchsorted(self.nodes, flat, side="right") - 1, 0, self.nodes.size - 2)
            rough = ~(self.error[element] <= _FAITHFUL)
            if np.any(rough):
                raise missing(
                    f"a value at x = {flat[rough][0]:g} m",
                    self.name,
                    "it is not smooth enough on that element to be known by its values; put a node where it jumps "
                    "before saving, or build the beam in Python",
                )
            xi = (flat - self.nodes[element]) / (self.nodes[element + 1] - self.nodes[element])
            result[other] = self._interpolated(element, xi)
        return result.reshape(x.shape)

    def _interpolated(self, element: NDArray[np.int64], xi: Array) -> Array:
        """Return the barycentric interpolant of each element, with bounded memory."""
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
